"""Stabilizer PSS2B: two limited inputs, a ramp filter and three lead-lags.

    first and second input within VSI1MIN, VSI1MAX and VSI2MIN, VSI2MAX
    a third block (1 + s T10) / (1 + s T11) behind the other two

Model PSS2B of the PSS/E Model Library, stabilizer models; IEEE Std 421.5-2005, type PSS2B. All other
blocks are those of :mod:`~gridfold.dynamics.stabilizers.two_inputs`.
"""

from __future__ import annotations

from numba import njit

from gridfold.dynamics.blocks import clip
from gridfold.dynamics.device import Bound, Device, Parameter
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

(
    T10, T11, VSI1MAX, VSI1MIN, VSI2MAX, VSI2MIN, VSTMAX, VSTMIN, POWER_BASE, BASE_SPEED,
) = range(21, 31)  # fmt: skip
LEAD_3 = LEAD_2 + 1
VS = 0

PARAMETERS = (
    *two_inputs.CODES,
    *two_inputs.FILTERS,
    Parameter("lead_time_3", "T10", "s", Bound.NOT_NEGATIVE),
    Parameter("lag_time_3", "T11", "s", Bound.NOT_NEGATIVE),
    Parameter("highest_input_1", "VSI1MAX", "p.u.", Bound.ANY),
    Parameter("lowest_input_1", "VSI1MIN", "p.u.", Bound.ANY),
    Parameter("highest_input_2", "VSI2MAX", "p.u.", Bound.ANY),
    Parameter("lowest_input_2", "VSI2MIN", "p.u.", Bound.ANY),
    *two_inputs.OUTPUT,
    two_inputs.POWER_BASE,
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def filtered(x, u, p, dx, i, mechanical_power, writes):
    """Signal of unit `i` before its limits."""
    first, second = signals(u, p, i, mechanical_power, p[POWER_BASE, i])
    first = clip(first, p[VSI1MIN, i], p[VSI1MAX, i])
    second = clip(second, p[VSI2MIN, i], p[VSI2MAX, i])
    value = before_leads(first, second, x, p, dx, i, writes)
    value = lead(value, x, dx, LEAD_1, i, p[T1, i], p[T2, i], writes)
    value = lead(value, x, dx, LEAD_2, i, p[T3, i], p[T4, i], writes)
    return lead(value, x, dx, LEAD_3, i, p[T10, i], p[T11, i], writes)


def output(x, u, p, y, dx):
    """Stabilizer signal; mechanical power does not reach it without a lag, see `check`."""
    for i in range(x.shape[1]):
        wanted = filtered(x, u, p, dx, i, u[PE, i], False)
        y[VS, i] = clip(wanted, p[VSTMIN, i], p[VSTMAX, i])


def derivative(x, u, p, y, dx):
    """All filters."""
    for i in range(x.shape[1]):
        filtered(x, u, p, dx, i, u[PM, i], True)


PSS2B = Device(
    model="pss2b",
    title="dual-input stabilizer PSS2B",
    role=two_inputs.ROLE,
    parameters=PARAMETERS,
    states=(*two_inputs.STATES, "stabilizer_lead_3"),
    inputs=two_inputs.INPUTS,
    outputs=("stabilizer_signal",),
    output=output,
    derivative=derivative,
    defaults=two_inputs.DEFAULTS,
    check=two_inputs.check_of(
        PARAMETERS,
        ("lowest_input_1", "highest_input_1"),
        ("lowest_input_2", "highest_input_2"),
    ),
    limits=two_inputs.LIMITS,
    psse_record=DYR_COLUMNS,
)
