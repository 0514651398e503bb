from __future__ import annotations

import numpy as np
from scipy.sparse import csc_array

from gridfold.powerflow.newton_steps import newton_steps

NONE = np.zeros(0, dtype=np.int32)
SLACK, LOAD = np.array([0], dtype=np.int32), np.array([1], dtype=np.int32)


def _line(reactance: float) -> csc_array:
    y = 1 / complex(0, reactance)
    return csc_array(np.array([[y, -y], [-y, y]]))


def test_a_load_behind_a_reactance_has_the_voltage_of_the_quadratic_equation():
    # |V|^4 + (2 x q - 1) |V|^2 + x^2 (p^2 + q^2) = 0 behind 1 p.u.
    x, p, q = 0.2, 0.8, 0.3
    size = np.sqrt((1 - 2 * x * q + np.sqrt((1 - 2 * x * q) ** 2 - 4 * x**2 * (p**2 + q**2))) / 2)
    scheduled = np.array([0, -complex(p, q)])
    voltage, _ = newton_steps(
        _line(x), np.ones(2, complex), scheduled, SLACK, NONE, LOAD, 30, 1e-13
    )
    assert abs(abs(voltage[1]) - size) < 1e-12
    assert abs(np.angle(voltage[1]) + np.arcsin(p * x / size)) < 1e-12


def test_a_held_voltage_keeps_its_size_and_its_error_falls_with_the_square():
    scheduled = np.array([0, complex(0.9, 0)])
    start = np.array([1.0, 1.02 + 0j])
    angle = np.arcsin(0.9 * 0.5 / 1.02)
    errors = []
    for allowed in (1, 2, 3):
        voltage, count = newton_steps(_line(0.5), start, scheduled, SLACK, LOAD, NONE, allowed, 0.0)
        assert count == allowed
        assert abs(abs(voltage[1]) - 1.02) < 1e-15
        errors.append(abs(np.angle(voltage[1]) - angle))
    assert errors[1] < errors[0] ** 2
    assert errors[2] < errors[1] ** 2


def test_without_a_solution_it_ends_with_finite_voltages_or_says_how_many_steps_it_took():
    scheduled = np.array([0, -10 + 0j])  # beyond 1 / (2 x) of what the line carries
    voltage, count = newton_steps(
        _line(0.2), np.ones(2, complex), scheduled, SLACK, NONE, LOAD, 30, 1e-12
    )
    assert count <= 30
    assert voltage.shape == (2,)
    # a bus that nothing is connected to: the matrix is singular at once
    alone = csc_array(np.zeros((2, 2), complex))
    voltage, count = newton_steps(
        alone, np.ones(2, complex), np.array([0, -1 + 0j]), SLACK, NONE, LOAD, 30, 1e-12
    )
    assert count == 0
    assert (voltage == 1).all()
