"""Clearing times that were found: of one fault, and of the faults of a map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from gridfold.cards import Card
from gridfold.errors import require_list
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.events import BranchFault, BusFault
from gridfold.systems.status import Status

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Fault = BusFault | BranchFault


def require_faults(faults: object) -> None:
    """Raise an OptionError unless these are faults."""
    require_list(faults, lambda item: isinstance(item, Fault), "faults", "[gridfold.BusFault(3)]")


@dataclass(frozen=True, repr=False)
class ClearingTime(Card):
    """Critical clearing time of one fault.

    Parameters
    ----------
    fault : BusFault or BranchFault
        The fault; its duration is the critical clearing time.
    seconds : float
        Largest clearing time of the grid for which no machine loses synchronism; 0 if there is none,
        NaN if it could not be found.
    bounded : bool
        False if even the longest clearing time that was tried is stable.
    runs : int
        Simulations made.
    lost_at : float, optional
        Shortest clearing time of the grid that was not stable, in seconds; None if there is none.
    machine : UnitKey, optional
        Machine that loses synchronism first then, or is off speed.
    status : Status, optional
        How that run ended.
    reason : str
        Why the time could not be found; empty if it was.
    """

    fault: Fault
    seconds: float
    bounded: bool
    runs: int = field(compare=False)
    lost_at: float | None = None
    machine: UnitKey | None = None
    status: Status | None = None
    reason: str = ""

    @property
    def failed(self) -> bool:
        """Whether it could not be found."""
        return bool(self.reason)

    def _facts(self) -> dict[str, object]:
        from gridfold.runs.clearing.rows import place_of

        place: dict[str, object] = {"title": place_of(self.fault)}
        if self.failed:
            return place | {"not found": self.reason}
        least = "" if self.bounded else "at least "
        facts = place | {"seconds": f"{least}{self.seconds:g}", "runs": self.runs}
        if self.lost_at is not None:
            facts["lost at"] = f"{self.lost_at:g} s"
        return facts if self.machine is None else facts | {"first machine": str(self.machine)}


@dataclass(frozen=True, repr=False)
class ClearingTimes(Card, Sequence[ClearingTime]):
    """Critical clearing times of the faults of a map, in the order in which they were asked for.

    It is a sequence of :class:`ClearingTime`.

    Parameters
    ----------
    case : Case
        The grid.
    items : tuple of ClearingTime
        What was found.
    waiting : tuple of BusFault or BranchFault
        Faults whose times are not known yet: the work was broken off.
    settings : mapping
        What the times hang on, ready for JSON: grid of times, runs, rule, criterion.
    together : str
        How the runs were made: side by side, or why not.
    """

    case: Case
    items: tuple[ClearingTime, ...]
    waiting: tuple[Fault, ...]
    settings: Mapping[str, Any]
    together: str

    def __len__(self) -> int:
        return len(self.items)

    @overload
    def __getitem__(self, position: int) -> ClearingTime: ...

    @overload
    def __getitem__(self, position: slice) -> tuple[ClearingTime, ...]: ...

    def __getitem__(self, position: int | slice) -> ClearingTime | tuple[ClearingTime, ...]:
        return self.items[position]

    @property
    def failed(self) -> tuple[ClearingTime, ...]:
        """Those that could not be found."""
        return tuple(item for item in self.items if item.failed)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A row of each, ready for JSON; its columns are those of :meth:`frame`."""
        from gridfold.runs.clearing.rows import clearing_row

        return [clearing_row(self.case, item) for item in self.items]

    def frame(self) -> pd.DataFrame:
        """A row of each: place, voltage level, clearing time, bracket, machine, runs.

        Times are in seconds; what does not apply is missing.
        """
        from gridfold.runs.clearing.rows import clearing_frame

        return clearing_frame(self.rows)

    def plot(self) -> Figure:
        """The map of the grid in the colours of the clearing times, and the shortest as bars.

        Returns
        -------
        matplotlib.figure.Figure
            Shown by a notebook, saved by its ``savefig``.
        """
        from gridfold.report.clearing_plot import draw_clearing_times
        from gridfold.report.clearing_record import clearing_record

        return draw_clearing_times(clearing_record(self.about, self.rows))

    def report(self, path: str | Path) -> None:
        """Write one HTML page that needs no network: map, bars, a table of all places."""
        from gridfold.report.clearing_record import clearing_record
        from gridfold.report.clearing_report import write_clearing_report

        write_clearing_report(clearing_record(self.about, self.rows), Path(path))

    @property
    def about(self) -> dict[str, Any]:
        """What the times are about, ready for JSON: case, settings, places that wait, the grid."""
        from gridfold.runs.clearing.rows import about_times

        return about_times(self.case, self.settings, len(self.items) + len(self.waiting))

    def _facts(self) -> dict[str, object]:
        known = [item for item in self.items if not item.failed]
        worst = min(known, key=lambda item: item.seconds, default=None)
        return {
            "case": self.case.name,
            "places": f"{len(self.items)} of {len(self.items) + len(self.waiting)}",
            "shortest": "none" if worst is None else f"{worst.seconds:g} s",
            "never lost": sum(not item.bounded for item in known),
            "failed": len(self.failed),
        }
