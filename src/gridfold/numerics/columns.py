"""Many systems of one form stepped side by side, each along a time grid of its own.

The state of member `b` is column `b` of an array of shape (n_states, members). All members take a
step at once, but every one its own: where an event cuts its step short it is short for that member
alone, so that it goes through the same states as if it ran by itself. A member whose history is too
short for the Adams rule takes Runge-Kutta steps while the others do not wait for it.

The steps are those of :mod:`gridfold.numerics.steppers.rk4` and :mod:`gridfold.numerics.steppers.abm4`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.compiled import FAST, compiled_part, invoke, jit
from gridfold.numerics.lanes import (
    WIDTH,
    aligned,
    aligned_zeros,
    all_lanes,
    beyond_lanes,
    load_lanes,
    size_lanes,
    store_lanes,
)
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.watch import SpreadWatch, Watch, first_watch, pack_watches

#: What may be said of a member after a step.
GOES_ON, BEYOND, NOT_FINITE = range(3)
_MILNE = 19 / 270


@dataclass
class Spread:
    """A :class:`SpreadWatch` of each member, over the same entries of its state.

    Parameters
    ----------
    index : ndarray of int, shape (n,)
        Positions of the entries in the state vector.
    share : ndarray, shape (n_groups, n, members)
        Part of each entry in the reference of its group; zero where that is fixed.
    member_of : ndarray, shape (n_groups, n, members)
        1 where an entry is of the group.
    fixed : ndarray, shape (n_groups, members)
        The reference where it is fixed, else zero.
    limit : ndarray, shape (n, members)
        Largest distance allowed; infinite where an entry is not watched.
    """

    index: NDArray[np.int64]
    share: NDArray[np.float64]
    member_of: NDArray[np.float64]
    fixed: NDArray[np.float64]
    limit: NDArray[np.float64]

    @classmethod
    def over(cls, index: NDArray[np.int64], members: int) -> Spread:
        """One that watches nothing yet."""
        n = len(index)
        return cls(
            index,
            aligned_zeros(1, n, members),
            aligned_zeros(1, n, members),
            aligned_zeros(1, members),
            aligned(np.full((n, members), np.inf)),
        )

    def put(self, member: int, watch: SpreadWatch | None) -> None:
        """From now on `watch`, whose entries are among those of the index, holds for `member`."""
        groups = 0 if watch is None else len(watch.reference)
        self._make_room(groups)
        for part in (self.share, self.member_of):
            part[:, :, member] = 0.0
        self.fixed[:, member] = 0.0
        self.limit[:, member] = np.inf
        if watch is None:
            return
        at = np.searchsorted(self.index, watch.index)
        self.limit[at, member] = watch.limit
        self.member_of[watch.group, at, member] = 1.0
        total = np.bincount(watch.group, watch.weight, groups)
        free = np.isnan(watch.reference)
        part = watch.weight / np.where(total, total, 1.0)[watch.group]
        self.share[watch.group, at, member] = np.where(free[watch.group], part, 0.0)
        self.fixed[:groups, member] = np.where(free, 0.0, watch.reference)

    def _make_room(self, groups: int) -> None:
        known = len(self.fixed)
        if groups <= known:
            return
        before = self.share, self.member_of, self.fixed
        self.share, self.member_of, self.fixed = (
            aligned_zeros(groups, *part.shape[1:]) for part in before
        )
        for part, there in zip((self.share, self.member_of, self.fixed), before, strict=True):
            part[:known] = there


@dataclass(frozen=True)
class Observer:
    """Looks at all members at the beginning of each step.

    A function of the right-hand side's signature at `address` is called behind it, with its scratch
    space and the states; the rows at which the members stand are the first of `reals`.
    """

    address: int
    integers: NDArray[np.int64]
    reals: NDArray[np.float64]
    scratch: NDArray[np.float64]


@dataclass
class Columns:
    """Members that are stepped side by side.

    Parameters
    ----------
    rhs : CompiledRhs
        Right-hand side of all of them.
    members : int
        How many, a multiple of eight.
    length : int
        Rows that a member has at most.
    step : float
        The full step in seconds.
    adams : bool
        Whether full steps follow the Adams rule once there is a history, else Runge-Kutta's.
    kept : ndarray of int, shape (m,)
        Entries of the state that are kept along the run.
    watches : sequence of Spread
        What ends the run of a member.
    observer : Observer, optional
        What looks on.
    judges : sequence of Watch
        Conditions on the whole state of a member, of any kind, that end its segment. Every entry of
        the state is then to be kept, in order.
    """

    rhs: CompiledRhs
    members: int
    length: int
    step: float
    adams: bool
    kept: NDArray[np.int64]
    watches: tuple[Spread, Spread]
    observer: Observer | None
    judges: Sequence[Watch] = ()
    x: NDArray[np.float64] = field(init=False)
    times: NDArray[np.float64] = field(init=False)
    row: NDArray[np.int64] = field(init=False)
    last: NDArray[np.int64] = field(init=False)
    history: NDArray[np.int64] = field(init=False)
    verdict: NDArray[np.int64] = field(init=False)
    fired: NDArray[np.int64] = field(init=False)
    record: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        n, members = self.rhs.n_states, self.members
        self.x = aligned_zeros(n)
        self.times = np.zeros((members, self.length))
        self.row, self.last, self.history, self.verdict, self.fired = np.zeros(
            (5, members), dtype=np.int64
        )
        self.record = np.empty((members, self.length, len(self.kept)))
        self._work, self._ring = aligned_zeros(self.rhs.work_size), np.zeros(1, dtype=np.int64)
        self._slopes = aligned_zeros(4 if self.adams else 1, n)
        self._stage, self._slope, self._sum = aligned_zeros(3, n)
        self._table, self._judge_integers, reals = pack_watches(self.judges, len(self.kept))
        self._fresh, self._judge_reals = reals, np.tile(reals, (members, 1))

    @property
    def states(self) -> NDArray[np.float64]:
        """States, shape (n_states, members)."""
        return self.x.reshape(-1, self.members)

    def begin(self, member: int, times: NDArray[np.float64], x: NDArray[np.float64]) -> None:
        """A new member in the place of another one, with all rows of its run."""
        self.states[:, member] = x
        self.times[member, : len(times)] = times
        self.verdict[member] = GOES_ON
        self.enter(member, 0, 0)

    def enter(self, member: int, first: int, last: int) -> None:
        """The next segment of a member, from one row to another; it stands there if they are one."""
        self.row[member], self.last[member], self.history[member] = first, last, 0
        self.fired[member], self._judge_reals[member] = 0, self._fresh
        self.record[member, first] = self.states[self.kept, member]

    def advance(self) -> None:
        """Step until a member is at the end of its segment, or its run has ended."""
        angles, speeds = self.watches
        _advance(
            self.rhs.address, self.rhs.integers, self.rhs.reals, self._work, self.members,
            self.step, self.adams, self.x, self.times, self.row, self.last, self.history,
            self.verdict, self.kept, self.record, self._ring, self._slopes, self._stage,
            self._slope, self._sum, angles.index, angles.share.ravel(), angles.member_of.ravel(),
            angles.fixed.ravel(), angles.limit.ravel(), speeds.index, speeds.share.ravel(),
            speeds.member_of.ravel(), speeds.fixed.ravel(), speeds.limit.ravel(),
            self._table, self._judge_integers, self._judge_reals, self.fired, *self._observer,
        )  # fmt: skip

    def look(self) -> None:
        """Let the observer look at all members where they stand."""
        _look(
            self.rhs.address, self.rhs.integers, self.rhs.reals, self._work, self.x, self._slope,
            self.row, *self._observer,
        )  # fmt: skip

    @property
    def _observer(self) -> tuple[int, NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Address and data of the observer; an address of 0 where there is none."""
        if self.observer is None:
            return 0, np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
        seen = self.observer
        return seen.address, seen.integers, seen.reals, seen.scratch


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _look(address, integers, reals, work, x, f, row, observer, o_integers, o_reals, o_scratch):
    invoke(address, (integers, reals, work, x, f))
    for b in range(len(row)):
        o_reals[b] = row[b]
    invoke(observer, (o_integers, o_reals, work, x, o_scratch))


