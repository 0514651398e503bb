"""Counts what became of records of dynamics data that were not taken over as they are."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from gridfold.dynamics.psse_models import LOAD_SUFFIXES, Kind, kind_of
from gridfold.grid.case import Case, Load, UnitKey
from gridfold.grid.replacement import Replacement


def replacement(case: Case, model: str, outcome: str, units: Sequence[UnitKey]) -> Replacement:
    """A replacement with the power that it touches."""
    of = "generation"
    power = {g.key: abs(g.active_mw) for g in case.generators if g.in_service}
    touched = sum(power.get(unit, 0.0) for unit in set(units))
    total = sum(power.values())
    if kind_of(model, {}) is Kind.LOAD:
        of = "load"
        loads = [load for load in case.loads if load.in_service]
        covered = [load for load in loads if any(covers(case, model, u, load) for u in units)]
        touched = sum(abs(case.stored_power(load).real) for load in covered)
        total = sum(abs(case.stored_power(load).real) for load in loads)
    return Replacement(model, outcome, tuple(units), touched, touched / total if total else 0.0, of)


def load_suffix(model: str) -> str:
    """What a load model belongs to: one of :data:`~gridfold.dynamics.psse_models.LOAD_SUFFIXES`."""
    return next((s for s in LOAD_SUFFIXES if model.removesuffix("U1").endswith(s)), "BL")


def covers(case: Case, model: str, place: UnitKey, load: Load) -> bool:
    """Whether the record of a load model at `place` speaks of a load."""
    bus = case.buses[case.bus_index[load.bus]]
    of = {
        "BL": load.bus,
        "OW": load.owner or bus.owner,
        "ZN": load.zone or bus.zone,
        "AR": load.area or bus.area,
        "AL": place.bus,
    }
    return of[load_suffix(model)] == place.bus and place.id in (load.id, "*")


@dataclass
class Tally:
    """Counts outcomes; the order of the first of each is kept."""

    case: Case
    units: dict[tuple[str, str], list[UnitKey]] = field(default_factory=lambda: defaultdict(list))

    def add(self, model: str, outcome: str, unit: UnitKey) -> None:
        """Count a record."""
        self.units[model, outcome].append(unit)

    def replacements(self) -> tuple[Replacement, ...]:
        """One for every model and outcome."""
        return tuple(replacement(self.case, *name, units) for name, units in self.units.items())
