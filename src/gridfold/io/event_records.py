"""Events as text: TOML files, ``kind name=value ...`` on the command line, records in metadata.

Relays are read likewise, from TOML files of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gridfold.errors import CaseFileError, EventError
from gridfold.grid.case import Case
from gridfold.grid.events import EVENTS, Event
from gridfold.grid.relays import RELAYS, Relay
from gridfold.io.event_places import Numbering, numbering, with_numbers
from gridfold.io.kind_records import from_mapping, kind_record, unquoted, words_of
from gridfold.io.tables import read_toml


def event_record(event: Event) -> dict[str, Any]:
    """An event as a flat mapping with its ``kind``; :func:`event_from_record` reads it back."""
    return kind_record(RELAYS if isinstance(event, Relay) else EVENTS, event)


def event_from_record(
    record: Mapping[str, Any], where: str = "event", number: Numbering | None = None
) -> Event:
    """Build an event from a mapping such as ``{"kind": "bus-fault", "bus": 3}``.

    With `number` its bus and its branch may be given by names
    (:func:`gridfold.io.event_places.numbering`).
    """
    given = record if number is None else with_numbers(record, number, where)
    event: Event = from_mapping(EVENTS, given, where)
    return event


def relay_from_record(
    record: Mapping[str, Any], where: str = "relay", number: Numbering | None = None
) -> Relay:
    """Build a relay from a mapping such as ``{"kind": "distance", "branch": "3-2", "bus": 3}``."""
    given = record if number is None else with_numbers(record, number, where)
    relay: Relay = from_mapping(RELAYS, given, where)
    return relay


def parse_event(text: str, number: Numbering | None = None) -> Event:
    """Build an event from ``kind name=value ...``, for example ``bus-fault bus=3 duration=0.1``."""
    where = f"event {text!r}"
    words = words_of(text)
    if not words:
        raise EventError(f"{where}: it is empty; known kinds: {', '.join(EVENTS)}")
    record: dict[str, Any] = {"kind": words[0]}
    for word in words[1:]:
        name, sign, value = word.partition("=")
        if not sign or not name or not value:
            raise EventError(f"{where}: {word!r} is not of the form name=value")
        if name in record:
            raise EventError(f"{where}: {name} is given twice")
        record[name] = unquoted(value)
    return event_from_record(record, where, number)


def load_events(path: str | Path, case: Case | None = None) -> list[Event]:
    """Events from a TOML file of ``[[event]]`` tables, each with its ``kind``.

    With `case` its buses and branches may be given by names.
    """
    number = None if case is None else numbering(case)
    return events_of(read_tables(path, "event"), f"{path}: ", number)


def events_of(
    records: Sequence[Mapping[str, Any]], where: str = "", number: Numbering | None = None
) -> list[Event]:
    """Events from mappings."""
    return [
        event_from_record(record, f"{where}event {place}", number)
        for place, record in enumerate(records, start=1)
    ]


def load_relays(path: str | Path, case: Case | None = None) -> list[Relay]:
    """Relays from a TOML file of ``[[relays]]`` tables, each with its ``kind``."""
    number = None if case is None else numbering(case)
    return relays_of(read_tables(path, "relays"), f"{path}: ", number)


def relays_of(
    records: Sequence[Mapping[str, Any]], where: str = "", number: Numbering | None = None
) -> list[Relay]:
    """Relays from mappings.

    Raises
    ------
    EventError
        Names every one that is wrong.
    """
    relays, faults = [], []
    for place, record in enumerate(records, start=1):
        try:
            relays.append(relay_from_record(record, f"{where}relay {place}", number))
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