@compiled_part
def _judge(x, members, index, share, member_of, fixed, limit, above):
    """Add to `above` (members,) where an entry is beyond its limit."""
    n, n_groups = len(index), len(fixed) // members
    for b in range(0, members, WIDTH):
        found = load_lanes(above, b)
        if n_groups == 1:
            reference = load_lanes(fixed, b)
            for i in range(n):
                value = load_lanes(x, index[i] * members + b)
                reference = reference + load_lanes(share, i * members + b) * value
            for i in range(n):
                value = load_lanes(x, index[i] * members + b)
                apart = size_lanes(value - reference)
                found = found + beyond_lanes(apart, load_lanes(limit, i * members + b))
        else:
            for g in range(n_groups):
                reference = load_lanes(fixed, g * members + b)
                for i in range(n):
                    value = load_lanes(x, index[i] * members + b)
                    reference = reference + load_lanes(share, (g * n + i) * members + b) * value
                for i in range(n):
                    value = load_lanes(x, index[i] * members + b)
                    of_group = load_lanes(member_of, (g * n + i) * members + b)
                    apart = size_lanes(of_group * (value - reference))
                    found = found + beyond_lanes(apart, load_lanes(limit, i * members + b))
        store_lanes(above, b, found)


@compiled_part
def _runge_kutta_start(members, n, x, f, h, stage, total):
    """The first stage of all members: the point in the middle, and what is summed up so far."""
    for b in range(0, members, WIDTH):
        step = load_lanes(h, b)
        for s in range(b, n, members):
            now, rate = load_lanes(x, s), load_lanes(f, s)
            store_lanes(total, s, now + (1 / 6) * step * rate)
            store_lanes(stage, s, now + 0.5 * step * rate)


