"""WTDTA1 of PSS/E: drive train of a wind turbine, of two masses or one.

PSS/E Model Library, WTDTA1; WECC REMTF, WTGT_A. In per unit of the converter's rating,

    2 Ht wt' = Pm / wt - T,    2 Hg wg' = T - P / wg - DAMP (wg - w0),    T = s + Dshaft (wt - wg)
    s'       = K (wt - wg),    K = (2 pi Freq1)^2 2 Ht 2 Hg / (2 Ht + 2 Hg)

with Ht = Htfrac H and Hg = H - Ht, so that both masses swing at Freq1 (Hz) against each other. Htfrac
= 0 or Freq1 = 0 make one mass of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numba import njit

from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values

H, DAMP, HTFRAC, FREQ1, DSHAFT, POWER_BASE, W0, BASE_SPEED = range(8)
TURBINE, GENERATOR, SHAFT = range(3)
PM, PE = range(2)
START = 0

PARAMETERS = (
    Parameter("inertia_of_turbine", "H", "s"),
    Parameter("damping", "DAMP", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("turbine_share", "Htfrac", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("shaft_frequency", "Freq1", "Hz", Bound.NOT_NEGATIVE),
    Parameter("shaft_damping", "Dshaft", "p.u.", Bound.NOT_NEGATIVE),
    Parameter("power_base", "MBASE/SBASE", "p.u.", scaling=Scaling.POWER, default=1.0),
)
DYR_COLUMNS: tuple[str | None, ...] = tuple(p.name for p in PARAMETERS[:-1])


@njit
def is_one_mass(p, i):
    """Whether turbine and generator of unit `i` turn together."""
    return p[HTFRAC, i].real == 0 or p[FREQ1, i].real == 0


def output(x, u, p, y, dx):
    """What is zero at the start: the generator is at the speed that nothing damps."""
    for i in range(x.shape[1]):
        y[START, i] = x[GENERATOR, i] - p[W0, i]


def derivative(x, u, p, y, dx):
    """Both speeds, and the torque of the shaft."""
    for i in range(x.shape[1]):
        turbine, generator = x[TURBINE, i], x[GENERATOR, i]
        load = u[PE, i] / p[POWER_BASE, i] / generator + p[DAMP, i] * (generator - p[W0, i])
        if is_one_mass(p, i):
            rate = (u[PM, i] / generator - load) / (2 * p[H, i])
            dx[GENERATOR, i], dx[TURBINE, i] = rate, rate + generator - turbine
            dx[SHAFT, i] = u[PM, i] / generator - x[SHAFT, i]
            continue
        own, other = 2 * p[H, i] * p[HTFRAC, i], 2 * p[H, i] * (1 - p[HTFRAC, i])
        stiffness = (2 * np.pi * p[FREQ1, i]) ** 2 * own * other / (own + other)
        torque = x[SHAFT, i] + p[DSHAFT, i] * (turbine - generator)
        dx[TURBINE, i] = (u[PM, i] / turbine - torque) / own
        dx[GENERATOR, i] = (torque - load) / other
        dx[SHAFT, i] = stiffness * (turbine - generator)


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Both masses turn at the generator's speed."""
    power, speed = known["active_power"] / p["power_base"], known["generator_speed"]
    return {
        "turbine_speed": speed,
        "generator_speed": speed,
        "shaft_torque": power / speed,
        "starting_speed": speed,
        "aerodynamic_power": power,
    }


def share(parameters: Mapping[str, float]) -> Iterable[str]:
    """A turbine that leaves the generator some inertia."""
    if parameters["turbine_share"] >= 1:
        yield f"turbine_share Htfrac is {parameters['turbine_share']:g}, not below 1"


WTDTA1 = Device(
    model="wtdta1",
    title="wind turbine drive train WTDTA1",
    role=Role.DRIVE_TRAIN,
    parameters=PARAMETERS,
    set_points=("starting_speed",),
    states=("turbine_speed", "generator_speed", "shaft_torque"),
    inputs=("aerodynamic_power", "active_power"),
    outputs=("drive_train_start",),
    output=output,
    derivative=derivative,
    targets=("generator_speed", "drive_train_start"),
    solved_inputs=("aerodynamic_power",),
    defaults={"generator_speed": 1.0, "drive_train_start": 0.0},
    guess=guess,
    check=checks(PARAMETERS, more=[share]),
    psse_names=("WTDTA1", "WTDTAU1"),
    psse_record=DYR_COLUMNS,
)
