"""Lowest and highest voltages along a run that is over: its rows stand side by side."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.batch.rhs import BatchRhs, batch_rhs
from gridfold.dynamics.batch.voltages import VoltageExtreme, VoltageObserver, voltage_observer
from gridfold.dynamics.model import DetailedModel
from gridfold.grid.case import UnitKey
from gridfold.numerics.compiled import FAST, invoke, jit
from gridfold.numerics.lanes import (
    WIDTH,
    aligned,
    aligned_zeros,
    all_lanes,
    load_lanes,
    store_lanes,
)

Extremes = tuple[VoltageExtreme | None, VoltageExtreme | None]


@dataclass
class RowVoltages:
    """Extremes of the voltages of energized buses along rows of states.

    Parameters
    ----------
    model : DetailedModel
        The intact network, whose loads are impedances.
    rank : int
        The largest rank of a change that there is room for.
    """

    model: DetailedModel
    rank: int
    index: NDArray[np.int64] = field(init=False)
    _rhs: BatchRhs = field(init=False)
    _seen: VoltageObserver = field(init=False)

    def __post_init__(self) -> None:
        #: Positions of the states that are looked at.
        self.index = self.model.source_states
        self._rhs = batch_rhs(self.model, WIDTH, self.rank)
        self._seen = voltage_observer(self._rhs)
        compiled = self._rhs.compiled
        self._x = aligned(np.repeat(self.model.x0, WIDTH))
        self._dx, self._work = np.zeros(compiled.n_states), aligned_zeros(compiled.work_size)
        self._network: tuple[NetworkChange | None, Collection[UnitKey]] = (None, ())

    def begin(self, change: NetworkChange | None, units_out: Collection[UnitKey]) -> None:
        """What follows is on the network with `change`, without `units_out`."""
        if self._network[0] is not change or self._network[1] != units_out:
            self._network = change, units_out
            for place in range(WIDTH):
                self._rhs.put(place, change, units_out)
        for place in range(WIDTH):
            self._seen.put(place, change)

    def take(self, states: NDArray[np.float64], lift: RowLift, first: int) -> None:
        """The next rows (n, r), from number `first` on, and the way to the whole's states."""
        compiled, seen = self._rhs.compiled, self._seen.observer
        rows = np.ascontiguousarray(states)
        _look_along(
            self._rhs.currents, compiled.integers, compiled.reals, self._work, self._x, self._dx,
            self.index, rows, aligned_zeros(rows.shape[1] * WIDTH), first,
            lift.origin, lift.begins, lift.columns, lift.slopes,
            seen.address, seen.integers, seen.reals, seen.scratch,
        )  # fmt: skip

    def extremes(self) -> Extremes:
        """Lowest and highest voltage since :meth:`begin`, the earliest where there are several."""
        found = [self._seen.extremes(place) for place in range(WIDTH)]
        lows = [low for low, _ in found if low is not None]
        highs = [high for _, high in found if high is not None]
        return (
            min(lows, key=lambda item: (item.value, item.row), default=None),
            min(highs, key=lambda item: (-item.value, item.row), default=None),
        )


@dataclass(frozen=True)
class RowLift:
    """Some states of the whole system as origin + slopes v; of the slopes what is not zero, by rows.

    Parameters
    ----------
    origin : ndarray, shape (m,)
        The states where v is zero.
    begins, columns, slopes : ndarrays
        A sparse matrix of shape (m, r), as SciPy's CSR has it.
    """

    origin: NDArray[np.float64]
    begins: NDArray[np.int64]
    columns: NDArray[np.int64]
    slopes: NDArray[np.float64]

    @classmethod
    def of(cls, origin: NDArray[np.float64], slopes: csr_array) -> RowLift:
        """From a sparse matrix of slopes, (m, r)."""
        begins, columns = slopes.indptr.astype(np.int64), slopes.indices.astype(np.int64)
        return cls(origin, begins, columns, slopes.data)


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _look_along(
    currents, integers, reals, work, x, dx, index, states, v, first, origin, begins, columns, slopes,
    observer, o_integers, o_reals, o_scratch,
):  # fmt: skip
    last, n = len(states) - 1, states.shape[1]
    for start in range(0, len(states), WIDTH):
        for b in range(WIDTH):
            row = min(start + b, last)
            o_reals[b] = first + row
            for j in range(n):
                v[j * WIDTH + b] = states[row, j]
        for k in range(len(index)):
            total = all_lanes(origin[k])
            for e in range(begins[k], begins[k + 1]):
                total = total + slopes[e] * load_lanes(v, columns[e] * WIDTH)
            store_lanes(x, index[k] * WIDTH, total)
        invoke(currents, (integers, reals, work, x, dx))
        invoke(observer, (o_integers, o_reals, work, x, o_scratch))
