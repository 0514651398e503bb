"""Newton's method on one island, from several starts. All of its swing buses hold voltage and angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from gridfold.powerflow.angles import ShiftedBranches
from gridfold.powerflow.newton_steps import newton_steps
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
    voltage, iterations = newton_steps(
        problem.admittance, start, problem.scheduled, problem.slack,
        problem.voltage_held, problem.power_held, allowed, tolerance / 2,
    )  # fmt: skip
    excess = problem.excess(voltage, tolerance)
    return Point(voltage if np.isfinite(excess) else start, iterations, excess)
