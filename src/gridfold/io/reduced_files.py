"""Files of reduced models: a NumPy archive of arrays with a header as JSON text."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import CaseFileError, OptionError
from gridfold.io.results import write_npz
from gridfold.version import __version__

FORMAT = "gridfold reduced model"
VERSION = 1

_Kinds = dict[str, type | tuple[type, ...]]
_HEADER: _Kinds = {
    "case": str,
    "fingerprint": str,
    "study_buses": list,
    "reducer": dict,
    "outputs": str,
}
#: What the header says besides, by the outputs of the model.
_FURTHER: dict[str, _Kinds] = {
    "states": {
        "column_norm": (int, float),
        "bound": (int, float, type(None)),
        "kept_exactly": int,
    },
    "polar": {"areas": list, "whole": bool, "step_seconds": dict},
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
    write_npz(path, content.arrays, {**marks, **content.header})


def read_reduced(path: Path) -> ReducedFile:
    """Read the file and check that it is one, of this version.

    Raises
    ------
    CaseFileError
        The file is missing, cannot be read, or is not one of a reduced model.
    OptionError
        It has another version of the format.
    """
    arrays = _read_archive(path)
    try:
        header = json.loads(str(arrays.pop("metadata", "")))
    except ValueError:
        header = None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise CaseFileError("this is not a file of a reduced model", str(path))
    if header.get("version") != VERSION:
        raise OptionError(
            f"{path}: the file has version {header.get('version')!r} of the format, this gridfold "
            f"reads version {VERSION}; reduce again"
        )
    further = _FURTHER.get(str(header.get("outputs")), _FURTHER["states"])
    for key, kind in (_HEADER | further).items():
        if not isinstance(header.get(key), kind):
            raise CaseFileError(f"{key} is {header.get(key)!r} in the header", str(path))
    return ReducedFile(header, arrays)


def _read_archive(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with path.open("rb") as stream:
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise CaseFileError("this is not a file of a reduced model", str(path))
            with archive:
                return {name: archive[name] for name in archive.files}
    except OSError as error:
        what = error.strerror or error
        raise CaseFileError(f"the file cannot be read: {what}", str(path)) from None
    except (ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
        text = "this is not a file of a reduced model, or it is damaged"
        raise CaseFileError(text, str(path)) from None
