"""WTARA1 of PSS/E: aerodynamics of a wind turbine at constant wind, by the pitch of its blades.

PSS/E Model Library, WTARA1; WECC REMTF, WTGAR_A: Pm = Pm0 - Ka theta (theta - theta0), with the pitch
theta in degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Values

KA, THETA0, PM0, BASE_SPEED = range(4)
THETA = 0
PM, START = range(2)

PARAMETERS = (
    Parameter("aerodynamic_gain", "Ka", "p.u./deg", Bound.NOT_NEGATIVE),
    Parameter("starting_pitch", "Theta0", "deg", Bound.ANY),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS)


def output(x, u, p, y, dx):
    """Power of the wind in per unit of the converter's rating."""
    for i in range(p.shape[1]):
        off = u[THETA, i] - p[THETA0, i]
        y[PM, i] = p[PM0, i] - p[KA, i] * u[THETA, i] * off
        y[START, i] = off


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """The given pitch."""
    return {"wind_power": known["aerodynamic_power"], "pitch_angle": p["starting_pitch"]}


WTARA1 = Device(
    model="wtara1",
    title="wind turbine aerodynamics WTARA1",
    role=Role.AERODYNAMICS,
    parameters=PARAMETERS,
    set_points=("wind_power",),
    states=(),
    inputs=("pitch_angle",),
    outputs=("aerodynamic_power", "aerodynamics_start"),
    output=output,
    targets=("aerodynamic_power", "aerodynamics_start"),
    solved_inputs=("pitch_angle",),
    defaults={"aerodynamics_start": 0.0},
    guess=guess,
    psse_names=("WTARA1", "WTARAU1"),
    psse_record=DYR_COLUMNS,
)
