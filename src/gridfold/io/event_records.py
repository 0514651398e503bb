"""Events as text: TOML files, ``kind name=value ...`` on the command line, records in metadata."""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any

from gridfold.errors import CaseFileError, EventError
from gridfold.grid.events import EVENTS, Event
from gridfold.io.tables import parse_cell, read_toml, suggest


def event_record(event: Event) -> dict[str, Any]:
    """An event as a flat mapping with its ``kind``; :func:`event_from_record` reads it back."""
    kinds = {event_type: kind for kind, event_type in EVENTS.items()}
    return {"kind": kinds[type(event)], **asdict(event)}  # type: ignore[call-overload]


def event_from_record(record: Mapping[str, Any], where: str = "event") -> Event:
    """Build an event from a mapping such as ``{"kind": "bus-fault", "bus": 3}``."""
    values = dict(record)
    kind = values.pop("kind", None)
    if kind is None:
        raise EventError(f"{where}: kind is missing; known: {', '.join(EVENTS)}")
    if not isinstance(kind, str) or kind not in EVENTS:
        raise EventError(f"{where}: unknown kind {kind!r}; {suggest(str(kind), list(EVENTS))}")
    event_type = EVENTS[kind]
    hints = typing.get_type_hints(event_type)
    names = [item.name for item in fields(event_type)]
    arguments = {}
    for name, value in values.items():
        if name not in names:
            raise EventError(f"{where}: {kind} has no {name!r}; {suggest(name, names)}")
        arguments[name] = _convert(value, hints[name], f"{where}: {name}")
    for item in fields(event_type):
        if item.default is MISSING and item.name not in arguments:
            raise EventError(f"{where}: {kind} needs {item.name}")
    event: Event = event_type(**arguments)
    return event


def parse_event(text: str) -> Event:
    """Build an event from ``kind name=value ...``, for example ``bus-fault bus=3 duration=0.1``."""
    where = f"event {text!r}"
    words = text.split()
    if not words:
        raise EventError(f"{where}: it is empty; known kinds: {', '.join(EVENTS)}")
    record: dict[str, Any] = {"kind": words[0]}
    for word in words[1:]:
        name, sign, value = word.partition("=")
        if not sign or not name or not value:
            raise EventError(f"{where}: {word!r} is not of the form name=value")
        if name in record:
            raise EventError(f"{where}: {name} is given twice")
        record[name] = value
    return event_from_record(record, where)


def load_events(path: str | Path) -> list[Event]:
    """Events from a TOML file of ``[[event]]`` tables, each with its ``kind``."""
    try:
        data = read_toml(Path(path))
    except CaseFileError as error:
        raise EventError(f"{path}: {error.faults[0]}") from None
    unknown = [name for name in data if name != "event"]
    records = data.get("event")
    tables = isinstance(records, list) and all(isinstance(record, dict) for record in records)
    if unknown or not tables or not records:
        raise EventError(f"{path}: expected [[event]] tables and nothing else")
    return [
        event_from_record(record, f"{path}: event {number}")
        for number, record in enumerate(records, start=1)
    ]


def _convert(value: Any, kind: Any, where: str) -> Any:
    """Convert a TOML or text value to the type of a field."""
    if isinstance(value, bool) != (kind is bool) and not isinstance(value, str):
        raise EventError(f"{where}: {value!r} has the wrong type")
    text = str(value).lower() if isinstance(value, bool) else str(value)
    try:
        return parse_cell(text, kind)
    except ValueError as error:
        raise EventError(f"{where}: {error}") from None
