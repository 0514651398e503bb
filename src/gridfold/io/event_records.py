"""Events as text: TOML files, ``kind name=value ...`` on the command line, records in metadata.

Relays are read likewise, from TOML files of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gridfold.errors import CaseFileError, EventError
from gridfold.grid.events import EVENTS, Event
from gridfold.grid.relays import RELAYS, Relay
from gridfold.io.kind_records import from_mapping, kind_record
from gridfold.io.tables import read_toml


def event_record(event: Event) -> dict[str, Any]:
    """An event as a flat mapping with its ``kind``; :func:`event_from_record` reads it back."""
    return kind_record(RELAYS if isinstance(event, Relay) else EVENTS, event)


def event_from_record(record: Mapping[str, Any], where: str = "event") -> Event:
    """Build an event from a mapping such as ``{"kind": "bus-fault", "bus": 3}``."""
    event: Event = from_mapping(EVENTS, record, where)
    return event


def relay_from_record(record: Mapping[str, Any], where: str = "relay") -> Relay:
    """Build a relay from a mapping such as ``{"kind": "distance", "branch": "3-2", "bus": 3}``."""
    relay: Relay = from_mapping(RELAYS, record, where)
    return relay


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
    return [
        event_from_record(record, f"{path}: event {number}")
        for number, record in enumerate(read_tables(path, "event"), start=1)
    ]


def load_relays(path: str | Path) -> list[Relay]:
    """Relays from a TOML file of ``[[relays]]`` tables, each with its ``kind``."""
    return relays_of(read_tables(path, "relays"), f"{path}: ")


def relays_of(records: Sequence[Mapping[str, Any]], where: str = "") -> list[Relay]:
    """Relays from mappings.

    Raises
    ------
    EventError
        Names every one that is wrong.
    """
    relays, faults = [], []
    for number, record in enumerate(records, start=1):
        try:
            relays.append(relay_from_record(record, f"{where}relay {number}"))
        except EventError as error:
            faults.append(str(error))
    if faults:
        raise EventError("\n".join(faults))
    return relays


def read_tables(path: str | Path, name: str) -> list[dict[str, Any]]:
    """The tables of that name, which are all there is in a TOML file.

    Raises
    ------
    EventError
        The file cannot be read, or holds something else.
    """
    try:
        data = read_toml(Path(path))
    except CaseFileError as error:
        raise EventError(f"{path}: {error.faults[0]}") from None
    unknown = [other for other in data if other != name]
    records = data.get(name)
    tables = isinstance(records, list) and all(isinstance(record, dict) for record in records)
    if unknown or not tables or not records:
        raise EventError(f"{path}: expected [[{name}]] tables and nothing else")
    return list(records)
