"""The network between exact units and the ports of a linear area.

Loads of the study area stay as they are. Other loads that are no impedances are linear about the
operating point, in a frame that turns with the mean angle of the exact machines:

    V = K (I + c),    c = i(V0) - G V0,    K = (Y - G)^-1,

with G the slopes of their currents i at the operating point's voltages V0. The network is then one
constant map from the currents at terminals to their voltages, and a constant.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import (
    CompiledNetwork,
    NonlinearLoads,
    compile_with_loads,
)
from gridfold.dynamics.network.backend import NETWORK_SIGNATURE
from gridfold.dynamics.network.dense import real_dense_network
from gridfold.dynamics.network.loads import with_loads
from gridfold.dynamics.network.real_sparse import real_matrix
from gridfold.numerics.compiled import compile_callback, invoke

_HEADER = 4


@dataclass(frozen=True)
class PortNetwork:
    """A compiled network; `turns` tells that it is meant in a frame that turns with the machines."""

    network: CompiledNetwork
    turns: bool


def load_buses(model: DetailedModel, study: Collection[int]) -> tuple[int, ...]:
    """Buses of the study area with loads that are no impedances."""
    loads = model.injections.nonlinear
    return () if loads is None else tuple(bus for bus in loads.buses if bus in study)


def port_network(
    model: DetailedModel,
    terminals: tuple[int, ...],
    study: Collection[int],
    origin: NDArray[np.float64],
) -> PortNetwork:
    """The network in the state of `model` as seen from `terminals`.

    Parameters
    ----------
    model : DetailedModel
        The whole system.
    terminals : tuple of int
        Bus numbers of exact machines, of ports and of :func:`load_buses`.
    study : collection of int
        Bus numbers of the study area.
    origin : ndarray, shape (n_states,)
        The operating point.
    """
    index = model.case.bus_index
    equations = model.equations.seen_from([index[bus] for bus in terminals])
    loads = model.injections.nonlinear
    far = [] if loads is None else [k for k, bus in enumerate(loads.buses) if bus not in study]
    if loads is None or not far:
        compiled = compile_with_loads(equations, model.backend, terminals, model.injections)
        return PortNetwork(compiled, turns=False)
    voltages = model.bus_voltages(origin[None, :])[0]
    at_loads = voltages[[index[bus] for bus in loads.buses]]
    slopes = loads.slopes(at_loads)
    rows = equations.bus_rows[[index[bus] for bus in loads.buses]]
    factors = splu(real_matrix(equations, slopes, rows))
    constant = _constants(loads, at_loads, slopes, rows, far, len(equations.live))
    seen = _both(equations.terminals, len(equations.live))
    offset = np.where(seen >= 0, factors.solve(constant)[seen], 0.0)
    columns = np.zeros((2 * len(equations.live), len(seen)))
    columns[seen[seen >= 0], np.flatnonzero(seen >= 0)] = 1.0
    matrix = np.where(seen[:, None] >= 0, factors.solve(columns)[seen], 0.0)
    linear = _with_offset(real_dense_network(matrix), offset)
    near = [k for k in range(len(loads.buses)) if k not in set(far)]
    if not near:
        return PortNetwork(linear, turns=True)
    guess = voltages[[index[bus] for bus in terminals]]
    own = with_loads(linear, loads.at(near), terminals, guess, slopes[near])
    return PortNetwork(own, turns=True)


def _both(rows: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """Rows in real form, -1 stays."""
    return np.concatenate([rows, np.where(rows >= 0, n + rows, -1)])


def _constants(
    loads: NonlinearLoads,
    voltages: NDArray[np.complex128],
    slopes: NDArray[np.float64],
    rows: NDArray[np.int64],
    far: list[int],
    n: int,
) -> NDArray[np.float64]:
    """C of the far loads over all nodes, (2 n,)."""
    drawn = loads.currents(voltages)
    parts = np.stack([voltages.real, voltages.imag], axis=1)
    linear = np.einsum("kij,kj->ki", slopes, parts)
    result = np.zeros(2 * n)
    for k in far:
        if rows[k] >= 0:
            result[rows[k]] += drawn[k].real - linear[k, 0]
            result[n + rows[k]] += drawn[k].imag - linear[k, 1]
    return result


def _with_offset(network: CompiledNetwork, offset: NDArray[np.float64]) -> CompiledNetwork:
    """The network with constant voltages added."""
    header = [len(offset), network.address, network.integers.size, network.reals.size]
    return CompiledNetwork(
        _compiled().address,
        np.concatenate([header, network.integers]).astype(np.int64),
        np.concatenate([offset, network.reals]),
        network.scratch_size,
    )


def _solve(integers, reals, currents, voltages, scratch):
    n = integers[0]
    invoke(
        integers[1],
        (
            integers[_HEADER : _HEADER + integers[2]],
            reals[n : n + integers[3]],
            currents,
            voltages,
            scratch,
        ),
    )
    for t in range(n):
        voltages[t] += reals[t]


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
