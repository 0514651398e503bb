"""Write a case: a folder of tables, or RAW and DYR files of PSS/E."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gridfold.dynamics.psse_export import psse_data
from gridfold.errors import OptionError, OutputError, SaveWarning, warn_caller
from gridfold.grid.case import Case
from gridfold.io.case_folder_writer import write_case_folder
from gridfold.io.dyr_writer import dyr_text
from gridfold.io.lost import Lost
from gridfold.io.raw_writer import raw_text, with_source_impedances
from gridfold.io.results import replacing

_RAW, _DYR = ".raw", ".dyr"
#: Suffixes of files that are read, or are tables of something else, but not written as a case.
_OTHER_FILES = (".m", ".mat", ".csv", ".json", ".toml", ".xlsx", ".parquet")


def save_case(case: Case, path: str | Path, *, overwrite: bool = False) -> None:
    """See :meth:`gridfold.Case.save`."""
    if lost := write_case(case, path, overwrite=overwrite):
        warn_caller("\n".join([f"{path} does not hold all of the case:", *lost]), SaveWarning)


def write_case(case: Case, path: str | Path, *, overwrite: bool = False) -> tuple[str, ...]:
    """Write a case, and return what the files do not hold, in words."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in _OTHER_FILES:
        raise OptionError(f"{path}: a case is written as a folder, or as .raw and .dyr")
    if suffix not in (_RAW, _DYR):
        return write_case_folder(case, path, overwrite)
    data = psse_data(case)
    lost = Lost()
    for what, record in data.lost:
        lost.add(what, record)
    texts: dict[Path, str] = {}
    told: tuple[str, ...] = ()
    if suffix == _RAW:
        network = with_source_impedances(case, data.impedances)
        texts[path], told = raw_text(network)
    if case.devices or suffix == _DYR:
        dyr = path.with_suffix(".DYR" if path.suffix.isupper() else _DYR)
        texts[dyr] = dyr_text(data.data)
    _write(texts, overwrite)
    return (*told, *lost.lines)


def _write(texts: Mapping[Path, str], overwrite: bool) -> None:
    for path in texts:
        if path.exists() and not overwrite:
            raise OutputError(f"{path}: exists already; nothing was written")
    for path, text in texts.items():
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
