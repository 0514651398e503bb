"""Frequencies of the islands of a run against a band."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from gridfold.grid.criteria import FrequencyBand
from gridfold.runs.criteria.course import Course
from gridfold.runs.criteria.finding import Finding, Verdict
from gridfold.runs.criteria.spells import Spells
from gridfold.runs.criteria.voltage import GRAIN
from gridfold.runs.island_figures import FrequencyRange, island_frequencies, range_of
from gridfold.runs.parts import Part

_SIGNAL, _WHERE = "frequency_hz", "the centre of inertia of an island"


@dataclass
class FrequencyWatch:
    """Takes the parts of a run: the lowest and the highest frequency of all islands at each time."""

    criterion: FrequencyBand
    course: Course
    nominal: float
    spells: Spells = field(default_factory=lambda: Spells(2))
    range: FrequencyRange | None = None

    def take(self, part: Part) -> None:
        """The next part of the run."""
        here = island_frequencies(part)
        if not here.size:
            return
        low, high = here.min(axis=1), here.max(axis=1)
        beyond = np.stack([low < self._lowest, high > self._highest], axis=1)
        self.spells.take(part.times, beyond)
        found = range_of(part.times, here)
        self.range = self.range.joined(found) if self.range else found

    def finding(self) -> Finding:
        """What they came to."""
        if self.range is None:
            return Finding(self.criterion, Verdict.OPEN, told="no machine is in service")
        self.spells.finish(self.course.end)
        return self._spell(self.range) if self.criterion.longest > 0 else self._extreme(self.range)

    @property
    def _lowest(self) -> float:
        return -inf if self.criterion.lowest_hz is None else self.criterion.lowest_hz

    @property
    def _highest(self) -> float:
        return inf if self.criterion.highest_hz is None else self.criterion.highest_hz

    def _extreme(self, found: FrequencyRange) -> Finding:
        below = (found.lowest_hz - self._lowest) / (self.nominal - self._lowest)
        above = (self._highest - found.highest_hz) / (self._highest - self.nominal)
        low = self._highest == inf or (self._lowest > -inf and below <= above)
        value, limit = (found.lowest_hz, self._lowest) if low else (found.highest_hz, self._highest)
        at = found.lowest_at if low else found.highest_at
        margin = value - limit if low else limit - value
        verdict = Verdict.VIOLATED if margin < 0 else Verdict.KEPT
        told = f"{'lowest' if low else 'highest'} frequency {value:.3f} Hz at {at:g} s"
        share = below if low else above
        finding = Finding(
            self.criterion, verdict, value, limit, margin, share, "Hz", _SIGNAL, _WHERE, at, told
        )
        return self.course.answer(finding)

    def _spell(self, found: FrequencyRange) -> Finding:
        spells, limit = self.spells, self.criterion.longest
        k = int(spells.longest.argmax())
        value, at = float(spells.longest[k]), float(spells.longest_from[k])
        told = f"{('below', 'above')[k]} the band for {value:.4g} s from {at:g} s on"
        if not value:
            told = f"never outside; {found.lowest_hz:.3f} to {found.highest_hz:.3f} Hz"
        verdict = Verdict.VIOLATED if value > limit + GRAIN else Verdict.KEPT
        if verdict is Verdict.KEPT and spells.open.any():
            verdict, told = Verdict.OPEN, f"{told}, until the end of the run"
        margin = limit - value
        finding = Finding(
            self.criterion,
            verdict,
            value,
            limit,
            margin,
            margin / limit,
            "s",
            _SIGNAL,
            _WHERE,
            at if value else None,
            told,
        )
        return self.course.answer(finding)
