"""Criteria as text: the ``[[criteria]]`` tables of study files, and TOML files of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args, get_type_hints

from gridfold.errors import GridfoldError, OptionError
from gridfold.grid.criteria import CRITERIA, PRESETS, Criterion
from gridfold.io.event_records import read_tables
from gridfold.io.kind_records import from_mapping, kind_record, unquoted, words_of
from gridfold.io.tables import suggest


def criterion_from_record(record: Mapping[str, Any], where: str = "criterion") -> Criterion:
    """Build a criterion from a mapping such as ``{"kind": "damping", "percent": 3}``.

    ``{"preset": NAME}`` takes one of :data:`PRESETS`; what else stands there replaces its fields.

    Raises
    ------
    OptionError
        The kind, the preset, a field or its value makes no sense; `where` is named.
    """
    try:
        criterion: Criterion = from_mapping(CRITERIA, _with_preset(record), where)
    except GridfoldError as error:
        text = str(error)
        raise OptionError(text if text.startswith(where) else f"{where}: {text}") from None
    return criterion


def criteria_of(records: Sequence[Mapping[str, Any]], where: str = "") -> tuple[Criterion, ...]:
    """Criteria from mappings.

    Raises
    ------
    OptionError
        Names every one that is wrong.
    """
    criteria, faults = [], []
    for number, record in enumerate(records, start=1):
        try:
            criteria.append(criterion_from_record(record, f"{where}criterion {number}"))
        except OptionError as error:
            faults.append(str(error))
    if faults:
        raise OptionError("\n".join(faults))
    return tuple(criteria)


def parse_criterion(text: str) -> Criterion:
    """Build a criterion from the name of a preset, or from ``kind name=value ...``.

    For example ``damping at least 3 %``, or ``voltage-recovery level=0.9 within=1``.

    Raises
    ------
    OptionError
        The text makes no sense.
    """
    where = f"criterion {text!r}"
    if (preset := " ".join(text.lower().replace("hz", "Hz").split())) in PRESETS:
        return PRESETS[preset]
    kind, *words = words_of(text) or [""]
    if not any("=" in word for word in words) and (words or kind not in CRITERIA):
        raise OptionError(f"{where}: no such preset or kind; {_nearest(text)}")
    record: dict[str, Any] = {"kind": kind}
    for word in words:
        name, sign, value = word.partition("=")
        if not (sign and name and value) or name in record:
            raise OptionError(f"{where}: {word!r} is not of the form name=value, each name once")
        record[name] = unquoted(value)
    return criterion_from_record(record, where)


def _nearest(text: str) -> str:
    """A hint at the preset that a text is like, and at how it is written with other numbers."""
    hint = suggest(text, [*PRESETS, *CRITERIA])
    alike = [preset for name, preset in PRESETS.items() if repr(name) in hint]
    if not alike:
        return hint
    record = kind_record(CRITERIA, alike[0])
    defaults = {item.name: item.default for item in fields(alike[0])}
    values = [
        f"{name}={value:g}"
        for name, value in record.items()
        if name != "kind" and value != defaults[name]
    ]
    return f"{hint} With other numbers: {record['kind']} {' '.join(values)}"


def load_criteria(path: str | Path) -> tuple[Criterion, ...]:
    """Criteria from a TOML file of ``[[criteria]]`` tables, each with its ``kind`` or ``preset``.

    Raises
    ------
    GridfoldError
        The file cannot be read, or a table is wrong: all that are.
    """
    return criteria_of(read_tables(path, "criteria"), f"{path}: ")


def criterion_schema() -> dict[str, Any]:
    """JSON Schema of a table of a criterion: the fields of all kinds."""
    types = {float: "number", bool: "boolean", str: "string"}
    properties: dict[str, Any] = {
        "kind": {"enum": list(CRITERIA)},
        "preset": {"enum": list(PRESETS)},
    }
    for kind in CRITERIA.values():
        for name, hint in get_type_hints(kind).items():
            plain = next(t for t in (*get_args(hint), hint) if t in types)
            properties[name] = {"type": types[plain]}
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _with_preset(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record with the fields of the preset that it names."""
    given = dict(record)
    if "preset" not in given:
        if "kind" not in given:
            raise OptionError(f"kind or preset is missing; known kinds: {', '.join(CRITERIA)}")
        return given
    preset = given.pop("preset")
    if "kind" in given:
        raise OptionError("give kind or preset, not both")
    if not isinstance(preset, str) or preset not in PRESETS:
        raise OptionError(f"unknown preset {preset!r}; {suggest(str(preset), list(PRESETS))}")
    return kind_record(CRITERIA, PRESETS[preset]) | given
