"""Tables of a case to look at, with names and units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum
from typing import TYPE_CHECKING, Any

from gridfold.dynamics.registry import DEVICES
from gridfold.errors import OptionError
from gridfold.grid.case import Branch, Case, Record
from gridfold.io.tables import suggest

if TYPE_CHECKING:
    import pandas as pd

_TABLES = ("buses", "branches", "generators", "loads", "shunts")
_DEVICES = "devices"
#: Units by the end of a column's name, and of the columns that do not end in one.
_SUFFIXES = {"_mw": "MW", "_mvar": "Mvar", "_mva": "MVA", "_kv": "kV", "_deg": "deg", "_pu": "p.u."}
_UNITS = {
    **dict.fromkeys(("resistance", "reactance", "susceptance", "ratio"), "p.u."),
    **dict.fromkeys(("from_conductance", "from_susceptance"), "p.u."),
    **dict.fromkeys(("to_conductance", "to_susceptance"), "p.u."),
    **dict.fromkeys(("source_resistance", "source_reactance"), "p.u."),
    **dict.fromkeys(("latitude", "longitude"), "deg"),
}


def case_frame(case: Case, table: str) -> pd.DataFrame:
    """See :meth:`gridfold.Case.frame`."""
    import pandas as pd

    name = table.lower()
    models = list(dict.fromkeys(record.model for record in case.devices))
    if name in _TABLES:
        rows = [_row(case, record) for record in getattr(case, name)]
        columns = list(rows[0]) if rows else []
        units = {column: unit for column in columns if (unit := _unit(column))}
    elif name == _DEVICES:
        rows = list(_parameters(case))
        columns = ["model", "bus", "id", "bus_name", "parameter", "symbol", "value", "unit"]
        units = {}
    elif name in models:
        rows = [
            {**_place(case, record), **record.parameters}
            for record in case.devices
            if record.model == name
        ]
        columns = list(dict.fromkeys(column for row in rows for column in row))
        known = _known(name)
        units = {column: known[column][1] for column in columns if column in known}
    else:
        known_tables = [*_TABLES, _DEVICES, *(model.upper() for model in models)]
        raise OptionError(
            f"case {case.name} has no table {table!r}; {suggest(table, known_tables)}"
        )
    frame = pd.DataFrame(rows, columns=columns)
    frame.attrs["units"] = units
    return frame


def _row(case: Case, record: Record) -> dict[str, Any]:
    """The fields of a record, with the names and areas of its buses behind what names it."""
    values = {name: _plain(value) for name, value in vars(record).items()}
    if isinstance(record, Branch):
        ends = {"from_name": _name(case, record.from_bus), "to_name": _name(case, record.to_bus)}
        first = {name: values.pop(name) for name in ("from_bus", "to_bus", "circuit")}
        return {**first, **ends, **values}
    if "bus" not in values:
        return values
    place = _place(case, record)
    bus = case.buses[case.bus_index[place["bus"]]]
    own = {name: values.pop(name, 0) or getattr(bus, name) for name in ("area", "zone")}
    if "owner" in values:
        own["owner"] = values.pop("owner") or bus.owner
    return {**place, **own, **values, **place}


def _place(case: Case, record: Any) -> dict[str, Any]:
    return {"bus": record.bus, "id": record.id, "bus_name": _name(case, record.bus)}


def _name(case: Case, bus: int) -> str:
    return case.buses[case.bus_index[bus]].name if bus in case.bus_index else ""


def _plain(value: Any) -> Any:
    return value.value if isinstance(value, Enum) else value


def _unit(column: str) -> str:
    ends = (unit for suffix, unit in _SUFFIXES.items() if column.endswith(suffix))
    return _UNITS.get(column) or next(ends, "")


def _known(model: str) -> Mapping[str, tuple[str, str]]:
    """Symbol and unit of each parameter of a model."""
    device = DEVICES.get(model)
    parameters = () if device is None else device.parameters
    return {parameter.name: (parameter.symbol, parameter.unit) for parameter in parameters}


def _parameters(case: Case) -> Iterator[dict[str, Any]]:
    """A row for each parameter of each device; one without a parameter has a row too."""
    for record in case.devices:
        known = _known(record.model)
        place = {"model": record.model.upper(), **_place(case, record)}
        for name, value in record.parameters.items():
            symbol, unit = known.get(name, ("", ""))
            yield {**place, "parameter": name, "symbol": symbol, "value": value, "unit": unit}
        if not record.parameters:
            yield {**place, "parameter": "", "symbol": "", "value": None, "unit": ""}