@compiled_part
def _mixed_start(members, n, x, f0, f1, f2, f3, weights, stage, total):
    """The same where some members follow the Adams rule, by the weights of each, (8, members)."""
    for b in range(0, members, WIDTH):
        a0, a1 = load_lanes(weights, b), load_lanes(weights, members + b)
        a2, a3 = load_lanes(weights, 2 * members + b), load_lanes(weights, 3 * members + b)
        b0, b1 = load_lanes(weights, 4 * members + b), load_lanes(weights, 5 * members + b)
        b2, mixed = load_lanes(weights, 6 * members + b), load_lanes(weights, 7 * members + b)
        for s in range(b, n, members):
            now, r0, r1 = load_lanes(x, s), load_lanes(f0, s), load_lanes(f1, s)
            r2, r3 = load_lanes(f2, s), load_lanes(f3, s)
            ahead = now + a0 * r0 + a1 * r1 + a2 * r2 + a3 * r3
            behind = now + b0 * r0 + b1 * r1 + b2 * r2
            store_lanes(stage, s, ahead)
            store_lanes(total, s, behind + mixed * (ahead - behind))


@compiled_part
def _go_on(members, n, x, k, ahead, share, stage, total):
    """Add a stage's slope to the sum, and go to the next stage."""
    for b in range(0, members, WIDTH):
        further, part = load_lanes(ahead, b), load_lanes(share, b)
        for s in range(b, n, members):
            rate = load_lanes(k, s)
            store_lanes(total, s, load_lanes(total, s) + part * rate)
            store_lanes(stage, s, load_lanes(x, s) + further * rate)


