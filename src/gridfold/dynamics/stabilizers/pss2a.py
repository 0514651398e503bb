"""Stabilizer PSS2A: two inputs, a ramp filter and two lead-lags.

Model PSS2A of the PSS/E Model Library, stabilizer models; IEEE Std 421.5-1992, type PSS2A. All blocks
are those of :mod:`~gridfold.dynamics.stabilizers.two_inputs`.
"""

from __future__ import annotations

from numba import njit

from gridfold.dynamics.blocks import clip
from gridfold.dynamics.device import Device
from gridfold.dynamics.stabilizers import two_inputs
from gridfold.dynamics.stabilizers.two_inputs import (
    LEAD_1,
    LEAD_2,
    PE,
    PM,
    T1,
    T2,
    T3,
    T4,
    before_leads,
    lead,
    signals,
)

VSTMAX, VSTMIN, POWER_BASE, BASE_SPEED = range(21, 25)
VS = 0

PARAMETERS = (
    *two_inputs.CODES,
    *two_inputs.FILTERS,
    *two_inputs.OUTPUT,
    two_inputs.POWER_BASE,
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def filtered(x, u, p, dx, i, mechanical_power, writes):
    """Signal of unit `i` before its limits."""
    first, second = signals(u, p, i, mechanical_power, p[POWER_BASE, i])
    value = before_leads(first, second, x, p, dx, i, writes)
    value = lead(value, x, dx, LEAD_1, i, p[T1, i], p[T2, i], writes)
    return lead(value, x, dx, LEAD_2, i, p[T3, i], p[T4, i], writes)


def output(x, u, p, y, dx):
    """Stabilizer signal; mechanical power does not reach it without a lag, see `check`."""
    for i in range(x.shape[1]):
        wanted = filtered(x, u, p, dx, i, u[PE, i], False)
        y[VS, i] = clip(wanted, p[VSTMIN, i], p[VSTMAX, i])


def derivative(x, u, p, y, dx):
    """All filters."""
    for i in range(x.shape[1]):
        filtered(x, u, p, dx, i, u[PM, i], True)


PSS2A = Device(
    model="pss2a",
    title="dual-input stabilizer PSS2A",
    role=two_inputs.ROLE,
    parameters=PARAMETERS,
    states=two_inputs.STATES,
    inputs=two_inputs.INPUTS,
    outputs=("stabilizer_signal",),
    output=output,
    derivative=derivative,
    defaults=two_inputs.DEFAULTS,
    check=two_inputs.check_of(PARAMETERS),
    limits=two_inputs.LIMITS,
    psse_record=DYR_COLUMNS,
)
