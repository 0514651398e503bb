"""Check a store, and make a whole one of what a damaged one still has."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from gridfold.errors import OptionError
from gridfold.io.study_damage import LISTED, Content, Damage, damaged_curves, examine
from gridfold.io.study_folder import locked, telling
from gridfold.io.study_schema import FILE, connect
from gridfold.io.study_store import INCOMPLETE, StudyStore

#: Name under which a damaged file is kept.
_KEPT = f"{FILE}.damaged"


@dataclass(frozen=True)
class StoreCheck:
    """How whole a store is.

    Parameters
    ----------
    contingencies, results : int
        Those that are whole.
    unsealed : int
        Results without a seal: a digit that changed in them cannot be told.
    damage : tuple of Damage
        What is not whole.
    """

    contingencies: int
    results: int
    unsealed: int
    damage: tuple[Damage, ...]


@dataclass(frozen=True)
class Repair:
    """What a repair has kept, what is to be done anew, and where the damaged file is now."""

    kept: int
    again: int
    damaged_file: Path


def check_store(folder: str | Path) -> StoreCheck:
    """Read all of a store.

    Raises
    ------
    OptionError
        There is no store in `folder`.
    OutputError
        Nothing of it can be read.
    """
    with StudyStore.read(folder) as store, telling(store.folder):
        content, damage = _whole(store.connection)
        counts = len(content.contingencies), len(content.results), content.unsealed
        return StoreCheck(*counts, tuple(damage))


def repair_store(folder: str | Path) -> Repair:
    """Make a whole store of what can be read; `gridfold run --resume` then does the rest anew.

    The damaged file stays beside it.

    Raises
    ------
    OptionError
        There is no store, another process works on it, nothing is damaged, or what the study is
        about cannot be read: its results could belong to any.
    OutputError
        It cannot be read at all, or the new one not be written.
    """
    folder = Path(folder)
    StudyStore.read(folder).close()
    with locked(folder), telling(folder):
        with closing(connect(folder / FILE)) as damaged:
            content, damage = _whole(damaged)
            _require_repairable(folder, damage)
            lost = {item.number for item in damage if item.number is not None}
            kept = {k: row for k, row in content.results.items() if k not in lost}
            about = content.about | {INCOMPLETE: json.dumps(True), LISTED: "0"}
            whole = replace(content, results=kept, about=about)
            repaired = folder / f"{FILE}.new"
            repaired.unlink(missing_ok=True)
            with closing(connect(repaired)) as connection:
                whole.write(connection)
                _copy_curves(damaged, connection, kept)
        beside = _free_name(folder)
        (folder / FILE).replace(beside)
        repaired.replace(folder / FILE)
    # Of contingencies that cannot be read nobody knows how many there are.
    return Repair(len(kept), len(content.contingencies) - len(kept), beside)


def _whole(connection: sqlite3.Connection) -> tuple[Content, list[Damage]]:
    """The content, and the damage of all parts, that of the file itself at the end."""
    content = examine(connection)
    damage = [*content.damage, *damaged_curves(connection)]
    if not damage:
        try:
            found = [row[0] for row in connection.execute("PRAGMA integrity_check(8)")]
            damage = [Damage("file", text) for text in found if text != "ok"]
        except sqlite3.Error as error:
            damage = [Damage("file", str(error))]
    return content, damage


def _require_repairable(folder: Path, damage: list[Damage]) -> None:
    if not damage:
        raise OptionError(f"{folder}: nothing is damaged")
    for item in damage:
        if item.what.startswith("description"):
            raise OptionError(
                f"{folder}: what the study is about cannot be read ({item}); its results cannot be "
                "gone on with. gridfold show gives those that are whole"
            )


def _copy_curves(
    damaged: sqlite3.Connection, whole: sqlite3.Connection, numbers: Iterable[int]
) -> None:
    for number in numbers:
        query = "SELECT number, content FROM curves WHERE number = ?"
        row = damaged.execute(query, (number,)).fetchone()
        if row is not None:
            whole.execute("INSERT INTO curves VALUES (?, ?)", row)
    whole.commit()


def _free_name(folder: Path) -> Path:
    names = (folder / (f"{_KEPT}-{k}" if k > 1 else _KEPT) for k in range(1, 10_000))
    return next(name for name in names if not name.exists())
