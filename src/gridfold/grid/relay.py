"""What a relay is: a monitor of a run that acts when what it watches stays beyond a threshold.

A relay consists of elements: a measurement, a delay, and what is done to the network state once the
measurement has been picked up for the delay. Each element acts once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.change import Change
from gridfold.grid.measurements import Measurement
from gridfold.grid.network_state import NetworkState


@dataclass(frozen=True)
class Element:
    """Part of a relay that acts on its own.

    Parameters
    ----------
    label : str
        What notices say once it acts.
    measurement : Measurement
        What it watches.
    delay : float
        Time in seconds for which it has to be picked up.
    act : callable
        What it does to the network state.
    buses : tuple of int
        Where it acts.
    """

    label: str
    measurement: Measurement
    delay: float
    act: Callable[[NetworkState], NetworkState]
    buses: tuple[int, ...]

    def change(self, time: float) -> Change:
        """What it does at `time` (s)."""
        return Change(time, self.label, self.act, self.buses)


class Relay:
    """What relays share: they change nothing by themselves, but are checked with the events."""

    def elements(self, case: Case) -> list[Element]:
        """Its parts; raises :class:`EventError` if something is not in the case."""
        raise NotImplementedError

    def changes(self, case: Case) -> list[Change]:
        """Nothing; raises :class:`EventError` if something is not in the case."""
        self.elements(case)
        return []


def require_positive(where: str, **sizes: float) -> None:
    """Raise unless all sizes are positive numbers."""
    for name, size in sizes.items():
        if not (math.isfinite(size) and size > 0):
            raise EventError(f"{where}: {name} must be a positive number, not {size!r}")
