"""The files that a study names, and what they hold."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

from gridfold.io.case_folder import case_files
from gridfold.io.input_files import is_there, read_content
from gridfold.numerics.code_files import Code
from gridfold.runs.own_devices import read_devices
from gridfold.study.study_file import Study


@dataclass(frozen=True)
class NamedFiles:
    """What a study names beside itself, as it was read.

    Parameters
    ----------
    folder : Path
        Where relative file names start.
    own_code : tuple of Code
        Code of its device models, which has not been run.
    hashes : mapping
        SHA-256 of every file by the name that it has in the study, with those that the code imports.
    """

    folder: Path
    own_code: tuple[Code, ...] = ()
    hashes: Mapping[str, str] = field(default_factory=dict)


def case_source(source: str, folder: Path) -> str | Path:
    """A built-in case by name, else a path that starts at the study's folder."""
    beside = folder / source
    return beside if is_there(beside) or Path(source).suffix or "/" in source else source


def read_named(study: Study, folder: Path) -> NamedFiles:
    """Read the files that a study names; nothing is run.

    Raises
    ------
    CaseFileError
        A file of the case or of the contingencies cannot be read.
    OptionError
        A file of a device model cannot be read, or is no Python.
    """
    names = study.case.devices
    own_code = read_devices([folder / name for name in names])
    hashes = {name: _sha256(path) for name, path in _data_files(study, folder)}
    for name, code in zip(names, own_code, strict=True):
        hashes[name] = code.files[0].sha256
        hashes |= {f"{name} imports {file.module}": file.sha256 for file in code.files[1:]}
    return NamedFiles(folder, own_code, hashes)


def _data_files(study: Study, folder: Path) -> Iterator[tuple[str, Path]]:
    """Files of the case and of the contingencies, with the names that they have in the study."""
    source = case_source(study.case.source, folder)
    for path in case_files(source):
        inside = Path(os.path.relpath(path, source)).as_posix()
        yield str(Path(study.case.source) / inside), path
    case = study.case
    for name in (case.dyr, case.unit_sources, case.edits, study.contingencies.csv):
        if name is not None:
            yield name, folder / name


def _sha256(path: Path) -> str:
    return sha256(read_content(path)).hexdigest()
