"""Clearing times that are known: in memory, and in a folder that can be gone on with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gridfold.errors import OptionError
from gridfold.grid.case import Case
from gridfold.io.clearing_store import ClearingStore
from gridfold.io.event_records import event_record
from gridfold.runs.clearing.found import ClearingTime, Fault
from gridfold.runs.clearing.rows import about_times, clearing_row, time_from_row

#: Parts of an identity that must be the same for a map to be gone on with, and their names.
_SAME = {
    "gridfold": "gridfold",
    "sources": "sources of gridfold",
    "fingerprint": "case data",
    "faults": "places",
}


@dataclass
class KeptTimes:
    """Clearing times by the positions of their faults; each is written as it comes."""

    case: Case
    store: ClearingStore | None = None
    known: dict[int, ClearingTime] = field(default_factory=dict)

    def add(self, number: int, found: ClearingTime) -> None:
        """Keep one."""
        self.known[number] = found
        if self.store is not None:
            self.store.add({"number": number, **clearing_row(self.case, found)})


@contextmanager
def kept_times(
    case: Case,
    faults: Sequence[Fault],
    settings: Mapping[str, Any],
    folder: str | Path | None,
    resume: bool,
) -> Iterator[KeptTimes]:
    """Where the times of `faults` are kept, with those that the folder holds; in memory without one.

    A place that could not be found there is looked at again.

    Raises
    ------
    OptionError
        The folder holds times and `resume` is false, or it holds none or others and `resume` is true.
    """
    if folder is None:
        if resume:
            raise OptionError("resume needs the folder that holds the clearing times (--out)")
        yield KeptTimes(case)
        return
    identity = {
        **about_times(case, settings, len(faults)),
        "faults": [event_record(fault) for fault in faults],
    }
    opened = ClearingStore.resume(folder) if resume else ClearingStore.create(folder, identity)
    with opened as store:
        _refuse_other(store, identity)
        rows = {row["number"]: row for row in store.rows()} if resume else {}
        known = {
            number: time_from_row(fault, rows[number])
            for number, fault in enumerate(faults)
            if number in rows and not rows[number]["reason"]
        }
        yield KeptTimes(case, store, known)


def _refuse_other(store: ClearingStore, identity: Mapping[str, Any]) -> None:
    """Say what differs where the folder is about other clearing times."""
    before = store.identity
    changed = [name for key, name in _SAME.items() if before.get(key) != identity[key]]
    was, now = before["settings"], identity["settings"]
    changed += [
        f"{key} (was {was.get(key)}, is {now.get(key)})"
        for key in sorted(was.keys() | now.keys())
        if was.get(key) != now.get(key)
    ]
    if changed:
        raise OptionError(
            f"{store.folder} holds other clearing times: they differ in {', '.join(changed)}; take "
            "another folder with --out"
        )
