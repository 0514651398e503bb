"""SCRX: a static exciter fed from the terminals or from a constant source.

    VD  = K / (1 + s TE) (1 + s TA) / (1 + s TB) (VREF + VS - VT),   EMIN <= VD <= EMAX, non-windup
    EFD = VT VD (CSWITCH = 0) or VD (CSWITCH = 1)

The bridge lets no current flow backwards. Where RC/RFD is positive, a resistance of that size takes a
negative field current: EFD = -RC/RFD IFD as long as IFD < 0. With RC/RFD = 0 the exciter takes it.
PSS/E Model Library; the record gives the ratio TA/TB.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numba import njit

from gridfold.dynamics.blocks import lead_lag, limited_lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values, limits

RATIO, TB, K, TE, EMIN, EMAX, SWITCH, CROWBAR, VREF, BASE_SPEED = range(10)
LEAD, VD = range(2)
VT, VS, IFD, SUPPLY = range(4)
EFD = 0

PARAMETERS = (
    Parameter("lead_lag_ratio", "TA/TB", "-", Bound.NOT_NEGATIVE),
    Parameter("lag_time", "TB", "s", Bound.NOT_NEGATIVE),
    Parameter("regulator_gain", "K", "p.u."),
    Parameter("exciter_time", "TE", "s", Bound.NOT_NEGATIVE),
    Parameter("field_voltage_minimum", "EMIN", "p.u.", Bound.ANY),
    Parameter("field_voltage_maximum", "EMAX", "p.u.", Bound.ANY),
    Parameter("source_code", "CSWITCH", "-", Bound.ANY),
    Parameter("crowbar_ratio", "RC/RFD", "-", Bound.NOT_NEGATIVE),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


@njit
def source(code, v_t):
    """What the bridge is fed with."""
    return v_t if code.real == 0 else 1.0 + 0.0 * v_t


def output(x, u, p, y, dx):
    """Field voltage."""
    for i in range(x.shape[1]):
        error = p[VREF, i] + u[VS, i] - u[VT, i]
        lead, _ = lead_lag(error, x[LEAD, i], p[RATIO, i] * p[TB, i], p[TB, i])
        v_d, _ = limited_lag(p[K, i] * lead, x[VD, i], p[TE, i], p[EMIN, i], p[EMAX, i])
        y[EFD, i] = v_d * source(p[SWITCH, i], u[SUPPLY, i])
        if p[CROWBAR, i].real > 0 and u[IFD, i].real < 0:
            y[EFD, i] = -p[CROWBAR, i] * u[IFD, i]


def derivative(x, u, p, y, dx):
    """Lead-lag and exciter."""
    for i in range(x.shape[1]):
        error = p[VREF, i] + u[VS, i] - u[VT, i]
        lead, dx[LEAD, i] = lead_lag(error, x[LEAD, i], p[RATIO, i] * p[TB, i], p[TB, i])
        _, dx[VD, i] = limited_lag(p[K, i] * lead, x[VD, i], p[TE, i], p[EMIN, i], p[EMAX, i])


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """All equations are linear; the field voltage is prescribed."""
    return {"exciter_voltage": known["field_voltage"]}


def codes(parameters: Mapping[str, float]) -> Iterable[str]:
    """CSWITCH is a choice of two."""
    if parameters["source_code"] not in (0, 1):
        yield f"source_code CSWITCH {parameters['source_code']:g} is neither 0 nor 1"


SCRX = Device(
    model="scrx",
    title="bus- or solid-fed static excitation system (PSS/E SCRX)",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=("lead_lag_state", "exciter_voltage"),
    inputs=("terminal_voltage", "stabilizer_signal", "field_current", "supply_voltage"),
    outputs=("field_voltage",),
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    guess=guess,
    check=checks(
        PARAMETERS, ordered=[("field_voltage_minimum", "field_voltage_maximum")], more=[codes]
    ),
    limits=limits("field_voltage_minimum", "field_voltage_maximum", state="exciter_voltage"),
    psse_record=DYR_COLUMNS,
)
