"""What became of records of dynamics data that were not taken over as they are, in figures."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from gridfold.dynamics.psse_models import LOAD_SUFFIXES, Kind, kind_of
from gridfold.grid.case import Case, Load, UnitKey


@dataclass(frozen=True)
class Replacement:
    """What became of the records of one model.

    Parameters
    ----------
    model : str
        Name in PSS/E.
    outcome : str
        What became of them.
    units : tuple of UnitKey
        Bus and id of each record.
    active_mw : float
        Stored power of these units in service in MW, magnitudes added up; for load models, of loads.
    share : float
        Part of all generation, or of all load, in service.
    of : str
        ``"generation"`` or ``"load"``.
    """

    model: str
    outcome: str
    units: tuple[UnitKey, ...]
    active_mw: float = 0.0
    share: float = 0.0
    of: str = "generation"

    @property
    def count(self) -> int:
        """Number of records."""
        return len(self.units)

    @property
    def extent(self) -> str:
        """Number, power and the first unit, in words."""
        power = f", {self.active_mw:.1f} MW ({self.share:.1%} of {self.of})"
        words = [power] if self.active_mw else []
        if self.count == 1:
            return "".join([f"1 record at {self.units[0]}", *words])
        return "".join([f"{self.count} records", *words, f", first {self.units[0]}"])

    def __str__(self) -> str:
        return f"{self.model}: {self.outcome}; {self.extent}"


def replacement(case: Case, model: str, outcome: str, units: Sequence[UnitKey]) -> Replacement:
    """A replacement with the power that it touches."""
    of = "generation"
    power = {g.key: abs(g.active_mw) for g in case.generators if g.in_service}
    touched = sum(power.get(unit, 0.0) for unit in set(units))
    total = sum(power.values())
    if kind_of(model, {}) is Kind.LOAD:
        of = "load"
        loads = [load for load in case.loads if load.in_service]
        covered = [load for load in loads if any(_covers(case, model, u, load) for u in units)]
        touched = sum(abs(load.active_mw) for load in covered)
        total = sum(abs(load.active_mw) for load in loads)
    return Replacement(model, outcome, tuple(units), touched, touched / total if total else 0.0, of)


def _covers(case: Case, model: str, place: UnitKey, load: Load) -> bool:
    """Whether a load model speaks of a load; owners are not known, so all may be theirs."""
    suffix = next((s for s in LOAD_SUFFIXES if model.removesuffix("U1").endswith(s)), "BL")
    bus = case.buses[case.bus_index[load.bus]]
    return {
        "BL": load.bus == place.bus and place.id in (load.id, "*"),
        "AR": bus.area == place.bus,
        "ZN": bus.zone == place.bus,
    }.get(suffix, True)


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
