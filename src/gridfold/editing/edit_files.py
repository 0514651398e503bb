"""Edits from TOML: tables ``[[edits]]``, each with its ``kind``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gridfold.editing.edits import EDITS, Edit
from gridfold.errors import EventError, OptionError
from gridfold.io.event_records import read_tables
from gridfold.io.kind_records import from_mapping


def load_edits(path: str | Path) -> list[Edit]:
    """Edits from a TOML file of ``[[edits]]`` tables, each with its ``kind``.

    Raises
    ------
    OptionError
        The file cannot be read, or names every edit that is wrong.
    """
    try:
        return edits_of(read_tables(path, "edits"), f"{path}: ")
    except EventError as error:
        raise OptionError(str(error)) from None


def edits_of(records: Sequence[Mapping[str, Any]], where: str = "") -> list[Edit]:
    """Edits from mappings such as ``{"kind": "set", "record": "GENROU 101:1 H=4"}``.

    Raises
    ------
    OptionError
        Names every one that is wrong.
    """
    edits, faults = [], []
    for number, record in enumerate(records, start=1):
        try:
            edits.append(from_mapping(EDITS, record, f"{where}edit {number}"))
        except EventError as error:
            faults.append(str(error))
    if faults:
        raise OptionError("\n".join(faults))
    return edits
