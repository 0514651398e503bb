"""Cases in gridfold's own format: a folder of CSV tables and a ``case.toml``.

``case.toml`` may say ``extends = "..."`` (a built-in case or a folder): the rows of this folder then
replace those of the base case that have the same key, and add to the rest.
"""

from __future__ import annotations

import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gridfold.errors import CaseFileError
from gridfold.grid.case import Branch, Bus, Case, DeviceRecord, Generator, Load, Shunt
from gridfold.grid.dc_lines import ThyristorLine, TransistorLine
from gridfold.grid.flow_controls import ShuntControl, UnitControl
from gridfold.grid.replacement import Replacement
from gridfold.grid.validation import require_valid
from gridfold.io.plain_records import record_of
from gridfold.io.rapid_mat import read_rapid
from gridfold.io.tables import (
    Table,
    parse_row,
    read_records,
    read_table,
    read_toml,
    suggest,
)

_BUILT_IN = Path(__file__).resolve().parent.parent / "cases"
#: Tables of the network, and the records in them.
TABLES: Mapping[str, type] = {
    "buses": Bus,
    "branches": Branch,
    "generators": Generator,
    "loads": Load,
    "shunts": Shunt,
}
#: Records that stand in ``case.toml``, by kind.
RECORDS: Mapping[str, Mapping[str, type]] = {
    "replacements": {"replacement": Replacement},
    "dc_lines": {"thyristors": ThyristorLine, "transistors": TransistorLine},
    "flow_controls": {"unit": UnitControl, "shunt": ShuntControl},
}
_SETTINGS: dict[str, tuple[type, ...]] = {
    "name": (str,),
    "description": (str,),
    "extends": (str,),
    "base_mva": (int, float),
    "frequency_hz": (int, float),
    "area_names": (dict,),
    "zone_names": (dict,),
    "owner_names": (dict,),
    "unsupported": (list,),
    "unplaced": (list,),
    "notices": (list,),
    "replacements": (list,),
    "dc_lines": (list,),
    "flow_controls": (list,),
}
_DEPTH_LIMIT = 8


def built_in_cases() -> list[str]:
    """Names of the cases that come with gridfold."""
    return sorted(folder.parent.name for folder in _BUILT_IN.glob("*/case.toml"))


def read_case(source: str | Path) -> Case:
    """Read a case by the name of a built-in one, from a folder or from a MATLAB file of RAPID.

    Parameters
    ----------
    source : str or Path
        ``"npcc"``, ``"npcc-pst"``, a folder with ``case.toml`` and CSV tables, or a file with the
        suffix ``.mat`` (:mod:`gridfold.io.rapid_mat`).

    Raises
    ------
    CaseFileError
        A file is missing or cannot be read; names file and line.
    CaseError
        The data are wrong; lists every fault.
    """
    if str(source).lower().endswith(".mat") and not Path(source).is_dir():
        return read_rapid(source)
    case = _read_case(_resolve(str(source), Path.cwd(), str(source)), depth=0)
    require_valid(case)
    return case


def case_files(source: str | Path) -> tuple[Path, ...]:
    """The files that :func:`read_case` reads, with those of cases that are extended; none if built in.

    Raises
    ------
    CaseFileError
        There is no such case.
    """
    if Path(source).suffix and not Path(source).is_dir():
        return (Path(source),)
    return tuple(_files(_resolve(str(source), Path.cwd(), str(source)), depth=0))


def _files(folder: Path, depth: int) -> list[Path]:
    if depth > _DEPTH_LIMIT or folder.parent == _BUILT_IN:
        return []
    settings = _read_settings(folder / "case.toml")
    tables = [folder / f"{name}.csv" for name in TABLES]
    files = [folder / "case.toml", *(path for path in tables if path.is_file())]
    files += sorted((folder / "devices").glob("*.csv"))
    if "extends" in settings:
        base = _resolve(settings["extends"], folder, str(folder / "case.toml"))
        files += _files(base, depth + 1)
    return files


def _resolve(source: str, base: Path, where: str) -> Path:
    if source in built_in_cases():
        return _BUILT_IN / source
    try:
        folder = base / Path(source).expanduser()
        if (folder / "case.toml").is_file():
            return folder
        if folder.is_dir():
            raise CaseFileError(f"{folder} has no case.toml", where)
    except (OSError, RuntimeError) as error:  # name too long, no such user ...
        raise CaseFileError(f"{source!r} cannot be read: {error}", where) from None
    built_in = ", ".join(built_in_cases())
    raise CaseFileError(
        f"{source!r} is neither a built-in case ({built_in}) nor a folder, nor a file with the suffix "
        ".raw, .m or .mat",
        where,
    )


