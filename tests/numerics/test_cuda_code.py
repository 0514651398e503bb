"""What a function may use on a GPU, and what stands there for functions of NumPy."""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np
import pytest
from numba import njit

from gridfold.dynamics.cuda.kernel import why_not
from gridfold.dynamics.registry import DEVICES
from gridfold.numerics import cuda_code
from gridfold.numerics.code_copies import CodeCopies
from gridfold.numerics.cuda_code import unknown_names

TABLE = np.array([1.0, 2.0])
GAIN = 0.5
LIMITS = namedtuple("LIMITS", "lowest highest")(-3.0, 3.0)


@njit
def helper(x):
    return np.interp(x, TABLE, TABLE)


def calls_helper(x):
    return helper(x) + np.sin(x)


def all_known(x):
    return (
        np.sqrt(x) + np.maximum(x, 2.0) * np.minimum(x, 2.0) - np.floor(x) + np.ceil(x)
        + np.sign(-x) + np.arctan2(x, 1.0) + np.abs(-x) + math.exp(-x) + np.pi + max(x, 1.0)
    )  # fmt: skip


def test_what_cuda_does_not_know_is_named_wherever_it_is_used():
    assert unknown_names(calls_helper) == ["TABLE", "np.interp"]
    assert unknown_names(lambda x: print(x) or np.linalg.norm(x)) == ["np.linalg", "print"]


def test_functions_of_single_numbers_are_known_and_have_the_same_values():
    assert unknown_names(all_known) == []
    numbers = {**cuda_code._NUMBERS, **cuda_code._OWN}
    copy = CodeCopies(numbers, lambda function: function).function(all_known)
    for x in (0.3, 1.0, 1.7, 2.0, 5.5):
        assert copy(x) == pytest.approx(all_known(x), rel=1e-15)


def with_numbers(x, half=0.5):
    parts = (0.25, 2)
    return helper_with_number(x) + x * parts[0] * parts[1] + half + GAIN


@njit
def helper_with_number(x):
    return 1.5 * x + LIMITS.highest


def test_numbers_in_the_source_of_a_copy_are_of_its_type():
    copy = cuda_code.device_code(with_numbers, np.float32, compiled=lambda function: function)
    helper = copy.__globals__["helper_with_number"]
    numbers = [
        *copy.__code__.co_consts, *helper.__code__.co_consts, copy.__globals__["GAIN"],
        *helper.__globals__["LIMITS"], *copy.__defaults__,
    ]  # fmt: skip
    assert not any(isinstance(value, float) for value in numbers)
    assert copy(np.float32(2.0)) == with_numbers(2.0) == 8.0


@pytest.mark.parametrize("a", [1.0, 2.0, math.nan])
@pytest.mark.parametrize("b", [1.0, 2.0, math.nan])
def test_the_larger_and_the_smaller_are_those_of_numpy(a, b):
    assert cuda_code._larger(a, b) == pytest.approx(np.maximum(a, b), nan_ok=True)
    assert cuda_code._smaller(a, b) == pytest.approx(np.minimum(a, b), nan_ok=True)


def test_every_device_of_the_package_is_known_on_a_gpu():
    assert why_not(list(DEVICES.values())) is None
