"""Hydro turbine and governor HYGOVD: HYGOV with a dead band, on the rating of its turbine.

The governor of :mod:`~gridfold.dynamics.governors.hygov` sees, in the place of the speed deviation dw,

    dw - DBH for dw > DBH,    dw - DBL for dw < DBL,    0 between them;

the damping of the turbine sees dw. DBL is negative; a positive one is taken for its opposite. Powers
and gates are in p.u. of Trate in MW, or of the machine's base where Trate is 0. PSS/E Model Library,
HYGOVD (HYGOVDU in earlier versions). That the governor acts on what exceeds the band, without a step
at its edges, is the intentional dead band of IEEE PES-TR1.
"""

from __future__ import annotations

from collections.abc import Mapping

from gridfold.dynamics.blocks import clip, dead_band_between, held, lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Side, limits
from gridfold.dynamics.governors import hygov
from gridfold.dynamics.governors.hygov import HYGOV, head_at

(
    R, TEMPORARY, TR, TF, TG, VELM, GMAX, GMIN, TW, AT, DTURB, QNL, DBH, DBL, TRATE,
    POWER_BASE, PREF, BASE_SPEED,
) = range(18)  # fmt: skip
FILTER, DESIRED, GATE, FLOW = range(4)
OMEGA = 0
PM = 0

PARAMETERS = (
    *HYGOV.parameters[:-1],
    Parameter("dead_band_above", "DBH", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("dead_band_below", "DBL", "p.u.", Bound.ANY),
    Parameter("turbine_rating", "Trate", "MW", Bound.NOT_NEGATIVE),
    HYGOV.parameters[-1],
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


def output(x, u, p, y, dx):
    """Mechanical power on the system base."""
    for i in range(x.shape[1]):
        gate, _ = lag(clip(x[DESIRED, i], p[GMIN, i], p[GMAX, i]), x[GATE, i], p[TG, i])
        power = p[AT, i] * head_at(x[FLOW, i], gate) * (x[FLOW, i] - p[QNL, i])
        y[PM, i] = p[POWER_BASE, i] * (power - p[DTURB, i] * gate * (u[OMEGA, i] - 1))


def derivative(x, u, p, y, dx):
    """Dead band, governor, gate and water column."""
    for i in range(x.shape[1]):
        desired = clip(x[DESIRED, i], p[GMIN, i], p[GMAX, i])
        seen = dead_band_between(u[OMEGA, i] - 1, p[DBL, i], p[DBH, i])
        error = p[PREF, i] - seen - p[R, i] * desired
        filtered, dx[FILTER, i] = lag(error, x[FILTER, i], p[TF, i])
        wanted = (dx[FILTER, i] + filtered / p[TR, i]) / p[TEMPORARY, i]
        rate = clip(wanted, -p[VELM, i], p[VELM, i])
        dx[DESIRED, i] = held(rate, x[DESIRED, i], p[GMIN, i], p[GMAX, i])
        gate, dx[GATE, i] = lag(desired, x[GATE, i], p[TG, i])
        dx[FLOW, i] = (1 - head_at(x[FLOW, i], gate)) / p[TW, i]


def resolve(parameters: Mapping[str, float], base_mva: float) -> Mapping[str, float]:
    """The base is the turbine's rating where that is given; the lower edge of the band is negative."""
    rating = parameters["turbine_rating"]
    return {
        **parameters,
        "dead_band_below": -abs(parameters["dead_band_below"]),
        "power_base": rating / base_mva if rating > 0 else parameters["power_base"],
    }


HYGOVD = Device(
    model="hygovd",
    title="hydro turbine and governor with a dead band HYGOVD",
    role=Role.GOVERNOR,
    parameters=PARAMETERS,
    set_points=HYGOV.set_points,
    states=HYGOV.states,
    inputs=HYGOV.inputs,
    outputs=HYGOV.outputs,
    output=output,
    derivative=derivative,
    targets=HYGOV.targets,
    guess=hygov.guess,
    resolve=resolve,
    check=checks(PARAMETERS, ordered=[("lowest_gate", "highest_gate")]),
    limits=(
        Limit("gate_velocity", Side.HIGHEST),
        *limits("lowest_gate", "highest_gate", state="desired_gate"),
    ),
    psse_record=DYR_COLUMNS,
)
