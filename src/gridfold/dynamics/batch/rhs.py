"""The compiled right-hand side of many members at once.

Every row of the detailed model becomes a row of members: entry `s` of member `b` stands at
``s * members + b``. A block of units is then a block of units x members, which its kernels take as
they are. Parameters and constants are a column of each member. What a member's network state changes is
written into the data by :meth:`BatchRhs.put`, another operating point by :meth:`BatchRhs.seat`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.batch.change import NetworkChange
from gridfold.dynamics.batch.factors import (
    ROW,
    ColumnFactors,
    column_factors,
    put_currents,
    solve_each,
    solve_group,
    take_voltages,
)
from gridfold.dynamics.batch.loads import BatchLoads, batch_loads, solve_with_loads
from gridfold.dynamics.device import Kernel, batch_derivative, batch_kernel
from gridfold.dynamics.layout import Block, Layout
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.backend import CompiledNetwork
from gridfold.dynamics.network.loads import NonlinearLoads
from gridfold.dynamics.rhs import (
    CONSTANTS_AT,
    HEADER_SIZE,
    N_DERIVATIVE_CALLS,
    N_OUTPUT_CALLS,
    N_SIGNALS,
    N_SOURCE_CALLS,
    N_STATES,
    N_TERMINALS,
    SCRATCH_AT,
    frozen_states,
    load_constants,
    pack_model,
    run_calls,
)
from gridfold.grid.case import UnitKey
from gridfold.numerics.compiled import compile_callback, compiled_part
from gridfold.numerics.lanes import WIDTH, aligned, all_lanes, load_lanes, store_lanes
from gridfold.numerics.products import with_products
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

# The header goes on behind that of the detailed model.
(
    MEMBERS,
    N_MACHINES,
    MACHINES_AT,
    LIVE_AT,
    N_FROZEN,
    FROZEN_AT,
    FACTORS_AT,
    FACTOR_REALS_AT,
    RANKS_AT,
    DRAWN_AT,
    CAUSED_AT,
    COMPENSATING_AT,
    GROUP_REALS,
    LOADS_AT,
    LOAD_REALS_AT,
) = range(HEADER_SIZE, HEADER_SIZE + 15)
_SIZE = HEADER_SIZE + 15


@dataclass(frozen=True)
class BatchRhs:
    """The right-hand side of `members` runs, each in a network state and with parameters of its own.

    Parameters
    ----------
    model : DetailedModel
        The model of which all members have the places; they begin as copies of it.
    compiled : CompiledRhs
        For states of shape (n_states, members), flattened. Its data are changed by :meth:`seat` and
        :meth:`put`.
    members : int
        How many stand side by side.
    rank : int
        The largest rank of a change that there is room for.
    factors : ColumnFactors
        Where the factors of the intact network have entries.
    own_networks : bool
        Whether the intact network of each member is another one.
    loads : BatchLoads, optional
        Loads that are no impedances.
    """

    model: DetailedModel
    compiled: CompiledRhs
    members: int
    rank: int
    factors: ColumnFactors
    own_networks: bool
    _parameters_at: tuple[int, ...]
    loads: BatchLoads | None = None

    def seat(self, member: int, model: DetailedModel) -> None:
        """From now on `member` has the parameters, set points and intact network of `model`.

        Raises
        ------
        NetworkError
            The network has entries at other places than that of the batch.
        """
        self.settle(member, model.layout)
        constants = self._reals(CONSTANTS_AT, (len(model.constants), self.members))
        constants[:, member] = model.constants
        if self.own_networks:
            spread = self._reals(FACTOR_REALS_AT, (self.members * self.factors.n_values,))
            self.factors.put(spread, member, model.equations)

    def settle(self, member: int, layout: Layout) -> None:
        """From now on `member` has the parameters of `layout`, which has the places of the model."""
        for at, block in zip(self._parameters_at, layout.blocks, strict=True):
            values = kernel_parameters(block)
            columns = self.compiled.reals[at : at + values.size * self.members]
            columns.reshape(*values.shape, self.members)[:, :, member] = values

    @property
    def currents(self) -> int:
        """Address of a function of the same signature that finds currents and compensation alone."""
        return int(_compiled_currents().address)

    def put(
        self,
        member: int,
        change: NetworkChange | None,
        units_out: Collection[UnitKey],
        loads: NonlinearLoads | None = None,
    ) -> None:
        """From now on `member` is on the network with `change`, without `units_out`.

        `loads` are those of its network state that are no impedances, by default those of the model.
        """
        integers, layout = self.compiled.integers, self.model.layout
        live = self._reals(LIVE_AT, (len(layout.sources), self.members))
        live[:, member] = 1.0
        if units_out:
            live[:, member] = [unit not in units_out for unit in layout.source_units]
        self._freeze(member, units_out)
        if self.loads is not None:
            own = loads or self.model.injections.nonlinear
            assert own is not None
            self.loads.put(member, change, own)
            return
        rank = 0 if change is None else len(change.buses)
        groups = self.members // WIDTH
        ranks = integers[integers[RANKS_AT] :][: self.members + groups]
        ranks[groups + member] = rank
        group = member // WIDTH
        ranks[group] = ranks[groups + group * WIDTH :][:WIDTH].max()
        shape = (self.rank, len(layout.terminals), 2, self.members)
        drawn, caused = self._reals(DRAWN_AT, shape), self._reals(CAUSED_AT, shape)
        drawn[:, :, :, member] = caused[:, :, :, member] = 0.0
        if change is not None:
            drawn[:rank, :, 0, member], drawn[:rank, :, 1, member] = (
                change.drawn.real, change.drawn.imag,
            )  # fmt: skip
            caused[:rank, :, 0, member], caused[:rank, :, 1, member] = (
                change.caused.T.real, change.caused.T.imag,
            )  # fmt: skip

    def _freeze(self, member: int, units_out: Collection[UnitKey]) -> None:
        integers, count = self.compiled.integers, self.compiled.integers[N_FROZEN]
        places = integers[integers[FROZEN_AT] :]
        others = [p for p in places[:count] if p % self.members != member]
        own = [k * self.members + member for k in frozen_states(self.model.layout, units_out)]
        integers[N_FROZEN] = len(others) + len(own)
        places[: integers[N_FROZEN]] = others + own

    def _reals(self, at: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
        start = self.compiled.integers[at]
        return self.compiled.reals[start : start + int(np.prod(shape))].reshape(shape)


def batch_rhs(
    model: DetailedModel, members: int, rank: int, own_networks: bool = False
) -> BatchRhs:
    """The right-hand side of so many members, a multiple of eight, all on the network of `model`.

    With `own_networks` each may have the network of another operating point by :meth:`BatchRhs.seat`.
    """
    layout = model.layout
    wide = side_by_side(layout, members)
    factors = column_factors(model.equations, every_bus=False)
    loads = batch_loads(model, members, rank)
    scratch = factors.n_rows * ROW if loads is None else loads.scratch_size
    none = CompiledNetwork(0, np.zeros(0, dtype=np.int64), np.zeros(0), scratch)
    constants = np.repeat(model.constants, members)
    compiled_of = batch_form(layout)
    data = pack_model(wide, constants, none, wide.blocks, header_size=_SIZE, compiled=compiled_of)
    header, integers, reals = data.header, data.integers, data.reals
    n, groups = len(layout.terminals), members // WIDTH
    header[MEMBERS] = members
    header[[N_MACHINES, MACHINES_AT]] = len(layout.sources), integers.add(layout.sources)
    header[FACTORS_AT] = integers.add(factors.integers)
    header[LIVE_AT] = reals.add(np.ones((len(layout.sources), members)))
    header[RANKS_AT] = integers.add(np.zeros(groups + members))
    header[FROZEN_AT] = integers.add(np.zeros(layout.n_states * members))
    linear_rank = rank if loads is None else 0
    header[DRAWN_AT] = reals.add(np.zeros((linear_rank, n, 2, members)))
    header[CAUSED_AT] = reals.add(np.zeros((linear_rank, n, 2, members)))
    header[FACTOR_REALS_AT] = reals.add(
        factors.spread(model.equations, members)
        if own_networks
        else factors.values(model.equations)
    )
    header[GROUP_REALS] = factors.n_values * WIDTH if own_networks else 0
    header[COMPENSATING_AT] = data.work_size
    if loads is not None:
        header[LOADS_AT] = integers.add(loads.integers)
        header[LOAD_REALS_AT] = reals.add(loads.reals)
    compiled = CompiledRhs(
        _compiled().address,
        np.concatenate([header, integers.join()]),
        aligned(reals.join()),
        data.work_size + 2 * rank * members,
        layout.n_states * members,
    )
    if loads is not None:
        loads = loads.inside(compiled, int(header[LOADS_AT]), int(header[LOAD_REALS_AT]))
    parameters_at = data.parameters_at
    return BatchRhs(model, compiled, members, rank, factors, own_networks, parameters_at, loads)


def batch_form(layout: Layout) -> Callable[[Kernel], Any]:
    """What gives the compiled form of the kernels of a layout :func:`side_by_side`."""
    derivatives = {block.device.derivative for block in layout.blocks}

    def compiled_of(kernel: Kernel) -> Any:
        return (batch_derivative if kernel in derivatives else batch_kernel)(kernel)

    return compiled_of


def kernel_parameters(block: Block) -> NDArray[np.float64]:
    """Parameters of a block as its kernels in a batch take them, shape (n_rows, n_units)."""
    if block.device.derivative is None:
        return block.parameters
    inverses = with_products(block.device.derivative).inverses(block.parameters)
    return np.concatenate([block.parameters, inverses])


def side_by_side(layout: Layout, members: int) -> Layout:
    """The layout of which each entry stands for all members."""

    def places(index: NDArray[np.int64]) -> NDArray[np.int64]:
        wide = index[..., None] * members + np.arange(members)
        return wide.reshape(*index.shape[:-1], -1)

    def block(one: Block) -> Block:
        return replace(
            one,
            units=tuple(unit for unit in one.units for _ in range(members)),
            parameters=np.repeat(kernel_parameters(one), members, axis=1),
            state_start=one.state_start * members,
            signal_start=one.signal_start * members,
            inputs=places(one.inputs),
        )

    return replace(
        layout,
        blocks=tuple(map(block, layout.blocks)),
        n_states=layout.n_states * members,
        n_signals=layout.n_signals * members,
        terminals=tuple(bus for bus in layout.terminals for _ in range(members)),
        sources=np.zeros((0, 3), dtype=np.int64),
        source_units=(),
    )


@compiled_part
def _add_currents(integers, reals, work):
    """Add up the Norton currents of the machines that are in service."""
    members = integers[MEMBERS]
    currents = work[integers[N_SIGNALS] :]
    n = integers[N_TERMINALS]
    zero = all_lanes(0.0)
    for k in range(0, 2 * n, WIDTH):
        store_lanes(currents, k, zero)
    live = reals[integers[LIVE_AT] :]
    machines = integers[integers[MACHINES_AT] :]
    for s in range(integers[N_MACHINES]):
        real, imaginary = machines[3 * s] * members, machines[3 * s + 1] * members
        at = machines[3 * s + 2] * members
        for b in range(0, members, WIDTH):
            on = load_lanes(live, s * members + b)
            here = load_lanes(currents, at + b)
            store_lanes(currents, at + b, here + on * load_lanes(work, real + b))
            here = load_lanes(currents, n + at + b)
            store_lanes(currents, n + at + b, here + on * load_lanes(work, imaginary + b))


@compiled_part
def _solve(integers, reals, work):
    """Voltages of the terminals: those of the intact network, and what compensating currents add."""
    members, n = integers[MEMBERS], integers[N_TERMINALS]
    currents = work[integers[N_SIGNALS] :]
    voltages = work[integers[N_SIGNALS] - 2 * n :]
    scratch = work[integers[SCRATCH_AT] :]
    if integers[LOADS_AT]:
        own, values = integers[integers[LOADS_AT] :], reals[integers[LOAD_REALS_AT] :]
        compensating = work[integers[COMPENSATING_AT] :]
        solve_with_loads(own, values, members, currents, voltages, compensating, scratch)
        return
    factors, values = integers[integers[FACTORS_AT] :], reals[integers[FACTOR_REALS_AT] :]
    group_reals = integers[GROUP_REALS]
    for group in range(members // WIDTH):
        first = group * WIDTH
        put_currents(factors, currents, members, first, scratch)
        if group_reals:
            solve_each(factors, values[group * group_reals :], scratch)
        else:
            solve_group(factors, values, scratch)
        take_voltages(factors, scratch, members, first, voltages)
        rank = integers[integers[RANKS_AT] + group]
        if rank:
            _compensate(integers, reals, work, first, rank)


@compiled_part
def _compensate(integers, reals, work, first, rank):
    members, wide = integers[MEMBERS], integers[N_TERMINALS]
    n = wide // members
    currents = work[integers[N_SIGNALS] :]
    voltages = work[integers[N_SIGNALS] - 2 * wide :]
    drawn, caused = reals[integers[DRAWN_AT] :], reals[integers[CAUSED_AT] :]
    compensating = work[integers[COMPENSATING_AT] :]
    for r in range(rank):
        j_r, j_i = all_lanes(0.0), all_lanes(0.0)
        for t in range(n):
            at = 2 * (r * n + t) * members + first
            w_r, w_i = load_lanes(drawn, at), load_lanes(drawn, at + members)
            i_r = load_lanes(currents, t * members + first)
            i_i = load_lanes(currents, wide + t * members + first)
            j_r = j_r - w_r * i_r + w_i * i_i
            j_i = j_i - w_r * i_i - w_i * i_r
        store_lanes(compensating, 2 * r * members + first, j_r)
        store_lanes(compensating, (2 * r + 1) * members + first, j_i)
        for t in range(n):
            at = 2 * (r * n + t) * members + first
            z_r, z_i = load_lanes(caused, at), load_lanes(caused, at + members)
            real, imaginary = t * members + first, wide + t * members + first
            v_r, v_i = load_lanes(voltages, real), load_lanes(voltages, imaginary)
            store_lanes(voltages, real, v_r + z_r * j_r - z_i * j_i)
            store_lanes(voltages, imaginary, v_i + z_r * j_i + z_i * j_r)


@compiled_part
def _find_currents(integers, reals, work, x, dx):
    for i in range(0, integers[N_STATES], WIDTH):
        store_lanes(work, i, load_lanes(x, i))
    load_constants(integers, reals, work)
    run_calls(0, integers[N_SOURCE_CALLS], integers, reals, work, x, dx)
    _add_currents(integers, reals, work)


def _batch_rhs(integers, reals, work, x, dx):
    _find_currents(integers, reals, work, x, dx)
    _solve(integers, reals, work)
    n_source, n_output = integers[N_SOURCE_CALLS], integers[N_OUTPUT_CALLS]
    run_calls(n_source, n_output, integers, reals, work, x, dx)
    run_calls(n_source + n_output, integers[N_DERIVATIVE_CALLS], integers, reals, work, x, dx)
    for k in range(integers[N_FROZEN]):
        dx[integers[integers[FROZEN_AT] + k]] = 0.0


def _currents(integers, reals, work, x, dx):
    _find_currents(integers, reals, work, x, dx)
    members = integers[MEMBERS]
    for group in range(members // WIDTH):
        if integers[integers[RANKS_AT] + group]:
            _solve(integers, reals, work)
            return


@cache
def _compiled() -> Any:
    return compile_callback(_batch_rhs, RHS_SIGNATURE)


@cache
def _compiled_currents() -> Any:
    return compile_callback(_currents, RHS_SIGNATURE)