@compiled_part
def _finish(members, n, x, k, share, total, wrong):
    """Add the last slope: the new states. `wrong` is not a number where one of them is not finite."""
    for b in range(0, members, WIDTH):
        part, odd = load_lanes(share, b), all_lanes(0.0)
        for s in range(b, n, members):
            new = load_lanes(total, s) + part * load_lanes(k, s)
            store_lanes(x, s, new)
            odd = odd + 0.0 * new
        store_lanes(wrong, b, odd)


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _weigh(members, full_step, h, history, weights, last_share):
    """Weights of a mixed step; returns whether a member takes a Runge-Kutta step."""
    some = False
    for b in range(members):
        c = h[b] / 24
        adams = abs(h[b] - full_step) < 1e-6 * full_step and history[b] >= 3
        for k in range(8):
            weights[k * members + b] = 0.0
        if adams:
            weights[b], weights[members + b] = 55 * c, -59 * c
            weights[2 * members + b], weights[3 * members + b] = 37 * c, -9 * c
            weights[4 * members + b], weights[5 * members + b] = 19 * c, -5 * c
            weights[6 * members + b] = c
            weights[7 * members + b] = _MILNE
            last_share[b] = (1 - _MILNE) * 9 * c
        else:
            weights[b] = h[b] / 2
            weights[4 * members + b] = h[b] / 6
            last_share[b] = h[b] / 3
            some = some or h[b] != 0.0
        history[b] = history[b] + 1 if abs(h[b] - full_step) < 1e-6 * full_step else 0
    return some


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _advance(
    address, integers, reals, work, members, full_step, adams, x, times, row, last, history,
    verdict, kept, record, newest, slopes, stage, k, total,
    a_index, a_share, a_member_of, a_fixed, a_limit,
    s_index, s_share, s_member_of, s_fixed, s_limit,
    table, j_integers, j_reals, fired,
    observer, o_integers, o_reals, o_scratch,
):  # fmt: skip
    n = len(x)
    h, ahead, share = np.zeros(members), np.zeros(members), np.zeros(members)
    above, wrong = np.zeros(members), np.zeros(members)
    weights = np.zeros(8 * members)
    while True:
        for b in range(members):
            h[b] = times[b, row[b] + 1] - times[b, row[b]] if row[b] < last[b] else 0.0
        ring = newest[0] = (newest[0] + 3) % 4 if adams else 0
        f = slopes[ring]
        invoke(address, (integers, reals, work, x, f))
        if observer:
            for b in range(members):
                o_reals[b] = row[b]
            invoke(observer, (o_integers, o_reals, work, x, o_scratch))
        runge_kutta = True
        if adams:
            runge_kutta = _weigh(members, full_step, h, history, weights, share)
            f1, f2, f3 = slopes[(ring + 1) % 4], slopes[(ring + 2) % 4], slopes[(ring + 3) % 4]
            _mixed_start(members, n, x, f, f1, f2, f3, weights, stage, total)
        else:
            share[:] = h / 3
            _runge_kutta_start(members, n, x, f, h, stage, total)
        invoke(address, (integers, reals, work, stage, k))
        if runge_kutta:
            _hold_adams(weights, members, h)
            ahead[:] = h / 2
            _go_on(members, n, x, k, ahead, share, stage, total)
            invoke(address, (integers, reals, work, stage, k))
            share[:] = h / 3
            _go_on(members, n, x, k, h, share, stage, total)
            invoke(address, (integers, reals, work, stage, k))
            share[:] = h / 6
        _finish(members, n, x, k, share, total, wrong)
        above[:] = 0.0
        _judge(x, members, a_index, a_share, a_member_of, a_fixed, a_limit, above)
        _judge(x, members, s_index, s_share, s_member_of, s_fixed, s_limit, above)
        if _note(
            x, members, row, last, kept, record, wrong, above, verdict,
            table, j_integers, j_reals, fired,
        ):  # fmt: skip
            return


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _hold_adams(weights, members, h):
    """Members that have followed the Adams rule go no further in the other stages."""
    for b in range(members):
        if weights[7 * members + b] != 0.0:
            h[b] = 0.0


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _note(
    x, members, row, last, kept, record, wrong, above, verdict, table, j_integers, j_reals, fired
):
    """Keep what is to be kept of the new states; whether something has happened to a member."""
    happened, holds = False, np.zeros(1)
    for b in range(members):
        if row[b] == last[b]:
            continue
        row[b] += 1
        out = record[b, row[b]]
        for i in range(len(kept)):
            out[i] = x[kept[i] * members + b]
        if wrong[b] != 0.0 or np.isnan(wrong[b]):
            verdict[b] = NOT_FINITE
        elif above[b] != 0.0:
            verdict[b] = BEYOND
        elif len(table):
            fired[b] = first_watch(table, j_integers, j_reals[b], out, holds)
            verdict[b] = BEYOND if fired[b] else GOES_ON
        happened = happened or row[b] == last[b] or verdict[b] != GOES_ON
    return happened
