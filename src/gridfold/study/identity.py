"""What makes two studies the same, so that one may go on with the results of the other."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from gridfold.errors import OptionError
from gridfold.io.study_store import StudyStore
from gridfold.numerics.kernel_cache import SOURCES
from gridfold.study.generate import Contingency
from gridfold.study.prepare import Offline
from gridfold.study.study_file import FREE_KEYS, Study
from gridfold.version import __version__


class Results(Protocol):
    """Results in a folder that tell what they are about."""

    folder: Path

    @property
    def identity(self) -> Mapping[str, Any]:
        """What they are about."""


def identity_of(offline: Offline) -> dict[str, Any]:
    """What must be the same for a study to be resumed."""
    content = json.dumps(offline.study.content(), sort_keys=True)
    return {
        "gridfold": __version__,
        "case": offline.case.name,
        "fingerprint": offline.case.fingerprint,
        "sources": offline.sources,
        "files": dict(offline.named.hashes),
        "study_hash": hashlib.sha256(content.encode()).hexdigest(),
    }


def refuse_other(store: StudyStore, study: Study) -> None:
    """Say which key differs before the work is done, where the study file is another one."""
    for key, was, wants in changed_keys(store.identity["study"], study.content(), FREE_KEYS):
        raise OptionError(
            f"{store.folder}: the results belong to another study: {key} was {was!r} and is "
            f"{wants!r}; take another folder with --out"
        )


def changed_keys(
    before: Mapping[str, Any], now: Mapping[str, Any], free: Collection[str]
) -> Iterator[tuple[str, Any, Any]]:
    """Keys of a file's content that have another value now, those that are `free` to have one aside."""
    first, second = _flat(before), _flat(now)
    for key in sorted((first.keys() | second.keys()) - set(free)):
        if first.get(key) != second.get(key):
            yield key, first.get(key), second.get(key)


def refuse_other_files(store: Results, files: Mapping[str, str]) -> None:
    """Raise an OptionError if gridfold or a file that the study names is not what the results rest on.

    `files` are SHA-256 by name.
    """
    there = store.identity
    if "files" not in there or "sources" not in there:
        raise OptionError(
            f"{store.folder}: the results do not tell from which files they were made: an older "
            "gridfold has written them; take another folder with --out"
        )
    before = there["files"]
    changed = [_change(name, before.get(name), files.get(name)) for name in {**before, **files}]
    if there["sources"] != SOURCES:
        changed.append(_change("gridfold itself", there["sources"], SOURCES))
    if faults := [line for line in changed if line is not None]:
        listed = "\n".join(f"  {line}" for line in faults)
        raise OptionError(
            f"{store.folder}: the results were made from other files:\n{listed}\n"
            "Take another folder with --out, or put the files back."
        )


def _change(name: str, before: str | None, now: str | None) -> str | None:
    if before == now:
        return None
    was, is_now = (f"sha256 {h[:16]}" if h else "not there" for h in (before, now))
    return f"{name}: was {was}, is {is_now}"


def refuse_changed(
    store: StudyStore, identity: Mapping[str, Any], contingencies: Sequence[Contingency]
) -> None:
    """Raise an OptionError if the version, the case or the list is not that of the results."""
    refuse_other_case(store, identity)
    if store.contingencies() != [json.loads(json.dumps(c.record())) for c in contingencies]:
        raise OptionError(f"{store.folder}: the list of contingencies is another one")


def refuse_other_case(store: Results, identity: Mapping[str, Any]) -> None:
    """Raise an OptionError if the version or the case is not that of the results."""
    there = store.identity
    words = {
        "gridfold": "another version of gridfold",
        "fingerprint": "other data of the case",
        "case": "another case",
    }
    for key, what in words.items():
        if there.get(key) != identity[key]:
            raise OptionError(
                f"{store.folder}: the results were made with {what} ({there.get(key)}, now "
                f"{identity[key]}); take another folder with --out"
            )


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat
