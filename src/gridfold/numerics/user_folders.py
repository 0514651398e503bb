"""Folders in which the package may keep something for its user."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from pathlib import Path


def user_folder(variable: str, beside_home: str) -> Path | None:
    """The package's folder under a base folder of the XDG specification; None without a home folder.

    Parameters
    ----------
    variable : str
        Such as ``XDG_CACHE_HOME``; a relative path there is ignored, as specified.
    beside_home : str
        What stands for it in the home folder, such as ``.cache``.
    """
    chosen = os.environ.get(variable, "")
    if Path(chosen).is_absolute():
        return Path(chosen) / "gridfold"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / beside_home / "gridfold" if home.is_absolute() and home.is_dir() else None


def belongs_to_user(status: os.stat_result) -> bool:
    """Whether a file with this status is the user's; it is where files have no such owner (Windows)."""
    owner = getattr(os, "getuid", None)
    return owner is None or status.st_uid == owner()


def temporary_folder() -> Path | None:
    """The package's folder among temporary files, which nobody else may write; None if there is none.

    On Windows the folder of temporary files is the user's own.
    """
    owner = getattr(os, "getuid", None)
    name = "gridfold" if owner is None else f"gridfold-{owner()}"
    with contextlib.suppress(OSError):
        folder = Path(tempfile.gettempdir()) / name
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        private = owner is None or not status.st_mode & 0o077
        if stat.S_ISDIR(status.st_mode) and belongs_to_user(status) and private:
            return folder
    return None
