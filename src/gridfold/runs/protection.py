"""Relays in a run: when they are picked up, and what they do once they have been for their delay.

They are looked at in the rows of a run. When a margin passes zero is found by a straight line between
two rows, so a relay acts at its own instant, whatever the step: the segment then ends there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.grid.change import Change, Event
from gridfold.grid.measurements import Blinders
from gridfold.grid.relays import Element, relays_of_run
from gridfold.runs.measuring import Meter
from gridfold.simulation.segment import Coordinates
from gridfold.systems.protocol import System

#: Times closer than this (s) are one instant.
_INSTANT = 1e-9


@dataclass
class Protection:
    """All elements of relays in one run, and what they remember.

    `since` (n, 2) is when each was picked up, NaN where it is not: of blinders when the impedance came
    within the outer and the inner ones, of others the same twice.
    """

    model: DetailedModel
    elements: Sequence[Element]
    since: NDArray[np.float64] = field(init=False)
    done: NDArray[np.bool_] = field(init=False)
    acting: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        n = len(self.elements)
        self.meter = Meter(self.model, [element.measurement for element in self.elements])
        self.since = np.full((n, 2), np.nan)
        self.done = np.zeros(n, dtype=bool)
        self._delay = np.array([element.delay for element in self.elements])
        blinders = [isinstance(element.measurement, Blinders) for element in self.elements]
        self._swings = np.array(blinders, dtype=bool)

    def actions(
        self,
        time: float,
        model: DetailedModel,
        system: System,
        coordinates: Coordinates | None,
        z: NDArray[np.float64],
    ) -> list[Change]:
        """What relays do at `time`, at the state `z` of `system` on the network of `model`.

        What was found to act at the end of the last rows does, whatever the network is now.
        """
        found, self.acting = self.acting, []
        if not found:
            picked_up = self.meter.margins(model, system, coordinates, z[None, :])[0] >= 0
            self.since = np.where(picked_up, np.fmin(self.since, time), np.nan)
            due = self._due() <= time + _INSTANT
            found = np.flatnonzero(due & ~self.done).tolist()
        self.done[found] = True
        return [self.elements[k].change(time) for k in found]

    def look(self, times: NDArray[np.float64], margins: NDArray[np.float64]) -> float | None:
        """When the first relay acts in these rows, which then is noted; None where none does."""
        for row in range(1, len(times)):
            start, end = times[row - 1], times[row]
            before, after = margins[row - 1], margins[row]
            rises = (before < 0) & (after >= 0)
            falls = (before >= 0) & (after < 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                passed = start + (end - start) * before / (before - after)
            self.since[rises] = passed[rises]
            until = np.where(falls, passed, end)[:, 1]
            due = np.where(self.done, np.inf, self._due())
            acts = due <= until + _INSTANT
            if acts.any():
                first = float(max(due[acts].min(), start + _INSTANT))
                self.acting = np.flatnonzero(acts & (due <= first + _INSTANT)).tolist()
                return min(first, float(end))
            self.since[falls] = np.nan
        return None

    def monitor(
        self, model: DetailedModel, system: System, coordinates: Coordinates | None
    ) -> _Monitor:
        """What looks at the rows of a segment of `system` on the network of `model`."""
        return _Monitor(self, model, system, coordinates)

    def _due(self) -> NDArray[np.float64]:
        """When each element acts, if it stays picked up; infinite where it is not."""
        outer, inner = self.since.T
        swing = np.where(inner - outer >= self._delay - _INSTANT, inner, np.inf)
        due = np.where(self._swings, swing, inner + self._delay)
        return np.where(np.isnan(due), np.inf, due)


@dataclass(frozen=True)
class _Monitor:
    """Protection on one segment."""

    protection: Protection
    model: DetailedModel
    system: System
    coordinates: Coordinates | None

    def look(self, times: NDArray[np.float64], states: NDArray[np.float64]) -> float | None:
        """When a relay acts."""
        margins = self.protection.meter.margins(self.model, self.system, self.coordinates, states)
        return self.protection.look(times, margins)


def protection_among(events: Sequence[Event], model: DetailedModel) -> Protection | None:
    """The relays among the events of a run of `model`, and those of its case; None without."""
    elements = [
        e for relay in relays_of_run(events, model.case) for e in relay.elements(model.case)
    ]
    return Protection(model, elements) if elements else None
