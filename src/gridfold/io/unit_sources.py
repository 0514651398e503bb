"""What drives the units of a case, from a CSV table with the columns bus, id and source."""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from gridfold.errors import CaseFileError
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.energy_source import EnergySource
from gridfold.io.tables import read_records, read_table


@dataclass(frozen=True)
class _Row:
    bus: int
    source: EnergySource
    id: str = "1"


def read_unit_sources(path: str | Path, case: Case) -> Mapping[UnitKey, EnergySource]:
    """What drives each unit that the table names.

    Raises
    ------
    CaseFileError
        The file cannot be read, a cell is wrong, or a row names a unit that the case does not have or
        that another row names: every fault with its line.
    """
    table = read_table(Path(path))
    found: dict[UnitKey, EnergySource] = {}
    known = {generator.key for generator in case.generators} | case.left_out
    for line, row in read_records(table, _Row, typing.get_type_hints(_Row)):
        key = UnitKey(row.bus, row.id)
        if key not in known:
            table.fault(line, f"there is no unit {key} in case {case.name}")
        elif key in found:
            table.fault(line, f"unit {key} is given twice")
        found[key] = row.source
    if table.faults:
        raise CaseFileError(table.faults, str(path))
    return found


def with_sources(case: Case, sources: Mapping[UnitKey, EnergySource]) -> Case:
    """The case with what drives its units."""
    generators = tuple(
        replace(g, source=sources[g.key]) if g.key in sources else g for g in case.generators
    )
    return replace(case, generators=generators)
