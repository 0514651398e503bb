"""Records within records as plain tables, as TOML has them, and back."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

from gridfold.grid.case import UnitKey

_KIND = "kind"
#: Types that records name without importing them.
_LATE_NAMES = {"UnitKey": UnitKey}


def plain_table(kinds: Mapping[str, type], record: Any) -> dict[str, Any]:
    """A record as a table with its ``kind``; :func:`record_of` reads it back."""
    names = {record_type: kind for kind, record_type in kinds.items()}
    return {_KIND: names[type(record)], **_plain(record)}


def record_of(kinds: Mapping[str, type], table: Mapping[str, Any]) -> Any:
    """The record of a table.

    Raises
    ------
    KeyError, TypeError, ValueError
        The kind is unknown, or a field unknown, missing or of another type.
    """
    values = {name: value for name, value in table.items() if name != _KIND}
    return _record(kinds[table[_KIND]], values)


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)}
    if hasattr(value, "_asdict"):
        return {name: _plain(item) for name, item in value._asdict().items()}
    if isinstance(value, tuple | frozenset):
        return [_plain(item) for item in value]
    return value


def _record(kind: type, values: Mapping[str, Any]) -> Any:
    hints = typing.get_type_hints(kind, localns=_LATE_NAMES)
    if strange := [name for name in values if name not in hints]:
        raise KeyError(strange[0])
    return kind(**{name: _value(hints[name], value) for name, value in values.items()})


def _value(kind: Any, value: Any) -> Any:
    if isinstance(kind, types.UnionType):
        kind = next(option for option in typing.get_args(kind) if option is not type(None))
    if typing.get_origin(kind) is tuple:
        return _tuple(typing.get_args(kind), value)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(value)
    if isinstance(value, Mapping):
        return _record(kind, value)
    number = kind is float and isinstance(value, int | float) and not isinstance(value, bool)
    if not (number or type(value) is kind):
        raise TypeError(f"{value!r} has the wrong type")
    return float(value) if number else value


def _tuple(kinds: Sequence[Any], value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise TypeError(f"{value!r} is no list")
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        return tuple(_value(kinds[0], item) for item in value)
    return tuple(_value(kind, item) for kind, item in zip(kinds, value, strict=True))
