"""Python code of studies that a user trusts, remembered by its digest in a folder of that user."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from gridfold.cli.console import err
from gridfold.errors import OutputError
from gridfold.io.results import write_json
from gridfold.numerics.code_files import Code
from gridfold.numerics.user_folders import belongs_to_user, user_folder
from gridfold.runs.own_devices import read_devices
from gridfold.study.trust import code_record, listing


def trusted_devices(names: Sequence[str], folder: Path, given: bool) -> frozenset[str]:
    """Digests of the code in the `devices` of a study or a plan that may run.

    Parameters
    ----------
    names : sequence of str
        Its Python files.
    folder : Path
        Where their names start.
    given : bool
        Whether the user trusts all of it now. It is told what that is, and remembered.
    """
    codes = read_devices([folder / name for name in names])
    trusted = frozenset(code.digest for code in codes if given or _is_remembered(code))
    if given and codes:
        _tell(
            "trusted: Python code of the study, which may do anything that you may do here", codes
        )
        where = [_remember(code) for code in codes]
        _say(
            "not remembered: there is no folder for it"
            if None in where
            else f"remembered in {where[0]}"
        )
    elif trusted:
        _tell("Python code of the study that you trusted before", codes)
    return trusted


def _tell(title: str, codes: Sequence[Code]) -> None:
    _say("\n".join([f"{title}:", *(line for code in codes for line in listing(code))]))


def _say(text: str) -> None:
    err.print(text, style="dim", soft_wrap=True)


def _file(code: Code) -> Path | None:
    folder = user_folder("XDG_STATE_HOME", ".local/state")
    return None if folder is None else folder / "trusted-code" / f"{code.digest}.json"


def _is_remembered(code: Code) -> bool:
    """Whether this user, and nobody else, has written down that they trust the code."""
    file = _file(code)
    if file is None:
        return False
    try:
        return (
            belongs_to_user(file.stat())
            and json.loads(file.read_text(encoding="utf-8"))["digest"] == code.digest
        )
    except (OSError, ValueError, TypeError, KeyError):
        return False


def _remember(code: Code) -> Path | None:
    """Write down that the code is trusted; the folder, or None where that cannot be."""
    file = _file(code)
    if file is not None:
        when = datetime.now(UTC).isoformat(timespec="seconds")
        with contextlib.suppress(OutputError):
            write_json(file, code_record(code) | {"trusted": when})
            return file.parent
    return None
