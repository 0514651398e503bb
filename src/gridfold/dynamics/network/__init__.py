"""The network between the machines: equations of a network state, and compiled solvers for them."""

from gridfold.dynamics.network.backend import CompiledNetwork, NetworkBackend
from gridfold.dynamics.network.dense import dense_network
from gridfold.dynamics.network.equations import Injections, NetworkEquations, build_equations
from gridfold.dynamics.network.sparse import sparse_network

#: Number of machine terminals from which the sparse backend is faster (see docs/benchmarks.md).
SPARSE_FROM = 125


def compile_network(equations: NetworkEquations, backend: NetworkBackend) -> CompiledNetwork:
    """Compile `equations` for the chosen backend."""
    if backend is NetworkBackend.AUTO:
        many = len(equations.terminals) >= SPARSE_FROM
        backend = NetworkBackend.SPARSE if many else NetworkBackend.DENSE
    if backend is NetworkBackend.SPARSE:
        return sparse_network(equations)
    return dense_network(equations.terminal_impedance())


__all__ = [
    "CompiledNetwork",
    "Injections",
    "NetworkBackend",
    "NetworkEquations",
    "build_equations",
    "compile_network",
    "dense_network",
]
