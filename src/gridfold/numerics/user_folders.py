"""Folders in which the package may keep something for its user."""

from __future__ import annotations

import os
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
