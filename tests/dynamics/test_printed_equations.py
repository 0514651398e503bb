"""The detailed model against equations (1) of Osipov & Sun, written out as printed."""

from __future__ import annotations

import numpy as np
import pytest
from cases import internal_admittance

import gridfold as gf

ORDER = (
    "rotor_angle",
    "mechanical_power",
    "governor_power",
    "regulator_voltage",
    "rate_feedback",
    "field_voltage",
    "d_transient_voltage",
    "q_transient_voltage",
    "speed",
)


def printed_currents(delta, e_d, e_q, g, b):
    """Id and Iq by the double sums of sines and cosines."""
    n = len(delta)
    i_d, i_q = np.zeros(n), np.zeros(n)
    for i in range(n):
        for j in range(n):
            c, s = np.cos(delta[i] - delta[j]), np.sin(delta[i] - delta[j])
            i_d[i] += e_d[j] * (g[i, j] * c + b[i, j] * s) + e_q[j] * (g[i, j] * s - b[i, j] * c)
            i_q[i] += e_d[j] * (-g[i, j] * s + b[i, j] * c) + e_q[j] * (g[i, j] * c + b[i, j] * s)
    return i_d, i_q


def printed_derivatives(model: gf.DetailedModel, units, x):
    """All nine equations of every generator; x by name, shape (n_units,) each."""
    y = internal_admittance(model, units)
    p = {}
    for block in model.layout.blocks:
        assert block.units == tuple(units)
        p |= dict(zip(block.device.parameter_rows, block.parameters, strict=True))
    i_d, i_q = printed_currents(
        x["rotor_angle"], x["d_transient_voltage"], x["q_transient_voltage"], y.real, y.imag
    )
    e_d, e_q = x["d_transient_voltage"], x["q_transient_voltage"]
    r_a, x_d1 = p["resistance"], p["d_transient_reactance"]
    v_d, v_q = e_d - r_a * i_d + x_d1 * i_q, e_q - r_a * i_q - x_d1 * i_d
    v_t = np.sqrt(v_d**2 + v_q**2)
    slip = x["speed"] - 1
    feedback = p["feedback_gain"] / p["feedback_time"] * x["field_voltage"]
    saturation = p["saturation_a"] * np.exp(p["saturation_b"] * x["field_voltage"])
    return {
        "rotor_angle": 120 * np.pi * slip,
        "mechanical_power": (-x["mechanical_power"] + x["governor_power"]) / p["charging_time"],
        "governor_power": (-x["governor_power"] + p["power_reference"] - slip / p["droop"])
        / p["governor_time"],
        "regulator_voltage": (
            -x["regulator_voltage"]
            + p["regulator_gain"] * x["rate_feedback"]
            - p["regulator_gain"] * feedback
            + p["regulator_gain"] * (p["voltage_reference"] - v_t)
        )
        / p["regulator_time"],
        "rate_feedback": (-x["rate_feedback"] + feedback) / p["feedback_time"],
        "field_voltage": (
            -(p["exciter_gain"] + saturation) * x["field_voltage"] + x["regulator_voltage"]
        )
        / p["exciter_time"],
        "d_transient_voltage": (-e_d + (p["q_reactance"] - p["q_transient_reactance"]) * i_q)
        / p["q_open_circuit_time"],
        "q_transient_voltage": (-e_q - (p["d_reactance"] - x_d1) * i_d + x["field_voltage"])
        / p["d_open_circuit_time"],
        "speed": (x["mechanical_power"] - e_d * i_d - e_q * i_q - p["damping"] * slip)
        / (2 * p["inertia"]),
    }


@pytest.mark.parametrize("spread", [0.0, 0.01, 0.3])
def test_compiled_derivatives_equal_the_printed_equations_to_1e_12(npcc, spread):
    units = npcc.machines
    state = npcc.x0 + spread * np.random.default_rng(7).standard_normal(npcc.n_states)
    x = {name: state[npcc.slots(name, units)] for name in ORDER}
    expected = printed_derivatives(npcc, units, x)
    derivative = npcc.compiled(state)
    for name in ORDER:
        actual = derivative[npcc.slots(name, units)]
        # The terms that cancel at the equilibrium set the scale of rounding.
        scale = max(1.0, np.abs(expected[name]).max())
        np.testing.assert_allclose(actual, expected[name], rtol=0, atol=1e-12 * scale, err_msg=name)
