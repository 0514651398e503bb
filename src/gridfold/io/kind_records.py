"""Records with a ``kind``, made from mappings such as those of TOML files: events and relays."""

from __future__ import annotations

import re
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, fields, is_dataclass
from typing import Any

from gridfold.errors import EventError
from gridfold.io.tables import parse_cell, suggest

#: Words that mean the same in names of kinds.
_SYNONYMS = {
    "line": "branch",
    "transformer": "branch",
    "generator": "machine",
    "gen": "machine",
    "unit": "machine",
    "opening": "trip",
    "open": "trip",
    "outage": "trip",
    "disconnect": "trip",
    "close": "reclose",
    "closing": "reclose",
    "reclosing": "reclose",
    "shedding": "shed",
    "capacitor": "shunt",
    "reactor": "shunt",
    "parameter": "set",
    "reference": "set",
    "dispatch": "redispatch",
}


#: A word: what stands in quotes may have blanks. A quote after a letter is a prime, as in T'd0.
_WORD = re.compile(r"""(?:(?<![\w'"])"[^"]*"|(?<![\w'"])'[^']*'|\S)+""")
_WHOLLY_QUOTED = re.compile(r"\"([^\"]*)\"|'([^']*)'")


def words_of(text: str) -> list[str]:
    """The words of a text such as ``bus-fault bus="WEST 1" duration=0.1``."""
    return _WORD.findall(text)


def unquoted(value: str) -> str:
    """A value without quotes that stand around all of it."""
    quoted = _WHOLLY_QUOTED.fullmatch(value)
    return value if quoted is None else quoted[1] or quoted[2] or ""


def kind_record(kinds: Mapping[str, type], item: Any) -> dict[str, Any]:
    """A record as a mapping with its ``kind``; :func:`from_mapping` reads it back.

    What is not given, None or an empty text, is left out.
    """
    names = {record_type: kind for kind, record_type in kinds.items()}
    given = {name: value for name, value in asdict(item).items() if value not in (None, "")}
    return {"kind": names[type(item)], **given}


def from_mapping(kinds: Mapping[str, type], record: Mapping[str, Any], where: str) -> Any:
    """Build a record of one of the `kinds` from a mapping such as ``{"kind": "bus-fault", "bus": 3}``.

    Raises
    ------
    EventError
        The kind is unknown, or a field unknown, missing or of the wrong type; `where` is named.
    """
    values = dict(record)
    kind = values.pop("kind", None)
    if kind is None:
        raise EventError(f"{where}: kind is missing; known: {', '.join(kinds)}")
    if not isinstance(kind, str) or kind not in kinds:
        hint = suggest_kind(str(kind), list(kinds))
        raise EventError(f"{where}: unknown kind {kind!r}; {hint}")
    return _built(kinds[kind], values, where, kind)


def suggest_kind(kind: str, known: Sequence[str]) -> str:
    """A hint at the kind that is meant: one that says the same in other words, or the nearest name."""
    meant = _words(kind)
    alike = [name for name in known if _words(name) == meant]
    if not alike and len(meant) > 1:
        alike = [name for name in known if _words(name) >= meant or _words(name) <= meant]
    return f"did you mean {alike[0]!r}?" if alike else suggest(kind, known)


def _words(kind: str) -> frozenset[str]:
    """The words of a kind, in any order, each by one of its names."""
    words = kind.lower().replace("_", "-").replace(" ", "-").split("-")
    return frozenset(_SYNONYMS.get(word, word) for word in words if word)


def _built(record_type: type, values: Mapping[str, Any], where: str, kind: str) -> Any:
    hints = typing.get_type_hints(record_type)
    names = [item.name for item in fields(record_type)]
    arguments = {}
    for name, value in values.items():
        if name not in names:
            raise EventError(f"{where}: {kind} has no {name!r}; {suggest(name, names)}")
        arguments[name] = _converted(value, hints[name], f"{where}: {name}")
    for item in fields(record_type):
        if item.default is MISSING and item.name not in arguments:
            raise EventError(f"{where}: {kind} needs {item.name}")
    return record_type(**arguments)


def _converted(value: Any, kind: Any, where: str) -> Any:
    """Convert a TOML or text value to the type of a field."""
    if value is None and type(None) in typing.get_args(kind):
        return None
    if typing.get_origin(kind) is tuple:
        return _several(value, typing.get_args(kind)[0], where)
    if isinstance(value, bool) != (kind is bool) and not isinstance(value, str):
        raise EventError(f"{where}: {value!r} has the wrong type")
    text = str(value).lower() if isinstance(value, bool) else str(value)
    try:
        return parse_cell(text, kind)
    except ValueError as error:
        raise EventError(f"{where}: {error}") from None


def _several(value: Any, kind: Any, where: str) -> tuple[Any, ...]:
    """A list of tables as records."""
    assert is_dataclass(kind)
    tables = isinstance(value, list | tuple) and all(isinstance(item, Mapping) for item in value)
    if not tables:
        known = ", ".join(f"{item.name} = ..." for item in fields(kind))
        raise EventError(f"{where}: it is a list of tables, each {{ {known} }}")
    return tuple(
        _built(kind, item, f"{where} {number}", "a stage")  # type: ignore[arg-type]
        for number, item in enumerate(value, start=1)
    )
