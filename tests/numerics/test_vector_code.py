"""Copies of kernels with vector functions compute what the originals do."""

import math

import numpy as np
from numba import njit

from gridfold.numerics.compiled import compiled_part
from gridfold.numerics.elementary import exponential
from gridfold.numerics.vector_code import vector_code

OFFSET = 0.25


@njit
def helper(x):
    return np.exp(-x) + math.log(2 + x)


def function(x):
    return np.sin(x) + math.cos(2 * x) * helper(x) + OFFSET


def test_a_copy_reaches_the_vector_functions_also_in_what_it_calls():
    copy = vector_code(function)
    assert copy.__code__ is function.__code__
    assert copy.__globals__["np"].exp is exponential
    assert copy.__globals__["helper"].py_func.__globals__["np"].exp is exponential
    assert np.exp is not exponential


def test_a_copy_has_the_values_of_the_original():
    copy = compiled_part(vector_code(function))
    for x in np.linspace(0.0, 6.0, 25):
        assert abs(copy(x) - function(x)) < 1e-14
