"""Clearing times as rows of a table, and what they are about; both ready for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING, Any

from gridfold.grid.case import Case, UnitKey
from gridfold.grid.event_checks import find_branch
from gridfold.grid.events import BusFault
from gridfold.grid.grid_map import grid_map
from gridfold.numerics.kernel_cache import SOURCES
from gridfold.runs.clearing.found import ClearingTime, Fault
from gridfold.systems.status import Status
from gridfold.version import __version__

if TYPE_CHECKING:
    import pandas as pd

#: Columns of the table and their types in pandas.
COLUMNS = {
    "place": "string",
    "name": "string",
    "bus": "Int64",
    "branch": "string",
    "fraction": "float64",
    "base_kv": "float64",
    "area": "Int64",
    "zone": "Int64",
    "cct_s": "float64",
    "bounded": "boolean",
    "lost_at_s": "float64",
    "machine": "string",
    "status": "string",
    "runs": "Int64",
    "reason": "string",
}


def clearing_row(case: Case, item: ClearingTime) -> dict[str, Any]:
    """The row of a fault; ``bus`` and ``branch`` say where it is, ``name`` which bus that is.

    For a fault inside a branch name, voltage level, area and zone are those of the nearer end.
    """
    fault = item.fault
    at = case.buses[case.bus_index[near_bus(case, fault)]]
    line = None if isinstance(fault, BusFault) else fault
    return {
        "place": place_of(fault),
        "name": at.name.strip(),
        "bus": fault.bus if isinstance(fault, BusFault) else None,
        "branch": None if line is None else line.branch,
        "fraction": None if line is None else line.fraction,
        "base_kv": at.base_kv,
        "area": at.area,
        "zone": at.zone,
        "cct_s": None if item.failed else item.seconds,
        "bounded": item.bounded,
        "lost_at_s": item.lost_at,
        "machine": None if item.machine is None else str(item.machine),
        "status": None if item.status is None else item.status.value,
        "runs": item.runs,
        "reason": item.reason or None,
    }


def time_from_row(fault: Fault, row: Mapping[str, Any]) -> ClearingTime:
    """The clearing time of `fault` whose row this is."""
    seconds, machine, status = row["cct_s"], row["machine"], row["status"]
    return ClearingTime(
        replace(fault, duration=seconds) if seconds else fault,
        nan if seconds is None else seconds,
        row["bounded"],
        row["runs"],
        row["lost_at_s"],
        None if machine is None else UnitKey(*_unit(machine)),
        None if status is None else Status(status),
        row["reason"] or "",
    )


def clearing_frame(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Rows as a table with a type for each column."""
    import pandas as pd

    return pd.DataFrame(list(rows), columns=list(COLUMNS)).astype(COLUMNS)


def about_times(case: Case, settings: Mapping[str, Any], total: int) -> dict[str, Any]:
    """What clearing times of a case are about; `total` counts the places that were asked for."""
    return {
        "gridfold": __version__,
        "sources": SOURCES,
        "case": case.name,
        "fingerprint": case.fingerprint,
        "settings": dict(settings),
        "places": total,
        "map": grid_map(case, frozenset()),
    }


def place_of(fault: Fault) -> str:
    """Where a fault is, in words."""
    if isinstance(fault, BusFault):
        return f"bus {fault.bus}"
    if fault.fraction in (0.0, 1.0):
        first, second = fault.branch.partition(":")[0].split("-")
        return f"line {fault.branch} at {second if fault.fraction else first}"
    return f"line {fault.branch} at {100 * fault.fraction:g} %"


def near_bus(case: Case, fault: Fault) -> int:
    """Number of the bus at which a fault is, or of the nearer end of its branch."""
    if isinstance(fault, BusFault):
        return fault.bus
    position, turned = find_branch(case, fault.branch, "fault")
    branch = case.branches[position]
    return branch.to_bus if (fault.fraction > 0.5) != turned else branch.from_bus


def _unit(text: str) -> tuple[int, str]:
    bus, _, name = text.partition(":")
    return int(bus), name
