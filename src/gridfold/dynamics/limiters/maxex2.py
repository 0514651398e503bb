"""MAXEX2 of PSS/E: a limiter of overexcitation that lets a field be hot for some time.

PSS/E Model Library, MAXEX2. E is the field current, or with code 0 the field voltage, over its rating.
From E1 on a clock runs, the faster the larger E is,

    dc/dt = 1 / T(E),     T through (E1, TIME1), (E2, TIME2), (E3, TIME3), and TIME3 above E3

and below E1 it is set back. Once it has come to 1 the limiter acts, and goes on until it is of no use:

    VOEL = KMX / s (EDES - E)     VLOW <= VOEL <= 0, non-windup

T is a straight line between points. A clock that is set back is so within 0.1 s.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import clip, held
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values

CODE, RATED, E1, TIME1, E2, TIME2, E3, TIME3, EDES, KMX, VLOW, BASE_SPEED = range(12)
CLOCK, SIGNAL = range(2)
EFD, IFD = range(2)
VOEL = 0

#: Time constant in s with which the clock is set back.
_BACK = 0.1

PARAMETERS = (
    Parameter("field_code", "code", "-", Bound.NOT_NEGATIVE),
    Parameter("rated_field", "RATED", "p.u."),
    Parameter("field_1", "E1", "p.u."),
    Parameter("time_1", "TIME1", "s"),
    Parameter("field_2", "E2", "p.u."),
    Parameter("time_2", "TIME2", "s"),
    Parameter("field_3", "E3", "p.u."),
    Parameter("time_3", "TIME3", "s"),
    Parameter("desired_field", "EDES", "p.u."),
    Parameter("limiter_gain", "KMX", "p.u."),
    Parameter("lowest_signal", "VLOW", "p.u.", Bound.ANY),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


@njit
def patience(e, p, i):
    """Time for which unit `i` may have a field of `e`, which is above E1."""
    if e.real >= p[E3, i].real:
        return p[TIME3, i]
    if e.real >= p[E2, i].real:
        part = (e - p[E2, i]) / (p[E3, i] - p[E2, i])
        return p[TIME2, i] + part * (p[TIME3, i] - p[TIME2, i])
    part = (e - p[E1, i]) / (p[E2, i] - p[E1, i])
    return p[TIME1, i] + part * (p[TIME2, i] - p[TIME1, i])


def output(x, u, p, y, dx):
    """The signal."""
    for i in range(x.shape[1]):
        y[VOEL, i] = clip(x[SIGNAL, i], p[VLOW, i], 0.0 * p[VLOW, i])


def derivative(x, u, p, y, dx):
    """Clock and limiter."""
    for i in range(x.shape[1]):
        e = (u[EFD, i] if p[CODE, i].real < 0.5 else u[IFD, i]) / p[RATED, i]
        if e.real > p[E1, i].real:
            dx[CLOCK, i] = held(1.0 / patience(e, p, i), x[CLOCK, i], -1.0, 1.0)
        else:
            dx[CLOCK, i] = -x[CLOCK, i] / _BACK
        if x[CLOCK, i].real > 0.999 or x[SIGNAL, i].real < -1e-9:
            rate = p[KMX, i] * (p[EDES, i] - e)
            dx[SIGNAL, i] = held(rate, x[SIGNAL, i], p[VLOW, i], 0.0 * p[VLOW, i])
        else:
            dx[SIGNAL, i] = -x[SIGNAL, i]


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Neither clock nor limiter has begun."""
    return {}


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """A known code, a curve that falls with the field, and a signal that lowers it."""
    if parameters["field_code"] not in (0, 1):
        code = parameters["field_code"]
        yield f"field_code is 0 for the field voltage or 1 for the current, not {code:g}"
    fields = [parameters[f"field_{k}"] for k in (1, 2, 3)]
    times = [parameters[f"time_{k}"] for k in (1, 2, 3)]
    if not (fields[0] < fields[1] < fields[2] and times[0] >= times[1] >= times[2]):
        yield "E1, E2 and E3 have to rise, and TIME1, TIME2 and TIME3 to fall"
    if parameters["lowest_signal"] > 0:
        yield "lowest_signal VLOW is above 0"


MAXEX2 = Device(
    model="maxex2",
    title="limiter of overexcitation MAXEX2",
    role=Role.OVEREXCITATION_LIMITER,
    parameters=PARAMETERS,
    states=("overexcitation_clock", "overexcitation_state"),
    inputs=("field_voltage", "field_current"),
    outputs=("overexcitation_signal",),
    output=output,
    derivative=derivative,
    guess=guess,
    check=check,
    psse_record=DYR_COLUMNS,
)
