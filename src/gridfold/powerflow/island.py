"""Newton's method on one island, through lightsim2grid's KLU solver.

Several swing buses of an island all hold voltage and angle: they are one bus behind ideal transformers,
whose ratios are the ratios of their voltages.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from lightsim2grid.algorithm import NRSing_KLU
from numpy.typing import NDArray
from scipy.sparse import csc_array, csc_matrix

from gridfold.powerflow.angles import ShiftedBranches
from gridfold.powerflow.rounding import rounding_power

_MAX_ITERATIONS = 30
_PROGRESS = 0.1  # of an iteration that rounding does not hold up


@dataclass(frozen=True)
class Problem:
    """One island: admittances, scheduled injections and kinds of nodes, by position in the island."""

    admittance: csc_array
    scheduled: NDArray[np.complex128]
    branches: ShiftedBranches
    slack: NDArray[np.int32]
    voltage_held: NDArray[np.int32]
    power_held: NDArray[np.int32]

    def mismatch(self, voltage: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Power mismatch where it counts: active at all but the slack, reactive at PQ buses."""
        current: NDArray[np.complex128] = self.admittance @ voltage
        error = voltage * np.conj(current) - self.scheduled
        error[self.voltage_held] = error[self.voltage_held].real
        error[self.slack] = 0
        return error

    def misfit(self, voltage: NDArray[np.complex128]) -> float:
        """The sum of all mismatches in per unit."""
        return float(np.abs(self.mismatch(voltage)).sum())

    def excess(self, voltage: NDArray[np.complex128], tolerance: float) -> float:
        """The largest mismatch as a part of what is allowed at its bus; infinite if it is no number."""
        if voltage.shape != self.scheduled.shape or not np.isfinite(voltage).all():
            return np.inf
        allowed = np.maximum(tolerance, rounding_power(self.admittance, voltage))
        return float((np.abs(self.mismatch(voltage)) / allowed).max())


@dataclass(frozen=True)
class Point:
    """Voltages of an island after some iterations, and how far they exceed what is allowed."""

    voltage: NDArray[np.complex128]
    iterations: int
    excess: float


def solve_island(problem: Problem, stored: NDArray[np.complex128], tolerance: float) -> Point:
    """The first solution with small angles; else of all the one with the least, or the nearest point.

    With the lower of the two voltages at which a line can carry a load its angle is above 45 degrees.
    """
    points = []
    for start in _starts(problem, stored):
        point = _search(problem, start, tolerance)
        angle = problem.branches.largest_angle(point.voltage)
        if point.excess <= 1 and angle < np.pi / 4:
            return point
        points.append((max(point.excess, 1.0), round(angle, 6), point))
    return min(points, key=lambda item: item[:2])[2]


def _starts(problem: Problem, stored: NDArray[np.complex128]) -> Iterator[NDArray[np.complex128]]:
    """Voltages to start from: the stored ones, and flat ones whose angles follow the shifts.

    Stored angles that fit the shifts worse than none at all come second.
    """
    first = problem.slack[0]
    idle = problem.branches.idle_angles(len(stored))
    turned = np.exp(1j * (idle - idle[first] + np.angle(stored[first])))
    turned[problem.slack] = np.exp(1j * np.angle(stored[problem.slack]))
    size = np.abs(stored)
    if idle.any() and problem.misfit(size * turned) < problem.misfit(stored):
        yield size * turned
    yield stored
    size[problem.power_held] = 1.0
    yield size * turned


def _search(problem: Problem, start: NDArray[np.complex128], tolerance: float) -> Point:
    """Where Newton's method ends, at the latest where rounding stops it; else the nearest point."""
    end = _newton(problem, start, _MAX_ITERATIONS, tolerance)
    if end.excess <= 1 and end.iterations < _MAX_ITERATIONS:
        return end
    points = [Point(start, 0, np.inf)]
    for count in range(1, _MAX_ITERATIONS):
        before = points[-1]
        point = replace(_newton(problem, before.voltage, 1, tolerance), iterations=count)
        if before.excess <= 1 and point.excess > _PROGRESS * before.excess:
            return min(before, point, key=lambda item: item.excess)
        points.append(point)
    return min(*points, end, key=lambda item: item.excess)


def _newton(
    problem: Problem, start: NDArray[np.complex128], allowed: int, tolerance: float
) -> Point:
    solver = NRSing_KLU()
    one, spread = _with_one_slack(problem, start)
    kept = np.setdiff1d(np.arange(len(start)), problem.slack[1:])
    weights = np.zeros(len(kept))
    weights[one.slack] = 1.0
    solver.compute_pf(
        csc_matrix(one.admittance), start[kept], one.scheduled, one.slack,
        weights, one.voltage_held, one.power_held, allowed, tolerance / 2,
    )  # fmt: skip
    found = np.array(solver.get_V())
    voltage = spread @ found if found.shape == kept.shape else found
    excess = problem.excess(voltage, tolerance)
    return Point(voltage if np.isfinite(excess) else start, int(solver.get_nb_iter()), excess)


def _with_one_slack(problem: Problem, start: NDArray[np.complex128]) -> tuple[Problem, csc_array]:
    """The island with its first swing bus alone, and the matrix that gives all voltages from those."""
    n, slack = len(start), problem.slack
    kept = np.setdiff1d(np.arange(n), slack[1:])
    place = np.zeros(n, dtype=np.int32)
    place[kept] = np.arange(len(kept))
    place[slack] = place[slack[0]]
    ratio = np.ones(n, dtype=np.complex128)
    ratio[slack] = start[slack] / start[slack[0]]
    spread = csc_array((ratio, (np.arange(n), place)), shape=(n, len(kept)))
    if len(slack) == 1:
        return problem, spread
    folded = csc_array(spread.conj().T @ problem.admittance @ spread)
    alone = replace(
        problem,
        admittance=folded,
        scheduled=problem.scheduled[kept],
        slack=place[slack[:1]],
        voltage_held=place[problem.voltage_held],
        power_held=place[problem.power_held],
    )
    return alone, spread
