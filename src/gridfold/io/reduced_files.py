"""Files of reduced models: a NumPy archive of arrays with a header as JSON text.

The header holds a digest of all else; a file that has been changed is not taken up.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from gridfold.errors import CaseFileError, OptionError
from gridfold.io.array_files import Forms, arrays_digest, open_arrays
from gridfold.io.results import write_npz
from gridfold.version import __version__

FORMAT = "gridfold reduced model"
VERSION = 2

_Kinds = dict[str, type | tuple[type, ...]]
_HEADER: _Kinds = {
    "case": str,
    "fingerprint": str,
    "study_buses": list,
    "reducer": dict,
    "outputs": str,
}
#: What it may say.
_OPTIONAL: _Kinds = {"own_devices": dict, "fit": dict}
#: What the header says besides, by the outputs of the model.
_FURTHER: dict[str, _Kinds] = {
    "states": {
        "column_norm": (int, float),
        "bound": (int, float, type(None)),
        "kept_exactly": int,
    },
    "polar": {"areas": list, "whole": bool, "step_seconds": dict, "light_limits": dict},
}


@dataclass(frozen=True)
class ReducedFile:
    """Content of a file: `header` with the keys of the format, and `arrays` by name."""

    header: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]


def write_reduced(path: Path, content: ReducedFile) -> None:
    """Write the file; there is never half of it.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    marks = {"format": FORMAT, "version": VERSION, "gridfold": __version__}
    header = {**marks, **content.header}
    write_npz(path, content.arrays, header | {"sha256": _digest(header, content.arrays)})


def read_reduced(
    path: Path, forms: Callable[[Mapping[str, Any], tuple[str, ...]], Forms]
) -> ReducedFile:
    """Read the file and check that it is one, of this version, and that it is whole.

    Parameters
    ----------
    path : Path
        The file.
    forms : callable
        What its arrays have to be, from the header and their names. No array is read before.

    Raises
    ------
    CaseFileError
        The file is missing, cannot be read, is not one of a reduced model, or has been changed.
    OptionError
        It has another version of the format.
    """
    with open_arrays(path) as archive:
        header = _header(archive.text("metadata"), path)
        names = tuple(name for name in archive.names if name != "metadata")
        arrays = archive.arrays(forms(header, names), beside=("metadata",))
    if header.pop("sha256", None) != _digest(header, arrays):
        raise CaseFileError(
            "the content is not that which was written: its SHA-256 differs", str(path)
        )
    return ReducedFile(header, arrays)


def _header(text: str | None, path: Path) -> dict[str, Any]:
    """The header, with the keys of the format."""
    try:
        header = json.loads(text or "", parse_constant=_refuse)
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise CaseFileError("this is not a file of a reduced model", str(path))
    if header.get("version") != VERSION:
        raise OptionError(
            f"{path}: the file has version {header.get('version')!r} of the format, this gridfold "
            f"reads version {VERSION}; reduce again"
        )
    further = _FURTHER.get(str(header.get("outputs")), _FURTHER["states"])
    said = {key: kind for key, kind in _OPTIONAL.items() if key in header}
    for key, kind in (_HEADER | further | said).items():
        value = header.get(key)
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise CaseFileError(f"{key} is {value!r} in the header", str(path))
    return header


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no number")


def _digest(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> str:
    text = json.dumps(header, sort_keys=True)
    return sha256(f"{text}\0{arrays_digest(arrays)}".encode()).hexdigest()
