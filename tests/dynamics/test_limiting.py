"""A limit acts where something changes without it, whatever the other limits do."""

from __future__ import annotations

import numpy as np
import pytest

from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.limiting import ACTING, NO_LIMIT, acting_limits, limit_value
from gridfold.dynamics.registry import DEVICES

LIMITED = sorted(name for name, device in DEVICES.items() if device.limits)
N_UNITS = 60


def rates_and_outputs(device, x, u, p):
    x, u, p = (np.asarray(m, dtype=complex) for m in (x, u, p))
    y = output_stage(device, x, u, p, source_stage(device, x, p))
    return np.concatenate([y.real, derivative_stage(device, x, u, p, y).real])


@pytest.mark.parametrize("model", LIMITED)
def test_acting_limits_are_those_whose_removal_alone_changes_something(model):
    """At random states, half of them in the middle of all limits; each limit goes by itself."""
    device, rng = DEVICES[model], np.random.default_rng(len(model))
    p = rng.uniform(0.1, 1.5, (len(device.parameter_rows), N_UNITS))
    x = rng.normal(0.0, 1.0, (len(device.states), N_UNITS))
    u = rng.normal(0.0, 1.0, (len(device.inputs), N_UNITS))
    x[:, ::2] *= 0.05
    u[:, ::2] *= 0.05
    for limit in device.limits:
        row = device.parameter_rows.index(limit.parameter)
        p[row] = limit.side.value * np.where(np.arange(N_UNITS) % 3, 1.0, NO_LIMIT)
    found = acting_limits(device, x, u, p)
    assert np.isfinite(rates_and_outputs(device, x, u, p)).any()
    for k, limit in enumerate(device.limits):
        free = p.copy()
        free[device.parameter_rows.index(limit.parameter)] = limit.side.value * NO_LIMIT
        with np.errstate(invalid="ignore"):
            change = np.abs(
                rates_and_outputs(device, x, u, free) - rates_and_outputs(device, x, u, p)
            )
            expected = (change > ACTING).any(axis=0)
        if limit.state is not None:
            beyond = x[device.states.index(limit.state)] - limit_value(device, limit, p)
            expected |= limit.side.value * beyond > ACTING
        np.testing.assert_array_equal(found[k], expected, err_msg=limit.parameter)
