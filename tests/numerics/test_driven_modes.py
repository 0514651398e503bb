"""Modes under a load: against SciPy's integrator, and where the answer is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gridfold.errors import OptionError
from gridfold.numerics.driven_modes import drive_modes
from gridfold.numerics.modal_form import modal_form

#: An integrator, a slow decay, and a swing of 1 Hz.
MATRIX = np.array([[0, 0, 0, 0.0], [0, -0.3, 0, 0], [0, 0, -0.2, 6.3], [0, 0, -6.3, -0.2]])
TIMES = np.array([0.0, 0.05, 0.1, 0.15, 0.4, 0.41, 1.0])


def test_the_answer_is_exact_for_a_load_that_is_linear_between_the_times() -> None:
    form = modal_form(MATRIX)
    rng = np.random.default_rng(0)
    load, start = rng.normal(size=(len(TIMES), 4)), rng.normal(size=4)

    def rate(t: float, w: np.ndarray) -> np.ndarray:
        return form.derivative(w) + [np.interp(t, TIMES, column) for column in load.T]

    w = [start]
    for t0, t1 in pairwise(TIMES):
        w.append(solve_ivp(rate, (t0, t1), w[-1], rtol=1e-11, atol=1e-12).y[:, -1])
    np.testing.assert_allclose(drive_modes(form, TIMES, start, load), w, atol=1e-8)


def test_a_constant_load_on_an_integrator_is_a_ramp() -> None:
    form = modal_form(np.zeros((1, 1)))
    found = drive_modes(form, TIMES, np.ones(1), np.full((len(TIMES), 1), 3.0))
    np.testing.assert_allclose(found[:, 0], 1 + 3 * TIMES, rtol=1e-14)


def test_arrays_of_another_shape_are_named() -> None:
    form = modal_form(MATRIX)
    with pytest.raises(OptionError, match=r"load has shape \(2, 4\), expected \(7, 4\)"):
        drive_modes(form, TIMES, np.zeros(4), np.zeros((2, 4)))