def _read_case(folder: Path, depth: int) -> Case:
    settings = _read_settings(folder / "case.toml")
    if depth > _DEPTH_LIMIT:
        raise CaseFileError("cases extend one another in a circle", str(folder))
    base = Case(name=folder.name, buses=(), branches=(), generators=())
    if "extends" in settings:
        parent = _resolve(settings.pop("extends"), folder, str(folder / "case.toml"))
        base = replace(_read_case(parent, depth + 1), name=folder.name)
    faults = [
        f"{path}: unknown table; {suggest(path.stem, list(TABLES))}"
        for path in sorted(folder.glob("*.csv"))
        if path.stem not in TABLES
    ]
    origins = dict(base.origins)
    for name, record_type in TABLES.items():
        path = folder / f"{name}.csv"
        if path.is_file():
            records, found = _read_records(path, record_type, origins)
            faults += found
            settings[name] = _merge(getattr(base, name), records)
    devices = list(base.devices)
    for path in sorted((folder / "devices").glob("*.csv")):
        records, found = _read_devices(path, origins)
        faults += found
        devices = list(_merge(tuple(devices), records))
    if faults:
        raise CaseFileError(faults, str(folder))
    return replace(base, devices=tuple(devices), origins=origins, **settings)


def _read_settings(path: Path) -> dict[str, Any]:
    settings = read_toml(path)
    faults = []
    for name, value in settings.items():
        if name not in _SETTINGS:
            faults.append(f"unknown setting {name!r}; {suggest(name, list(_SETTINGS))}")
        elif not isinstance(value, _SETTINGS[name]) or isinstance(value, bool):
            faults.append(f"{name}: {value!r} has the wrong type")
    for key, converted in _CONVERTED.items():
        if isinstance(settings.get(key), _SETTINGS[key]):
            try:
                settings[key] = converted(settings[key])
            except (AttributeError, KeyError, TypeError, ValueError) as error:
                faults.append(f"{key}: {error}")
    if faults:
        raise CaseFileError(faults, str(path))
    return settings


def _names(table: Mapping[str, Any]) -> dict[int, str]:
    return {int(number): str(name) for number, name in table.items()}


def _texts(values: Sequence[Any]) -> tuple[str, ...]:
    if strange := [value for value in values if not isinstance(value, str)]:
        raise TypeError(f"{strange[0]!r} is no text")
    return tuple(values)


def _records(kinds: Mapping[str, type]) -> Callable[[Sequence[Mapping[str, Any]]], tuple[Any, ...]]:
    return lambda tables: tuple(record_of(kinds, table) for table in tables)


_CONVERTED: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("area_names", "zone_names", "owner_names"), _names),
    **dict.fromkeys(("unsupported", "unplaced", "notices"), _texts),
    **{name: _records(kinds) for name, kinds in RECORDS.items()},
}


def _merge(base: tuple[Any, ...], records: list[Any]) -> tuple[Any, ...]:
    """Rows of `base` with those replaced that stand in `records` too, then the new ones."""
    replaced = {str(record): record for record in records}
    old = {str(record) for record in base}
    kept = tuple(replaced.get(str(record), record) for record in base)
    return kept + tuple(record for record in records if str(record) not in old)


def _read_records(
    path: Path, record_type: type, origins: dict[str, str]
) -> tuple[list[Any], list[str]]:
    table = read_table(path)
    records = read_records(table, record_type, typing.get_type_hints(record_type))
    _note_origins(table, records, origins)
    return [record for _, record in records], table.faults


def _read_devices(path: Path, origins: dict[str, str]) -> tuple[list[Any], list[str]]:
    table = read_table(path)
    for name in ("bus", "id"):
        if table.columns and name not in table.columns:
            table.fault(table.header_line, f"column {name!r} is missing")
    records = []
    kinds: dict[str, Any] = dict.fromkeys(table.columns, float) | {"bus": int, "id": str}
    for line, cells in table.rows if not table.faults else []:
        values = parse_row(table, line, cells, kinds, ("bus", "id"))
        if values is not None:
            bus, unit_id = values.pop("bus"), values.pop("id")
            records.append((line, DeviceRecord(path.stem, bus, unit_id, values)))
    _note_origins(table, records, origins)
    return [record for _, record in records], table.faults


def _note_origins(table: Table, records: list[tuple[int, Any]], origins: dict[str, str]) -> None:
    """Remember where each record stands; one that stands there twice is a fault."""
    place = table.path.name
    if table.path.parent.name == "devices":
        place = f"devices/{place}"
    lines: dict[str, int] = {}
    for line, record in records:
        first = lines.setdefault(str(record), line)
        if first != line:
            table.fault(line, f"{record} is given at line {first} already")
        origins[str(record)] = f"{place}:{line}"
