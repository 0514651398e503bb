"""Small grids, a unit and an infinite bus each, that hold devices of every role."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cases import one_machine_infinite_bus
from converter_cases import TURBINE, converter_case
from device_alone import machine_with, named

import gridfold as gf
from gridfold.dynamics.registry import DEVICES
from gridfold.runs.trial_case import trial_case, trial_values

SEXS = (0.1, 10.0, 100.0, 0.05, -3.0, 6.0)
MNLEX2 = (0.1, 1.0, 0.3, 0.5, 0.1, 2.5, 3.0)
MAXEX2 = (1, 2.0, 1.05, 20.0, 1.2, 5.0, 1.5, 2.0, 1.0, 0.02, -0.1)
CIM5 = (
    1, 0.02, 0.08, 3.0, 0.02, 0.1, 0.05, 0.06, 1.0, 0.0, 1.2, 0.0, 0.0, 1.3, 0.6, 0.0, 0.0, 0.0, 2.0,
    None,
)  # fmt: skip


def limited() -> gf.DetailedModel:
    """An exciter between a compensator and two limiters."""
    records = {"sexs": SEXS, "mnlex2": MNLEX2, "maxex2": MAXEX2, "ieeevc": (0.01, -0.05)}
    return gf.build_model(machine_with({m: named(m, row) for m, row in records.items()}))


def motor() -> gf.DetailedModel:
    """An induction motor beside the machine."""
    case = one_machine_infinite_bus()
    record = gf.DeviceRecord("cim5", 1, "load-1", named("cim5", CIM5))
    load = gf.Load(1, "1", active_mw=40.0, reactive_mvar=15.0)
    return gf.build_model(replace(case, loads=(load,), devices=(*case.devices, record)))


def tried(model: str) -> Callable[[], gf.DetailedModel]:
    """A device with values of a usual size, and what it needs."""
    return lambda: gf.build_model(trial_case(DEVICES[model], trial_values(DEVICES[model], {})))


FAMILIES: dict[str, Callable[[], gf.DetailedModel]] = {
    "machine": tried("classical"),
    "exciter": tried("exst1"),
    "governor": tried("hygov"),
    "stabilizer": tried("ieeest"),
    "turbine": tried("non_reheat_turbine"),
    "limiters": limited,
    "motor": motor,
    "wind turbine": lambda: gf.build_model(converter_case(TURBINE)),
    "distributed converters": lambda: gf.build_model(converter_case(("dera1",))),
}
