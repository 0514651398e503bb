"""Limits that a small model does not know of, or cannot follow."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.unit_limits import StateLimits, limit_names, limits_passed, state_limits
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.numerics.watch import BoxWatch
from gridfold.runs.notices import Notice
from gridfold.simulation.segment import Piece

#: Samples of a linear phase at which limits that are not watched are looked at: every one of so many.
_EVERY = 5
#: What a held state may move, in p.u. and in parts of its limit, within so many seconds.
LET_GO, LET_GO_TIME = 1e-2, 0.1
_LISTED = 3


@dataclass(frozen=True)
class LinearLimits:
    """Limits of the units of a small model on which they do not act as they should.

    Parameters
    ----------
    model : DetailedModel
        The whole system in the network state of the small model.
    small : SmallModel
        The small model.
    direct : StateLimits
        Those that bound a state: they are watched while the small model is stepped.
    others : frozenset of str
        Names of the others, which are looked at between phases and after the run.
    watch : BoxWatch or None
        Holds when a state is beyond its limit by more than the tolerance.
    held : StateLimits
        Limits that hold a state at the operating point: in the small model it stands still.
    """

    model: DetailedModel
    small: SmallModel
    direct: StateLimits
    others: frozenset[str]
    watch: BoxWatch | None
    held: StateLimits

    def reached(self, x: NDArray[np.float64], inside: bool) -> tuple[str, ...]:
        """Names of the limits in the way of the small model at the whole system's state `x`.

        With `inside` it has to be inside the limits and none may act, before and after restriction
        to the small model; without, it must not be beyond them.
        """
        coordinates = self.small.coordinates
        states = [x, coordinates.lift(coordinates.restrict(x))] if inside else [x]
        slack = -1.0 if inside else 0.5
        found = {
            name
            for state in states
            for name, beyond in zip(
                self.direct.names, self.direct.beyond(state) / self.direct.tolerance, strict=True
            )
            if beyond > slack
        }
        names = self.others | set(self.direct.names) if inside else self.others
        found |= set(self._let_go(x[None, :]))
        return tuple(sorted(found | set(self._acting(np.array(states), names))))

    def let_go(self, piece: Piece) -> dict[str, float]:
        """Limits that would have let go of what they hold in a linear phase, and when (s)."""
        rows = slice(0, max(len(piece.times) - 1, 1), _EVERY)
        found = self._let_go(piece.segment.lift(piece.states[rows])) if self.held.names else {}
        return {name: float(piece.times[rows][first]) for name, first in found.items()}

    def _let_go(self, states: NDArray[np.float64]) -> dict[str, int]:
        """Held limits whose state is, or would soon be, away from them; the first row of `states`."""
        held = self.held
        if not held.names:
            return {}
        allowed = LET_GO * np.maximum(np.abs(held.bound), 1.0)
        away = np.array([-held.beyond(x) for x in states])
        rates = np.array([-held.side * self.model.compiled(x)[held.index] for x in states])
        gone = (away > allowed) | (LET_GO_TIME * rates > allowed)
        return {
            name: int(np.argmax(rows))
            for name, rows in zip(held.names, gone.T, strict=True)
            if rows.any()
        }

    def passed(self, piece: Piece, all_of_them: bool) -> dict[str, float]:
        """Limits that a linear phase passed, and when (s): all, or those that are not watched."""
        names = self.others | set(self.direct.names) if all_of_them else self.others
        rows = slice(0, max(len(piece.times) - 1, 1), _EVERY)
        states = piece.segment.lift(piece.states[rows]) if names else np.zeros((0, 0))
        found = self._acting(states, names)
        return {name: float(piece.times[rows][first]) for name, first in found.items()}

    def _acting(self, states: NDArray[np.float64], names: Collection[str]) -> dict[str, int]:
        """Those of `names` that act at one of the states, and the first row at which they do."""
        if not names:
            return {}
        found = limits_passed(self.model, states, self.small.unlimited)
        return {name: int(np.argmax(acts)) for name, acts in found.items() if name in names}


def linear_limits(
    model: DetailedModel,
    small: SmallModel,
    origin: NDArray[np.float64],
    without: Collection[str],
) -> LinearLimits | None:
    """Limits that do not act as they should in `small`, linearized about `origin`; None if none.

    Those named `without` are held at the operating point: it is only asked whether they let go.
    """
    units = small.unlimited
    every = state_limits(model, origin, units, small.followed)
    held = every.only(set(without))
    everything = set(limit_names(model, units)) - {*without, *small.followed}
    if not everything and not held.names:
        return None
    direct = every.only(everything)
    others = frozenset(everything - set(direct.names))
    return LinearLimits(model, small, direct, others, _box(small, direct), held)


def _box(small: SmallModel, limits: StateLimits) -> BoxWatch | None:
    """The limits, with their tolerance, as ranges over the small system's states."""
    if not limits.names:
        return None
    index, place = np.unique(limits.index, return_inverse=True)
    lower, upper = np.full(len(index), -np.inf), np.full(len(index), np.inf)
    highest = limits.side > 0
    ends = limits.bound + limits.side * limits.tolerance
    np.minimum.at(upper, place[highest], ends[highest])
    np.maximum.at(lower, place[~highest], ends[~highest])
    origin, slopes = small.rows(index)
    return BoxWatch(slopes.toarray(), lower - origin, upper - origin)


def passed_notices(phases: Iterable[Mapping[str, float]]) -> list[Notice]:
    """Limits that linear phases passed, each once, in order of the time at which that was seen."""
    first: dict[str, float] = {}
    for passed in phases:
        first = {**passed, **first}
    names: dict[float, list[str]] = {}
    for name, time in sorted(first.items(), key=lambda item: item[1]):
        names.setdefault(time, []).append(name)
    return [
        Notice(
            time,
            f"the small model has no limit here, so that its curves are wrong beyond: {listed(group)}",
        )
        for time, group in names.items()
    ]


def let_go_notices(phases: Iterable[Mapping[str, float]]) -> list[Notice]:
    """Held limits that would have let go in linear phases, each when that was first seen."""
    first: dict[str, float] = {}
    for found in phases:
        first = {**found, **first}
    return [
        Notice(time, f"would let go of what a small model holds at this limit: {name}")
        for name, time in sorted(first.items(), key=lambda item: item[1])
    ]


def light_notices(used: Mapping[Mode, float], errors: Mapping[Mode, float]) -> list[Notice]:
    """Models in which limits are passed over, `used` from a time (s) on; `errors` in degrees."""
    return [
        Notice(
            time,
            f"in the {mode.value} model limits of linear machines are passed over: in sample swings "
            f"that moves rotor angles of the study area by {errors[mode]:.2g} degrees",
        )
        for mode, time in used.items()
    ]


def origin_notice(time: float, names: Sequence[str]) -> Notice:
    """What linearization makes of limits that act at the operating point."""
    return Notice(
        time,
        "limits at which the operating point is, so that linear models are right on one side of them "
        f"at most: {listed(names)}",
    )


def listed(names: Sequence[str]) -> str:
    """The first few of many."""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more
