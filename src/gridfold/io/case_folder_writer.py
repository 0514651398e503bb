"""Write a case as a folder of tables, which :mod:`gridfold.io.case_folder` reads."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from enum import Enum
from pathlib import Path
from typing import Any

from gridfold.errors import OutputError
from gridfold.grid.case import Case, DeviceRecord, Record
from gridfold.io.case_folder import RECORDS, TABLES
from gridfold.io.lost import Lost
from gridfold.io.plain_records import plain_table
from gridfold.io.results import csv_line

_SETTINGS = "case.toml"
_DEVICES = "devices"
_PLAIN = ("name", "description", "base_mva", "frequency_hz")
_LISTS = ("unsupported", "unplaced", "notices")
_NAMES = ("area_names", "zone_names", "owner_names")


def write_case_folder(case: Case, folder: Path, overwrite: bool = False) -> tuple[str, ...]:
    """Write a case; what texts the tables cannot hold is returned, in words.

    Parameters
    ----------
    case : Case
        The case.
    folder : Path
        A new folder; with `overwrite` also one with a case, whose tables are replaced.
    overwrite : bool
        Whether that is allowed.

    Raises
    ------
    OutputError
        The folder is there already, or cannot be written.
    """
    lost = Lost()
    files = {_SETTINGS: _settings(case)}
    files |= {f"{name}.csv": _table(getattr(case, name), lost) for name in TABLES}
    for model in dict.fromkeys(record.model for record in case.devices):
        records = [record for record in case.devices if record.model == model]
        files[f"{_DEVICES}/{model}.csv"] = _device_table(records)
    _refuse(folder, overwrite)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as temporary:
            new = Path(temporary) / folder.name
            for name, text in files.items():
                if text:
                    (new / name).parent.mkdir(parents=True, exist_ok=True)
                    (new / name).write_text(text, encoding="utf-8", newline="\n")
            _move(new, folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return lost.lines


def _refuse(folder: Path, overwrite: bool) -> None:
    if not folder.name:
        raise OutputError(f"{folder}: cannot be written: this is no name of a folder")
    if folder.is_dir() and not any(folder.iterdir()):
        return
    if folder.exists() and not overwrite:
        raise OutputError(f"{folder}: exists already; nothing was written")
    if folder.exists() and not (folder / _SETTINGS).is_file():
        raise OutputError(f"{folder}: is no folder of a case; nothing was written")


def _move(new: Path, folder: Path) -> None:
    """Put the tables in their place; those of an older case go, other files stay."""
    folder.mkdir(exist_ok=True)
    old = [folder / _SETTINGS, *(folder / f"{name}.csv" for name in TABLES)]
    for path in (*old, *(folder / _DEVICES).glob("*.csv")):
        path.unlink(missing_ok=True)
    for path in new.rglob("*.*"):
        target = folder / path.relative_to(new)
        target.parent.mkdir(exist_ok=True)
        shutil.move(path, target)


def _settings(case: Case) -> str:
    """``case.toml``: with it what became of the files that the case was read from."""
    lines = [f"{name} = {_toml(getattr(case, name))}" for name in _PLAIN]
    for name in _LISTS:
        if values := getattr(case, name):
            lines += [f"{name} = [", *(f"  {_toml(value)}," for value in values), "]"]
    for name, kinds in RECORDS.items():
        if records := getattr(case, name):
            tables = (_toml(plain_table(kinds, record)) for record in records)
            lines += [f"{name} = [", *(f"  {table}," for table in tables), "]"]
    for name in _NAMES:
        if names := getattr(case, name):
            lines += ["", f"[{name}]", *(f"{number} = {_toml(v)}" for number, v in names.items())]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{name} = {_toml(item)}' for name, item in value.items())} }}"
    return str(value)


def _table(records: Sequence[Record], lost: Lost) -> str:
    """Columns that are needed or not at their default everywhere."""
    if not records:
        return ""
    columns = [
        item.name
        for item in fields(records[0])
        if item.default is MISSING or any(getattr(r, item.name) != item.default for r in records)
    ]
    rows = ([_cell(getattr(r, name), r, lost) for name in columns] for r in records)
    return _csv(columns, rows)


def _device_table(records: Sequence[DeviceRecord]) -> str:
    names = list(dict.fromkeys(name for record in records for name in record.parameters))
    rows = ([r.bus, r.id, *(_parameter(r.parameters, name) for name in names)] for r in records)
    return _csv(["bus", "id", *names], rows)


def _parameter(parameters: Mapping[str, float], name: str) -> str:
    return repr(float(parameters[name])) if name in parameters else ""


def _cell(value: Any, record: Record, lost: Lost) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, str):
        return _text(value, record, lost)
    return repr(float(value)) if isinstance(value, float) else str(value)


def _text(text: str, record: Record, lost: Lost) -> str:
    """A text as a table holds it: without blanks around it and breaks within."""
    held = " ".join(text.strip().splitlines())
    if held != text:
        lost.add("blanks around names, and line breaks in them", record)
    return held


def _csv(columns: Sequence[str], rows: Iterable[Iterable[Any]]) -> str:
    return csv_line(columns) + "".join(csv_line(map(str, row)) for row in rows)
