"""GENCLS of PSS/E: the classical machine, a voltage of constant magnitude behind ZSORCE.

PSS/E Model Library, GENCLS; Kundur, Power System Stability and Control, 1994, section 13.1. The
dynamics record has H and D alone; the impedance ZR + j ZX is that of the generator in the power-flow
file. The kernels are those of the classical machine: its swing equation is 2 H dw/dt = Pm - Pe - D dw,
which damps less than that of GENROU, by about Pm per unit of speed deviation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values
from gridfold.dynamics.machines import classical

#: Numbers of the dynamics record.
DYR_COLUMNS: tuple[str | None, ...] = ("inertia", "damping")


def _as_classical(p: Values) -> Values:
    return {**p, "transient_reactance": p["reactance"]}


def admittance(p: Values) -> NDArray[np.complex128]:
    """1 / (ZR + j ZX)."""
    return classical.admittance(_as_classical(p))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Internal voltage V + (ZR + j ZX) I."""
    return classical.guess(_as_classical(p), known)


def check(parameters: Mapping[str, float]) -> Iterable[str]:
    """A GENCLS without inertia is an infinite bus, which is another model here."""
    if parameters["inertia"] == 0:
        yield "inertia (H) is 0, which makes GENCLS an infinite bus: use the model infinite_bus for it"


GENCLS = Device(
    model="gencls",
    title="PSS/E classical machine GENCLS",
    role=Role.MACHINE,
    parameters=(
        Parameter("inertia", "H", "s", Bound.NOT_NEGATIVE, Scaling.POWER),
        Parameter("damping", "D", "p.u.", Bound.NOT_NEGATIVE, Scaling.POWER),
        Parameter("resistance", "ZR", "p.u.", Bound.NOT_NEGATIVE, Scaling.IMPEDANCE, default=0.0),
        Parameter("reactance", "ZX", "p.u.", scaling=Scaling.IMPEDANCE),
    ),
    set_points=classical.CLASSICAL.set_points,
    states=classical.CLASSICAL.states,
    inputs=classical.CLASSICAL.inputs,
    sources=classical.CLASSICAL.sources,
    outputs=classical.CLASSICAL.outputs,
    source=classical.source,
    output=classical.output,
    derivative=classical.derivative,
    admittance=admittance,
    targets=classical.CLASSICAL.targets,
    solved_inputs=classical.CLASSICAL.solved_inputs,
    guess=guess,
    check=check,
    psse_record=DYR_COLUMNS,
)
