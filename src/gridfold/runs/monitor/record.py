"""What a table keeps of the grid: columns can be chosen by areas, levels and names later on."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from typing import Any

from gridfold.grid.case import Case
from gridfold.grid.selection_text import as_ranges

_GROUPS = {"area": "area", "zone": "zone", "owner": "owner", "kv": "base_kv"}
_NAMES = ("area_names", "zone_names", "owner_names")


def columns_record(
    case: Case, about: Collection[int], study: Collection[int] | None = None
) -> dict[str, Any]:
    """Areas, zones, owners, levels and names of the buses that columns are `about`, ready for JSON."""
    buses = [bus for bus in case.buses if bus.number in about]
    record: dict[str, Any] = {}
    for key, attribute in _GROUPS.items():
        groups: dict[float, list[int]] = defaultdict(list)
        for bus in buses:
            groups[getattr(bus, attribute)].append(bus.number)
        record[key] = {f"{value:g}": as_ranges(numbers) for value, numbers in groups.items()}
    record["names"] = {str(bus.number): bus.name for bus in buses if bus.name}
    record |= {key: {str(n): name for n, name in getattr(case, key).items()} for key in _NAMES}
    record["study_buses"] = None if study is None else as_ranges(study)
    return record
