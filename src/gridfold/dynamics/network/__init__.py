"""The network between the machines: equations of a network state, and compiled solvers for them."""

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.network.backend import CompiledNetwork, NetworkBackend
from gridfold.dynamics.network.dense import dense_network, real_dense_network
from gridfold.dynamics.network.equations import Injections, NetworkEquations, build_equations
from gridfold.dynamics.network.loads import LoadModel, NonlinearLoads, real_form, with_loads
from gridfold.dynamics.network.real_sparse import (
    near_solution,
    real_matrix,
    real_sparse_network,
)
from gridfold.dynamics.network.sparse import sparse_network

#: Number of machine terminals from which the sparse backend is faster (see docs/benchmarks.md).
SPARSE_FROM = 125
#: The same with nonlinear loads, for which the dense backend needs far fewer iterations.
SPARSE_WITH_LOADS_FROM = 300


def compile_network(equations: NetworkEquations, backend: NetworkBackend) -> CompiledNetwork:
    """Compile `equations` for the chosen backend."""
    if backend is NetworkBackend.AUTO:
        many = len(equations.terminals) >= SPARSE_FROM
        backend = NetworkBackend.SPARSE if many else NetworkBackend.DENSE
    if backend is NetworkBackend.SPARSE:
        return sparse_network(equations)
    return dense_network(equations.terminal_impedance())


def compile_with_loads(
    equations: NetworkEquations,
    backend: NetworkBackend,
    terminals: tuple[int, ...],
    injections: Injections,
) -> CompiledNetwork:
    """Compile `equations` with the nonlinear loads of `injections`, if there are any.

    `terminals` are bus numbers; those of the loads are among them.
    """
    loads = injections.nonlinear
    if loads is None:
        return compile_network(equations, backend)
    if backend is NetworkBackend.AUTO:
        many = len(terminals) >= SPARSE_WITH_LOADS_FROM
        backend = NetworkBackend.SPARSE if many else NetworkBackend.DENSE
    at = loads.places(terminals)
    currents = norton_currents(injections, terminals)
    voltages = near_solution(equations, currents, loads, at)
    slopes = loads.slopes(voltages[at])
    if backend is NetworkBackend.SPARSE:
        matrix = real_matrix(equations, slopes, equations.terminals[at])
        folded = real_sparse_network(matrix, equations.terminals)
    else:
        network = real_form(equations.terminal_impedance())
        own = loads.scattered(slopes, at, len(terminals))
        closed = np.linalg.solve(np.eye(len(own)) - network @ own, network)
        folded = real_dense_network(np.asarray(closed, dtype=np.float64))
    return with_loads(folded, loads, terminals, voltages, slopes)


def norton_currents(injections: Injections, terminals: tuple[int, ...]) -> NDArray[np.complex128]:
    """Norton currents of the sources at the operating point, by terminal, (n_terminals,)."""
    place = {bus: k for k, bus in enumerate(terminals)}
    currents = np.zeros(len(terminals), dtype=np.complex128)
    for unit, norton in injections.norton.items():
        if unit.bus in place:
            currents[place[unit.bus]] += norton
    return currents


__all__ = [
    "CompiledNetwork",
    "Injections",
    "LoadModel",
    "NetworkBackend",
    "NetworkEquations",
    "NonlinearLoads",
    "build_equations",
    "compile_network",
    "compile_with_loads",
    "dense_network",
    "real_form",
]
