"""Write a case: a folder of tables, or RAW and DYR files of PSS/E."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from gridfold.dynamics.device import Device
from gridfold.dynamics.psse_export import psse_data
from gridfold.dynamics.registry import DEVICES
from gridfold.errors import OptionError, OutputError, PowerFlowError, SaveWarning, warn_caller
from gridfold.grid.case import Case, Control, Generator
from gridfold.io.case_folder_writer import write_case_folder
from gridfold.io.dyr_writer import dyr_text
from gridfold.io.lost import Lost
from gridfold.io.raw_writer import raw_text
from gridfold.io.results import replacing
from gridfold.powerflow import solve_power_flow

_RAW, _DYR = ".raw", ".dyr"
#: Suffixes of files that are read, or are tables of something else, but not written as a case.
_OTHER_FILES = (
    *(".m", ".mat", ".sav", ".epc", ".txt", ".csv", ".json", ".toml", ".xls", ".xlsx", ".parquet"),
)


def save_case(case: Case, path: str | Path, *, overwrite: bool = False) -> None:
    """See :meth:`gridfold.Case.save`."""
    if lost := write_case(case, path, overwrite=overwrite):
        warn_caller("\n".join([f"{path} does not hold all of the case:", *lost]), SaveWarning)


def write_case(
    case: Case,
    path: str | Path,
    *,
    overwrite: bool = False,
    devices: Mapping[str, Device] = DEVICES,
) -> tuple[str, ...]:
    """Write a case, and return what the files do not hold, in words.

    `devices` are all models by name; the rest is as in :meth:`gridfold.Case.save`.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in _OTHER_FILES:
        raise OptionError(f"{path}: a case is written as a folder, or as .raw and .dyr")
    if suffix not in (_RAW, _DYR):
        return write_case_folder(case, path, overwrite)
    data = psse_data(case, devices)
    lost = Lost()
    for what, record in data.lost:
        lost.add(what, record)
    texts: dict[Path, str] = {}
    told: tuple[str, ...] = ()
    if suffix == _RAW:
        texts[path], told = raw_text(_stored(data.network, lost))
    if case.devices or suffix == _DYR:
        dyr = path.with_suffix(".DYR" if path.suffix.isupper() else _DYR)
        texts[dyr] = dyr_text(data.data)
    _write(texts, overwrite)
    return (*told, *lost.lines)


def _stored(case: Case, lost: Lost) -> Case:
    """The case with its solution stored, if a RAW file says by that state alone what units do."""
    at_bus: dict[int, list[Generator]] = defaultdict(list)
    for unit in case.generators:
        if unit.in_service:
            at_bus[unit.bus].append(unit)
    told_by_state = any(_by_state(unit, units) for units in at_bus.values() for unit in units)
    if not told_by_state:
        return case
    try:
        solved = solve_power_flow(case).solved_case
    except PowerFlowError as error:
        lost.add(f"the power flow, as the stored state is not its solution: {error}")
        return case
    lost.add("the stored state: that of the power flow is written in its place")
    return solved


def _write(texts: Mapping[Path, str], overwrite: bool) -> None:
    for path in texts:
        if path.exists() and not overwrite:
            raise OutputError(f"{path}: exists already; nothing was written")
    for path, text in texts.items():
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")


def _by_state(unit: Generator, at_bus: Sequence[Generator]) -> bool:
    """Whether a unit does in a RAW file what it does in the case only where the state is the solution.

    There all units hold a voltage, and of several at a slack bus the largest balances.
    """
    balances = unit.control is Control.SLACK
    is_largest = unit is max(at_bus, key=lambda other: other.base_mva)
    return unit.control is Control.POWER or (balances and not is_largest)
