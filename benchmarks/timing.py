"""Timing on machines that are not quiet: short repetitions, interleaved, minimum and median."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gridfold.dynamics.network.backend import CompiledNetwork
from gridfold.numerics.compiled import invoke
from gridfold.numerics.implicit import CompiledSolver
from gridfold.numerics.rhs import CompiledRhs

Action = Callable[[], object]


@dataclass(frozen=True)
class Timings:
    """CPU seconds of several actions, (n_actions, n_repetitions); a column is one round of all."""

    names: tuple[str, ...]
    seconds: NDArray[np.float64]

    def of(self, name: str) -> NDArray[np.float64]:
        """Seconds of every repetition of one action."""
        return np.asarray(self.seconds[self.names.index(name)])

    def minimum(self, name: str) -> float:
        """Shortest time in seconds."""
        return float(self.of(name).min())

    def median(self, name: str) -> float:
        """Median time in seconds."""
        return float(np.median(self.of(name)))

    def ratio(self, name: str, base: str) -> Ratio:
        """Time of `name` over that of `base`."""
        pairs = self.of(name) / self.of(base)
        return Ratio(self.minimum(name) / self.minimum(base), float(np.median(pairs)))

    def scaled(self, name: str, unit: float) -> str:
        """Minimum and median in units of `unit` seconds, as text."""
        return f"{self.minimum(name) / unit:.2f} / {self.median(name) / unit:.2f}"


@dataclass(frozen=True)
class Ratio:
    """Ratio of the shortest times, and median of the ratios within each round."""

    of_minima: float
    median: float

    def __str__(self) -> str:
        return f"{self.of_minima:.2f} / {self.median:.2f}"


def interleave(actions: Mapping[str, Action], repetitions: int) -> Timings:
    """CPU seconds of all actions in turn, `repetitions` times, after one untimed round."""
    for action in actions.values():
        action()
    seconds = np.empty((len(actions), repetitions))
    for column in range(repetitions):
        for row, action in enumerate(actions.values()):
            began = time.process_time()
            action()
            seconds[row, column] = time.process_time() - began
    return Timings(tuple(actions), seconds)


def first_and_second(command: Sequence[str]) -> tuple[float, float]:
    """Seconds that a process takes with no compiled code in its cache, and once more with it there.

    Raises
    ------
    subprocess.CalledProcessError
        The command failed.
    """
    with TemporaryDirectory() as cache:
        folders = {"NUMBA_CACHE_DIR": f"{cache}/numba", "MPLCONFIGDIR": f"{cache}/matplotlib"}
        seconds = []
        for _ in range(2):
            began = time.perf_counter()
            subprocess.run(
                command, env=os.environ | folders, cwd=cache, check=True, capture_output=True
            )
            seconds.append(time.perf_counter() - began)
    return seconds[0], seconds[1]


def rhs_calls(rhs: CompiledRhs, x: NDArray[np.float64], count: int) -> Action:
    """`count` calls of a right-hand side at the state `x` in a compiled loop."""
    work, dx = np.zeros(rhs.work_size), np.empty(rhs.n_states)
    return lambda: _repeat(count, rhs.address, rhs.integers, rhs.reals, x, dx, work)


def network_calls(network: CompiledNetwork, currents: NDArray[np.float64], count: int) -> Action:
    """`count` solutions of the network equations in a compiled loop."""
    scratch, voltages = np.zeros(network.scratch_size), np.empty_like(currents)
    return lambda: _repeat_network(
        count, network.address, network.integers, network.reals, currents, voltages, scratch
    )


def solver_calls(solver: CompiledSolver, b: NDArray[np.float64], count: int) -> Action:
    """`count` uses of a solver of Newton's equation in a compiled loop."""
    scratch, y = np.zeros(solver.scratch_size), np.empty_like(b)
    return lambda: _repeat_network(
        count, solver.address, solver.integers, solver.reals, b, y, scratch
    )


@njit(cache=True)
def _repeat(
    count: int, address: int, integers: Any, reals: Any, x: Any, dx: Any, work: Any
) -> None:
    for _ in range(count):
        invoke(address, (integers, reals, work, x, dx))


@njit(cache=True)
def _repeat_network(
    count: int, address: int, integers: Any, reals: Any, currents: Any, voltages: Any, scratch: Any
) -> None:
    for _ in range(count):
        invoke(address, (integers, reals, currents, voltages, scratch))
