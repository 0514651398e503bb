"""Lowest and highest voltages of members of a batch, found while they are stepped.

At each step the currents of the machines are known. The network is solved for all buses with them,
so that neither states nor voltages need be kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.batch.factors import (
    ROW,
    ColumnFactors,
    column_factors,
    put_currents,
    solve_each,
    solve_group,
)
from gridfold.dynamics.batch.rhs import COMPENSATING_AT, BatchRhs
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.rhs import N_SIGNALS
from gridfold.numerics.columns import Observer
from gridfold.numerics.compiled import compile_callback, compiled_part
from gridfold.numerics.lanes import (
    WIDTH,
    aligned,
    aligned_zeros,
    all_lanes,
    load_lanes,
    store_lanes,
    where_less,
)
from gridfold.numerics.rhs import RHS_SIGNATURE

(
    MEMBERS,
    CURRENTS_AT,
    COMPENSATING,
    RANK,
    N_BUSES,
    BUSES_AT,
    PLACES_AT,
    N_HELD,
    HELD_AT,
    FACTORS_AT,
    FACTOR_REALS_AT,
    GROUP_REALS,
) = range(12)
_SIZE = 12
# Blocks of `members` numbers each at the head of the reals: the row at which a member stands, the
# squares of its extremes with their buses and rows.
(ROWS, LOW, LOW_BUS, LOW_ROW, HIGH, HIGH_BUS, HIGH_ROW) = range(7)
_BLOCKS = 7


class VoltageExtreme(NamedTuple):
    """A voltage in p.u., the position of its bus in the case, and the row of the run."""

    value: float
    bus: int
    row: int


@dataclass
class VoltageObserver:
    """Extremes of the voltages of energized buses, for each member since :meth:`put`."""

    rhs: BatchRhs
    observer: Observer
    factors: ColumnFactors

    def seat(self, member: int, model: DetailedModel) -> None:
        """`member` is on the intact network of `model` from now on; raises as :meth:`BatchRhs.seat`."""
        if self.rhs.own_networks:
            spread = self.observer.reals[self.observer.integers[FACTOR_REALS_AT] :]
            self.factors.put(spread, member, model.equations)

    def put(self, member: int, change: NetworkChange | None) -> None:
        """`member` is on another network now; what was found before counts no more."""
        integers, members, rows = self.observer.integers, self.rhs.members, self.factors.rows
        blocks = self.observer.reals[: _BLOCKS * members].reshape(_BLOCKS, members)
        blocks[LOW, member], blocks[HIGH, member] = np.inf, -1.0
        places = integers[integers[PLACES_AT] :][: self.rhs.rank * members]
        places = places.reshape(self.rhs.rank, members)
        places[:, member] = -1
        held = integers[integers[HELD_AT] :]
        known = held[: 3 * integers[N_HELD]].reshape(-1, 3)
        kept = known[known[:, 0] != member]
        if change is not None:
            places[: len(change.buses), member] = rows[change.buses]
            buses = np.concatenate([change.zero, change.dead])
            new = np.full((len(buses), 3), member)
            new[:, 1] = rows[buses]
            new[:, 2] = np.arange(len(buses)) >= len(change.zero)
            kept = np.concatenate([kept, new])
        integers[N_HELD] = len(kept)
        held[: kept.size] = kept.ravel()

    def extremes(self, member: int) -> tuple[VoltageExtreme | None, VoltageExtreme | None]:
        """Lowest and highest voltage; None where no bus is energized."""
        members = self.rhs.members
        blocks = self.observer.reals[: _BLOCKS * members].reshape(_BLOCKS, members)[:, member]
        if not np.isfinite(blocks[LOW]):
            return None, None
        low, high = (
            VoltageExtreme(float(np.sqrt(blocks[k])), int(blocks[k + 1]), int(blocks[k + 2]))
            for k in (LOW, HIGH)
        )
        return low, high


def voltage_observer(rhs: BatchRhs) -> VoltageObserver:
    """An observer of the voltages of all buses that are energized in the intact network."""
    equations, data = rhs.model.equations, rhs.compiled.integers
    factors = column_factors(equations, every_bus=True)
    own = rhs.own_networks
    values = factors.spread(equations, rhs.members) if own else factors.values(equations)
    on = np.flatnonzero(equations.islands.energized)
    parts = (
        np.stack([on, factors.rows[on]], axis=1).ravel(),
        np.full(rhs.rank * rhs.members, -1),
        np.zeros(3 * rhs.members * len(on)),
        factors.integers,
    )
    buses_at, places_at, held_at, factors_at = _SIZE + np.cumsum([0, *map(len, parts[:-1])])
    header = np.zeros(_SIZE)
    header[MEMBERS] = rhs.members
    header[CURRENTS_AT], header[COMPENSATING] = data[N_SIGNALS], data[COMPENSATING_AT]
    header[RANK] = rhs.rank
    header[N_BUSES], header[BUSES_AT] = len(on), buses_at
    header[PLACES_AT], header[HELD_AT] = places_at, held_at
    header[FACTORS_AT], header[FACTOR_REALS_AT] = factors_at, _BLOCKS * rhs.members
    header[GROUP_REALS] = factors.n_values * WIDTH if own else 0
    observer = Observer(
        _compiled().address,
        np.concatenate([header, *parts]).astype(np.int64),
        aligned(np.concatenate([np.zeros(_BLOCKS * rhs.members), values])),
        aligned_zeros(factors.n_rows * ROW),
    )
    return VoltageObserver(rhs, observer, factors)


def _observe(integers, reals, work, x, scratch):
    members, rank = integers[MEMBERS], integers[RANK]
    factors, values = integers[integers[FACTORS_AT] :], reals[integers[FACTOR_REALS_AT] :]
    places, held = integers[integers[PLACES_AT] :], integers[integers[HELD_AT] :]
    buses = integers[integers[BUSES_AT] :]
    compensating = work[integers[COMPENSATING] :]
    group_reals = integers[GROUP_REALS]
    for first in range(0, members, WIDTH):
        put_currents(factors, work[integers[CURRENTS_AT] :], members, first, scratch)
        for r in range(rank):
            for b in range(WIDTH):
                k = places[r * members + first + b]
                if k >= 0:
                    at = 2 * r * members + first + b
                    scratch[k * ROW + b] += compensating[at]
                    scratch[k * ROW + WIDTH + b] += compensating[at + members]
        if group_reals:
            solve_each(factors, values[first // WIDTH * group_reals :], scratch)
        else:
            solve_group(factors, values, scratch)
        for h in range(integers[N_HELD]):
            b = held[3 * h] - first
            if 0 <= b < WIDTH:
                value = np.nan if held[3 * h + 2] else 0.0
                scratch[held[3 * h + 1] * ROW + b] = value
                scratch[held[3 * h + 1] * ROW + WIDTH + b] = value
        row, nowhere = load_lanes(reals, first), all_lanes(-1.0)
        at_low, at_high = LOW * members + first, HIGH * members + first
        low, high = load_lanes(reals, at_low), load_lanes(reals, at_high)
        low_bus, high_bus = nowhere, nowhere
        for k in range(integers[N_BUSES]):
            at = buses[2 * k + 1] * ROW
            v_r, v_i = load_lanes(scratch, at), load_lanes(scratch, at + WIDTH)
            squared = v_r * v_r + v_i * v_i
            bus = all_lanes(float(buses[2 * k]))
            low_bus = where_less(squared, low, bus, low_bus)
            high_bus = where_less(high, squared, bus, high_bus)
            low = where_less(squared, low, squared, low)
            high = where_less(high, squared, squared, high)
        store_lanes(reals, at_low, low)
        store_lanes(reals, at_high, high)
        _note(reals, at_low, members, low_bus, nowhere, row)
        _note(reals, at_high, members, high_bus, nowhere, row)


@compiled_part
def _note(reals, at, members, bus, nowhere, row):
    """Keep bus and row of the extremes that are new; the others have no bus."""
    known_bus, known_row = load_lanes(reals, at + members), load_lanes(reals, at + 2 * members)
    store_lanes(reals, at + members, where_less(nowhere, bus, bus, known_bus))
    store_lanes(reals, at + 2 * members, where_less(nowhere, bus, row, known_row))


@cache
def _compiled() -> Any:
    return compile_callback(_observe, RHS_SIGNATURE)
