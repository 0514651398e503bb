"""Loads that are no impedances in a batch: the iteration of single runs, for eight members at once.

Each member iterates

    V = K (I + I_c(V) - J V),    K = (Y - J)^-1,

as in :mod:`gridfold.dynamics.network.loads`. J are the slopes of the intact network's operating point
for all, so that all share the factors of K; a member's network state, and what it sheds, are its own.
A member that has converged keeps its voltages while others go on. One that does not converge has
voltages that are not a number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.block_factors import (
    N_ROWS,
    ROW,
    BlockFactors,
    block_factors,
    solve_low,
    solve_up,
)
from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.loads.break_voltage import BREAK_VOLTAGE
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import norton_currents
from gridfold.dynamics.network.loads import ITERATIONS, TOLERANCE, NonlinearLoads
from gridfold.dynamics.network.real_sparse import near_solution
from gridfold.dynamics.rhs import Store
from gridfold.numerics.compiled import compiled_part
from gridfold.numerics.elementary import exponential, logarithm
from gridfold.numerics.lanes import (
    WIDTH,
    all_lanes,
    beyond_lanes,
    load_lanes,
    root_lanes,
    size_lanes,
    store_lanes,
    where_less,
)
from gridfold.numerics.rhs import CompiledRhs

# Header of the integers; `..._AT` say where a part begins, in the integers or in the reals.
(
    N_TERMINALS,
    N_LOADS,
    N_EXPONENTS,
    LONGEST,
    WIDEST,
    TERMINAL_ROWS_AT,
    PLACES_AT,
    USED_AT,
    RANKS_AT,
    LENGTHS_AT,
    PATHS_AT,
    FACTORS_AT,
    EXPONENTS_AT,
    FIXED_AT,
    POWERS_AT,
    ON_AT,
    NEAR_AT,
    DRAWN_AT,
    CAUSED_AT,
    BLOCKS_AT,
) = range(20)
_SIZE = 20
#: Numbers of a load that all members share: the inverse of the initial voltage, and J.
_FIXED = 5
#: A change of a voltage in p.u. from which the iteration of a member is given up.
_FAR = 1e3


@dataclass(frozen=True)
class BatchLoads:
    """Loads of so many members, each in a network state of its own.

    Parameters
    ----------
    integers, reals : ndarray
        Data of :func:`solve_with_loads`, changed by :meth:`put`.
    scratch_size : int
        Numbers of scratch that it takes.
    """

    model: DetailedModel
    factors: BlockFactors
    members: int
    start: NDArray[np.complex128]
    integers: NDArray[np.int64]
    reals: NDArray[np.float64]

    @property
    def scratch_size(self) -> int:
        """Numbers of scratch: rows of the factors, and flags of a group."""
        return self.factors.n_rows * ROW + 3 * WIDTH

    def put(self, member: int, change: NetworkChange | None, loads: NonlinearLoads) -> None:
        """From now on `member` is on the network with `change`, with `loads` for those of the model."""
        header, terms = self.integers, len(loads.exponents)
        n_loads, n = len(loads.buses), len(self.start)
        powers = self._part(POWERS_AT, (n_loads, terms, 2, self.members))
        powers[:, :, 0, member], powers[:, :, 1, member] = loads.power.real, loads.power.imag
        off = np.zeros(len(self.model.case.buses), dtype=bool)
        if change is not None:
            off[np.concatenate([change.zero, change.dead])] = True
        index = self.model.case.bus_index
        at = [index[bus] for bus in self.model.layout.terminals]
        near = self._part(NEAR_AT, (2, n, self.members))
        voltages = np.where(off[at], 0.0, self.start)
        near[0, :, member], near[1, :, member] = voltages.real, voltages.imag
        on = self._part(ON_AT, (n_loads, self.members))
        on[:, member] = ~off[[index[bus] for bus in loads.buses]]
        rank = 0 if change is None else len(change.buses)
        header[header[RANKS_AT] + member] = rank
        if change is None or not rank:
            return
        path, drawn, caused = self.factors.compensation(change)
        header[header[LENGTHS_AT] + member] = len(path)
        first = header[PATHS_AT] + member * header[LONGEST]
        header[first : first + len(path)] = path
        for part, values in ((DRAWN_AT, drawn), (CAUSED_AT, caused)):
            first = header[part] + member * header[LONGEST] * header[WIDEST]
            self.reals[first : first + values.size] = values.ravel()

    def inside(self, compiled: CompiledRhs, integers_at: int, reals_at: int) -> BatchLoads:
        """The same on the copy of its data in those of a right-hand side."""
        integers = compiled.integers[integers_at : integers_at + len(self.integers)]
        return replace(
            self,
            integers=integers,
            reals=compiled.reals[reals_at : reals_at + len(self.reals)],
        )

    def _part(self, at: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
        first = self.integers[at]
        return self.reals[first : first + int(np.prod(shape))].reshape(shape)


def batch_loads(model: DetailedModel, members: int, rank: int) -> BatchLoads | None:
    """The loads of a model that are no impedances, for changes up to a rank; None without any."""
    loads, terminals = model.injections.nonlinear, model.layout.terminals
    if loads is None:
        return None
    at = loads.places(terminals)
    start = near_solution(model.equations, norton_currents(model.injections, terminals), loads, at)
    own, index = loads.slopes(start[at]), model.case.bus_index
    slopes = np.zeros((len(model.case.buses), 2, 2))
    slopes[[index[bus] for bus in loads.buses]] = own
    factors = block_factors(model.equations, slopes)
    longest = min(rank * factors.longest_path(), factors.n_rows)
    n, terms = len(terminals), len(loads.exponents)
    header = np.zeros(_SIZE, dtype=np.int64)
    header[[N_TERMINALS, N_LOADS, N_EXPONENTS]] = n, len(at), terms
    # A row of a path has two parts, and a current two for each bus of the change.
    header[[LONGEST, WIDEST]] = longest, 4 * rank
    integers, reals = Store(np.int64, start=_SIZE), Store(np.float64)
    header[TERMINAL_ROWS_AT] = integers.add(factors.rows[[index[bus] for bus in terminals]])
    header[PLACES_AT] = integers.add(at)
    header[USED_AT] = integers.add(loads.power != 0)
    header[RANKS_AT] = integers.add(np.zeros(members))
    header[LENGTHS_AT] = integers.add(np.zeros(members))
    header[PATHS_AT] = integers.add(np.zeros(members * longest))
    header[FACTORS_AT] = integers.add(factors.integers)
    header[EXPONENTS_AT] = reals.add(loads.exponents)
    header[FIXED_AT] = reals.add(np.column_stack([1 / loads.voltage, own.reshape(-1, 4)]))
    header[POWERS_AT] = reals.add(np.zeros((len(at), terms, 2, members)))
    header[ON_AT] = reals.add(np.zeros((len(at), members)))
    header[NEAR_AT] = reals.add(np.zeros((2, n, members)))
    header[DRAWN_AT] = reals.add(np.zeros(members * longest * 4 * rank))
    header[CAUSED_AT] = reals.add(np.zeros(members * longest * 4 * rank))
    header[BLOCKS_AT] = reals.add(factors.blocks)
    data = np.concatenate([header, integers.join()])
    batch = BatchLoads(model, factors, members, start, data, reals.join())
    for member in range(members):
        batch.put(member, None, loads)
    return batch


@compiled_part
def solve_with_loads(integers, reals, members, currents, voltages, compensating, scratch):
    """Voltages (2 n, members) of the terminals; `currents` then have those of the loads besides.

    The iteration of each member starts from its last voltages, which are kept among the reals.
    """
    n, near = integers[N_TERMINALS], reals[integers[NEAR_AT] :]
    factors, blocks = integers[integers[FACTORS_AT] :], reals[integers[BLOCKS_AT] :]
    flags = scratch[factors[N_ROWS] * ROW :]
    for first in range(0, members, WIDTH):
        for t in range(2 * n):
            store_lanes(voltages, t * members + first, load_lanes(near, t * members + first))
        for b in range(WIDTH):
            flags[b] = 1.0
        for _ in range(ITERATIONS):
            _inject(integers, reals, members, first, currents, voltages, scratch, flags)
            solve_low(factors, blocks, scratch)
            _compensate(integers, reals, members, first, scratch, compensating)
            solve_up(factors, blocks, scratch)
            if not _take(integers, members, first, scratch, voltages, flags):
                break
        _add_corrections(integers, reals, members, first, currents, voltages, flags)
        _keep(members, first, n, near, voltages, flags)


@compiled_part
def _inject(integers, reals, members, first, currents, voltages, scratch, flags):
    """The right-hand side I + I_c(V) - J V by rows of the factors."""
    n, count = integers[N_TERMINALS], integers[N_LOADS]
    rows, places = integers[integers[TERMINAL_ROWS_AT] :], integers[integers[PLACES_AT] :]
    fixed, on = reals[integers[FIXED_AT] :], reals[integers[ON_AT] :]
    zero = all_lanes(0.0)
    for k in range(2 * integers[integers[FACTORS_AT] + N_ROWS]):
        store_lanes(scratch, k * WIDTH, zero)
    for t in range(n):
        if rows[t] >= 0:
            at, real, imaginary = rows[t] * ROW, t * members + first, (n + t) * members + first
            store_lanes(scratch, at, load_lanes(scratch, at) + load_lanes(currents, real))
            here = load_lanes(scratch, at + WIDTH) + load_lanes(currents, imaginary)
            store_lanes(scratch, at + WIDTH, here)
    for k in range(count):
        t, j = places[k], k * _FIXED + 1
        if rows[t] >= 0:
            v_r = load_lanes(voltages, t * members + first)
            v_i = load_lanes(voltages, (n + t) * members + first)
            c_r, c_i = _correction(integers, reals, members, first, k, v_r, v_i, flags)
            c_r = c_r - fixed[j] * v_r - fixed[j + 1] * v_i
            c_i = c_i - fixed[j + 2] * v_r - fixed[j + 3] * v_i
            here, at = load_lanes(on, k * members + first), rows[t] * ROW
            store_lanes(scratch, at, load_lanes(scratch, at) + here * c_r)
            store_lanes(scratch, at + WIDTH, load_lanes(scratch, at + WIDTH) + here * c_i)


@compiled_part
def _correction(integers, reals, members, first, k, v_r, v_i, flags):
    """The correcting current of a load, V times the sum of S_k (1 / V0^2 - (m / V0)^n_k / m^2)*."""
    terms = integers[N_EXPONENTS]
    used, exponents = integers[integers[USED_AT] + k * terms :], reals[integers[EXPONENTS_AT] :]
    powers = reals[integers[POWERS_AT] + 2 * k * terms * members + first :]
    inverse_start = reals[integers[FIXED_AT] + k * _FIXED]
    square, lowest = v_r * v_r + v_i * v_i, all_lanes(BREAK_VOLTAGE * BREAK_VOLTAGE)
    square = where_less(square, lowest, lowest, square)
    inverse = 1.0 / root_lanes(square)
    whole, equivalent = inverse * inverse, inverse_start * inverse_start
    h_r, h_i = all_lanes(0.0), all_lanes(0.0)
    for j in range(terms):
        if used[j]:
            weight = whole
            if exponents[j] == 1.0:
                weight = inverse_start * inverse
            elif exponents[j] != 0.0:
                ratio = inverse_start * (square * inverse)
                weight = whole * _power(ratio, exponents[j], flags[2 * WIDTH :])
            h_r = h_r + load_lanes(powers, 2 * j * members) * (equivalent - weight)
            h_i = h_i + load_lanes(powers, (2 * j + 1) * members) * (weight - equivalent)
    return h_r * v_r - h_i * v_i, h_r * v_i + h_i * v_r


@compiled_part
def _power(base, exponent, room):
    store_lanes(room, 0, base)
    for b in range(WIDTH):
        room[b] = exponential(exponent * logarithm(room[b]))
    return load_lanes(room, 0)


@compiled_part
def _compensate(integers, reals, members, first, scratch, compensating):
    """Currents that make the network of each member out of the intact one, between L and U."""
    stride = integers[LONGEST] * integers[WIDEST]
    for b in range(WIDTH):
        member = first + b
        size = 2 * integers[integers[RANKS_AT] + member]
        if size == 0:
            continue
        length = integers[integers[LENGTHS_AT] + member]
        path = integers[integers[PATHS_AT] + member * integers[LONGEST] :]
        drawn = reals[integers[DRAWN_AT] + member * stride :]
        caused = reals[integers[CAUSED_AT] + member * stride :]
        for i in range(size):
            total = 0.0
            for p in range(length):
                at = path[p] * ROW + b
                total -= drawn[2 * p * size + i] * scratch[at]
                total -= drawn[(2 * p + 1) * size + i] * scratch[at + WIDTH]
            compensating[i * members + member] = total
        for p in range(length):
            at = path[p] * ROW + b
            for i in range(size):
                current = compensating[i * members + member]
                scratch[at] += caused[2 * p * size + i] * current
                scratch[at + WIDTH] += caused[(2 * p + 1) * size + i] * current


@compiled_part
def _take(integers, members, first, scratch, voltages, flags):
    """New voltages of the members that have not converged; whether one has to go on.

    The first of the flags are 1 for these, -1 for one that is given up, and 0 for the others.
    """
    n, rows = integers[N_TERMINALS], integers[integers[TERMINAL_ROWS_AT] :]
    moving, zero = load_lanes(flags, 0), all_lanes(0.0)
    apart, far, near, away = zero, zero, all_lanes(TOLERANCE), all_lanes(_FAR)
    for part in range(2):
        for t in range(n):
            new, at = zero, (part * n + t) * members + first
            if rows[t] >= 0:
                new = load_lanes(scratch, rows[t] * ROW + part * WIDTH)
            old = load_lanes(voltages, at)
            change = size_lanes(new - old)
            apart, far = apart + beyond_lanes(change, near), far + beyond_lanes(change, away)
            store_lanes(voltages, at, where_less(zero, moving, new, old))
    store_lanes(flags, WIDTH, apart)
    store_lanes(flags, 2 * WIDTH, far)
    some = False
    for b in range(WIDTH):
        if flags[b] > 0.0:
            if flags[2 * WIDTH + b] > 0.0:
                flags[b] = -1.0
            elif flags[WIDTH + b] == 0.0:
                flags[b] = 0.0
            else:
                some = True
    return some


@compiled_part
def _add_corrections(integers, reals, members, first, currents, voltages, flags):
    """Add the correcting currents at the voltages that were found."""
    n, places = integers[N_TERMINALS], integers[integers[PLACES_AT] :]
    on = reals[integers[ON_AT] :]
    for k in range(integers[N_LOADS]):
        real, imaginary = places[k] * members + first, (n + places[k]) * members + first
        v_r, v_i = load_lanes(voltages, real), load_lanes(voltages, imaginary)
        c_r, c_i = _correction(integers, reals, members, first, k, v_r, v_i, flags)
        here = load_lanes(on, k * members + first)
        store_lanes(currents, real, load_lanes(currents, real) + here * c_r)
        store_lanes(currents, imaginary, load_lanes(currents, imaginary) + here * c_i)


@compiled_part
def _keep(members, first, n, near, voltages, flags):
    """Keep the voltages to start from; those of a member that did not converge are not a number."""
    for b in range(WIDTH):
        if flags[b] != 0.0:
            for t in range(2 * n):
                voltages[t * members + first + b] = np.nan
    for t in range(2 * n):
        at = t * members + first
        found, before = load_lanes(voltages, at), load_lanes(near, at)
        # What is not a number is not above any: it leaves what was there.
        store_lanes(near, at, where_less(size_lanes(found), all_lanes(np.inf), found, before))
