"""What the shell completes beside names of commands, options and choices."""

from __future__ import annotations

from pathlib import Path

from gridfold.io.case_folder import built_in_cases

_SUFFIXES = (".raw", ".m", ".mat")


def case_sources(incomplete: str) -> list[str]:
    """Built-in cases, files of networks and folders that begin like `incomplete`."""
    folder, begin = Path(incomplete).parent, Path(incomplete).name
    if incomplete.endswith("/"):
        folder, begin = Path(incomplete), ""
    built_in = [name for name in built_in_cases() if name.startswith(incomplete)]
    try:
        there = sorted(folder.iterdir())
    except OSError:
        return built_in
    found = [
        f"{path}/" if path.is_dir() else str(path)
        for path in there
        if path.name.startswith(begin) and not (path.name.startswith(".") and not begin)
        if path.is_dir() or path.suffix.lower() in _SUFFIXES
    ]
    return built_in + found
