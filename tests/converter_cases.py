"""A converter with its controls at an infinite bus, and their usual records."""

from __future__ import annotations

from dataclasses import replace

from cases import one_machine_infinite_bus
from device_alone import named

import gridfold as gf

RECORDS = {
    "regca1": (1, 0.02, 10.0, 0.9, 0.4, 1.22, 1.2, 0.9, 0.5, -1.3, 0.02, 0.7, 100.0, -100.0, 0.7),
    "reecb1": (
        0, 0, 1, 1, 0, -99.0, 99.0, 0.02, -0.01, 0.02, 2.0, 1.1, -1.1, 0.0, 0.05, 0.44, -0.44, 1.1,
        0.9, 0.3, 2.0, 3.0, 20.0, 0.03, 99.0, -99.0, 1.0, 0.0, 1.11, 0.04,
    ),
    "reeca1": (
        0, 0, 1, 1, 0, 0, 0.85, 1.15, 0.02, -0.01, 0.02, 2.0, 1.1, -1.1, 0.0, 0.1, 0.2, 0.3, 0.05,
        0.44, -0.44, 1.1, 0.9, 0.3, 2.0, 3.0, 20.0, 0.0, 0.03, 99.0, -99.0, 1.0, 0.0, 1.3, 0.04,
        0.2, 0.75, 0.5, 1.0, 0.9, 1.1, 1.1, 1.2, 0.2, 0.5, 0.5, 0.9, 0.75, 1.1, 1.0, 1.2,
    ),
    "repca1": (
        0, 0, 0, 0, 0, 1, 1, 0.02, 2.0, 5.0, 0.1, 0.5, 0.7, 0.0, 0.0, 0.02, 0.1, -0.1, 0.0, 0.0,
        0.43, -0.43, 1.0, 0.5, 0.25, 0.0, 0.0, 99.0, -99.0, 1.0, 0.0, 0.1, 20.0, 5.0,
    ),
    "dera1": (
        0, 1, 0, 1, 1, 1, 0.02, 0.03, -0.05, 0.04, 5.0, 0.0, 0.05, 0.04, 20.0, 10.0, -0.0006, 0.0007,
        0.5, -0.5, 1.0, 0.0, 0.5, -0.4, 0.06, 0.1, 10.0, 1.2, 0.44, 0.49, 1.2, 1.15, 0.16, 0.3, 0.16,
        0.4, 0.6, 56.5, 62.0, 0.16, 0.2, 0.025, 2.0, 0.01, 0.3, 1.0, -1.0,
    ),
    "wtdta1": (5.0, 0.5, 0.9, 1.8, 1.5),
    "wttqa1": (0, 3.0, 0.6, 0.05, 30.0, 1.2, 0.08, 0.2, 0.69, 0.4, 0.78, 0.6, 0.98, 0.9, 1.2, 0.0),
    "wtpta1": (5.0, 150.0, 30.0, 3.0, 0.1, 0.3, 27.0, 0.0, 10.0, -10.0),
    "wtara1": (0.007, 3.0),
}  # fmt: skip
PLANT = ("regca1", "reecb1", "repca1")
TURBINE = ("regca1", "reeca1", "repca1", "wtdta1", "wttqa1", "wtpta1", "wtara1")


def converter_case(
    models: tuple[str, ...], base: float = 100.0, **changes: dict[str, float]
) -> gf.Case:
    """A converter of 100 MVA, or of another base, that gives 80 MW, at an infinite bus."""
    case = one_machine_infinite_bus(base_mva=base)
    own = (
        gf.DeviceRecord(model, 1, "1", named(model, RECORDS[model], **changes.get(model, {})))
        for model in models
    )
    grid = gf.DeviceRecord("infinite_bus", 2, "1", {"reactance": 0.1})
    return replace(case, devices=(grid, *own))
