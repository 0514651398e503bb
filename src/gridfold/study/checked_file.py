"""TOML files that are checked by a model of theirs: every fault with its line and key."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gridfold.errors import CaseFileError
from gridfold.io.tables import read_text, read_toml, suggest

Content = TypeVar("Content", bound=BaseModel)
Location = Sequence[int | str]

#: Names that pydantic puts between keys for the members of a choice of types.
_TAGS = ("int", "constrained-int", "literal['all']", "number", "distribution")
_HEADER = re.compile(r"(\[\[?)([^\]]*)\]")


def read_checked(path: Path, kind: type[Content]) -> Content:
    """A file as `kind`.

    Raises
    ------
    CaseFileError
        The file cannot be read, or something in it is wrong: every fault with its line.
    """
    data = read_toml(path)
    lines = _Lines(read_text(path))
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        faults = [_fault(item, kind, lines, path) for item in _meant(error.errors())]
        raise CaseFileError(faults, str(path)) from None


def checked(content: Mapping[str, Any], kind: type[Content], what: str) -> Content:
    """A mapping with the keys of a file as `kind`; a CaseFileError with every fault of it."""
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise CaseFileError([_fault(item, kind) for item in _meant(error.errors())], what) from None


class _Lines:
    """Finds the line of a key in a TOML text, for messages."""

    def __init__(self, text: str):
        self._where: dict[tuple[int | str, ...], int] = {}
        table: tuple[int | str, ...] = ()
        counts: Counter[tuple[str, ...]] = Counter()
        for number, line in enumerate(text.splitlines(), start=1):
            text = line.strip()
            if header := _HEADER.match(text):
                names = tuple(map(_bare, header[2].split(".")))
                table = names
                if header[1] == "[[":
                    table = (*names, counts[names])
                    counts[names] += 1
                self._where.setdefault(names, number)
                self._where.setdefault(table, number)
            elif "=" in text:
                self._where.setdefault((*table, _bare(text.partition("=")[0])), number)

    def find(self, location: Location) -> int | None:
        """Line of a key, or of the innermost table around it that the file has."""
        for length in range(len(location), 0, -1):
            if tuple(location[:length]) in self._where:
                return self._where[tuple(location[:length])]
        return None


def _bare(key: str) -> str:
    """A key without quotes."""
    return key.strip().strip("\"'")


def _keys(item: ErrorDetails) -> tuple[int | str, ...]:
    """Where a fault is, without the names of types that pydantic puts there."""
    return tuple(
        part
        for part in item["loc"]
        if part not in _TAGS and not (isinstance(part, str) and "[" in part)
    )


def _meant(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """The faults without those about other types that a value with a fault of its own might have."""
    faulty = [_keys(item) for item in errors if not item["type"].endswith("_type")]
    return [
        item
        for item in errors
        if not item["type"].endswith("_type")
        or not any(keys[: len(_keys(item))] == _keys(item) for keys in faulty)
    ]


def _fault(
    item: ErrorDetails, kind: type[BaseModel], lines: _Lines | None = None, path: Path | None = None
) -> str:
    """One line about a fault: where, what, and the nearest known key if it is an unknown one."""
    location = _keys(item)
    line = None if lines is None else lines.find(location)
    where = f"{path}:{line}: " if line is not None else ""
    key = ".".join(str(part) for part in location)
    if item["type"] == "extra_forbidden":
        known = list(_known_keys(kind, location[:-1]))
        return f"{where}unknown key {key!r}; {suggest(str(location[-1]), known)}"
    if item["type"] == "missing":
        return f"{where}{key} is missing"
    message = item["msg"].removeprefix("Value error, ")
    if not key:
        return message
    value = item["input"]
    shown = "" if isinstance(value, dict) or repr(value) in message else f", not {value!r}"
    return f"{where}{key}: {message[:1].lower()}{message[1:]}{shown}"


def _known_keys(kind: type[BaseModel], location: Location) -> Iterator[str]:
    """Keys of the table at `location` of a file of `kind`."""
    section = kind
    for part in location:
        if not isinstance(part, int):
            fields = section.model_fields.items()
            found = next(item.annotation for name, item in fields if part in (name, item.alias))
            section = next(_sections(found), section)
    for name, item in section.model_fields.items():
        yield item.alias or name


def _sections(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _sections(inner)
