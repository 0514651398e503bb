"""Dense against sparse network equations on chains of NPCC copies, and where they cross."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from chain import chain
from fused import largest_difference
from report import Section, Table, machine, one_thread
from timing import Timings, interleave, network_calls, rhs_calls

from gridfold import Case, NetworkBackend, build_model, load_case
from gridfold.dynamics.network import SPARSE_FROM, compile_network

COPIES = (1, 2, 3, 4, 6, 8)

_CALLS = 50
_HEADS = (
    "terminals", "buses",
    "network dense", "network sparse", "dense / sparse",
    "rhs dense", "rhs sparse", "dense / sparse",
    "largest difference",
)  # fmt: skip


@dataclass(frozen=True)
class Size:
    """Timings of both backends on one chain, and how far their derivatives differ."""

    terminals: int
    buses: int
    timings: Timings
    difference: float

    def ratio(self, what: str) -> float:
        """Median ratio of dense to sparse of the ``network`` or the whole ``rhs``."""
        return self.timings.ratio(f"{what} dense", f"{what} sparse").median

    @property
    def row(self) -> tuple[str, ...]:
        """The row of the table."""
        cells = [
            cell
            for what in ("network", "rhs")
            for cell in (
                self.timings.scaled(f"{what} dense", 1e-6 * _CALLS),
                self.timings.scaled(f"{what} sparse", 1e-6 * _CALLS),
                str(self.timings.ratio(f"{what} dense", f"{what} sparse")),
            )
        ]
        return str(self.terminals), str(self.buses), *cells, f"{self.difference:.1e}"


def time_size(case: Case, repetitions: int = 150) -> Size:
    """Time both backends on one case.

    Raises
    ------
    AssertionError
        Their derivatives differ.
    """
    dense = build_model(case, backend=NetworkBackend.DENSE)
    sparse = build_model(case, dense.power_flow, NetworkBackend.SPARSE)
    difference = largest_difference(sparse.compiled, dense.compiled, dense.x0, count=5)
    assert difference < 1e-10, f"{case.name}: the backends differ by {difference:.1e}"
    n = len(dense.layout.terminals)
    currents = np.random.default_rng(1).standard_normal(2 * n)
    actions = {}
    for model in (dense, sparse):
        network = compile_network(model.equations, model.backend)
        name = model.backend.value
        actions[f"network {name}"] = network_calls(network, currents, _CALLS)
        actions[f"rhs {name}"] = rhs_calls(model.compiled, model.x0, _CALLS)
    return Size(n, len(case.buses), interleave(actions, repetitions), difference)


def crossover(sizes: Sequence[Size], what: str) -> float:
    """Number of terminals at which dense and sparse take equal time, on a doubly logarithmic scale.

    A ratio below that of a smaller chain is noise; interpolation needs ratios that do not fall.
    """
    ratios = np.log([size.ratio(what) for size in sizes])
    terminals = np.log([size.terminals for size in sizes])
    return float(np.exp(np.interp(0.0, np.maximum.accumulate(ratios), terminals)))


def measure(copies: Sequence[int] = COPIES) -> Section:
    """Measure all chains."""
    case = load_case("npcc")
    sizes = [time_size(chain(case, count)) for count in copies]
    table = Table(
        "Microseconds, min / median: the network equations alone, and the whole right-hand side (rhs)",
        _HEADS,
        [size.row for size in sizes],
    )
    remarks = (
        f"Dense and sparse take equal time at {crossover(sizes, 'network'):.0f} terminals for the "
        f"network alone and at {crossover(sizes, 'rhs'):.0f} for the whole right-hand side. The "
        f"automatic choice is sparse from {SPARSE_FROM} terminals on.",
        "The derivatives of both backends agree to the largest difference shown, at five states "
        "around the equilibrium. One thread.",
    )
    return Section("Network equations, dense and sparse", "network_backends.py", (table,), remarks)


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
