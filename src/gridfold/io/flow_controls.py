"""Set points, limits and switched shunts of powerio's tables."""

from __future__ import annotations

from collections.abc import Mapping

from gridfold.grid.flow_controls import ShuntControl, ShuntMode, UnitControl
from gridfold.io.case_draft import Row
from gridfold.io.raw_fields import as_number

_MODES = {mode.value: mode for mode in ShuntMode}
_NO_LIMIT = 9999.0  # Mvar, as PSS/E writes it


def bus_number(text: str) -> int:
    """A bus number as it stands in a record; 0 where it is none."""
    value = as_number(text)
    return int(value) if value is not None and value.is_integer() else 0


def unit_control(row: Row, bus: int, identifier: str, own: Mapping[str, str]) -> UnitControl:
    """Control of a generator; `own` are the properties that powerio keeps beside its row."""
    return UnitControl(
        bus,
        identifier,
        float(row["vg"]),
        int(row.get("regulated_bus") or bus),
        _limit(row["qmin"], -_NO_LIMIT),
        _limit(row["qmax"], _NO_LIMIT),
        float(own.get("psse_rmpct", 100.0)) or 100.0,
    )


def shunt_control(row: Row, identifier: str) -> ShuntControl:
    """Control of a switched shunt."""
    control = row["control"]
    mode = _MODES.get(control["mode"], ShuntMode.OTHER)
    if row["extras"].get("psse_modsw"):  # the modes that follow something else than a voltage
        mode = ShuntMode.OTHER
    return ShuntControl(
        row["bus"],
        identifier,
        mode,
        float(control["vlow"]),
        float(control["vhigh"]),
        int(control.get("control_bus") or row["bus"]),
        tuple((int(block["steps"]), float(block["b"])) for block in control["blocks"]),
    )


def _limit(value: object, usual: float) -> float:
    return usual if value is None else float(str(value))
