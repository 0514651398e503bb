"""Edits of load and generation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from gridfold.dynamics.device import Device
from gridfold.editing.edit import Edited
from gridfold.errors import OptionError
from gridfold.grid.case import Case, Load
from gridfold.grid.event_checks import chosen_buses, place_text
from gridfold.grid.redispatch import Redispatch

_COMPONENTS = (
    "active_mw",
    "reactive_mvar",
    "current_active_mw",
    "current_reactive_mvar",
    "impedance_active_mw",
    "impedance_reactive_mvar",
)


@dataclass(frozen=True)
class ScaleLoad:
    """Loads in service are scaled, active and reactive power alike.

    Parameters
    ----------
    factor : float, optional
        What they are multiplied by; 0 or more.
    active_mw : float, optional
        Or what they draw together then at stored voltages, in MW.
    buses, areas, zones : str
        Where they are, such as ``1-36,78``; all that one of them names. Without any: everywhere.
    """

    factor: float | None = None
    active_mw: float | None = None
    buses: str = ""
    areas: str = ""
    zones: str = ""

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """All components of the loads are multiplied."""
        buses = None
        where = "everywhere"
        if self.buses or self.areas or self.zones:
            where = f"in {place_text(self.buses, self.areas, self.zones)}"
            buses = chosen_buses("loads", case, self.buses, self.areas, self.zones)
        chosen = [
            load for load in case.loads if load.in_service and (buses is None or load.bus in buses)
        ]
        if not chosen:
            raise OptionError(f"there is no load in service {where}")
        before = sum(case.stored_power(load).real for load in chosen)
        factor = self._factor(before, where)
        names = {str(load) for load in chosen}
        loads = tuple(_scaled(load, factor) if str(load) in names else load for load in case.loads)
        count = "1 load" if len(chosen) == 1 else f"{len(chosen)} loads"
        text = f"{count} {where} from {before:.6g} to {factor * before:.6g} MW"
        return Edited(replace(case, loads=loads), text, tuple(sorted(names)))

    def _factor(self, before: float, where: str) -> float:
        if (self.factor is None) == (self.active_mw is None):
            raise OptionError("give factor or active_mw, one of the two")
        if self.factor is not None:
            if not (math.isfinite(self.factor) and self.factor >= 0):
                raise OptionError(f"factor must be 0 or more, not {self.factor!r}")
            return self.factor
        wanted = self.active_mw or 0.0
        if not (math.isfinite(wanted) and wanted >= 0):
            raise OptionError(f"active_mw must be 0 or more, not {wanted!r}")
        if before <= 0:
            raise OptionError(
                f"loads {where} draw {before:.6g} MW: no factor brings them to {wanted:g} MW"
            )
        return wanted / before


@dataclass(frozen=True)
class Dispatch(Redispatch):
    """The event :class:`gridfold.Redispatch`, as a change of the case itself."""

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """Units give so much more power."""
        after = self.dispatched(case)
        pairs = zip(case.generators, after.generators, strict=True)
        names = tuple(str(new) for old, new in pairs if new != old)
        (change,) = self.changes(case)
        return Edited(after, change.label, names)


def _scaled(load: Load, factor: float) -> Load:
    values: dict[str, Any] = {name: getattr(load, name) * factor for name in _COMPONENTS}
    return replace(load, **values)
