"""What became of dynamic data that were not taken over as they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gridfold.grid.case import UnitKey


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

    def record(self) -> dict[str, Any]:
        """Its figures, ready for JSON."""
        return {
            "model": self.model,
            "outcome": self.outcome,
            "records": self.count,
            "first": str(self.units[0]),
            "active_mw": self.active_mw,
            "share": self.share,
            "of": self.of,
        }

    def __str__(self) -> str:
        return f"{self.model}: {self.outcome}; {self.extent}"
