"""Newton's method with controls: reactive powers and susceptances are unknowns like voltages.

Unknowns are the angles of all nodes but swing nodes, all voltages, the reactive power of each plant and
the susceptance of each shunt that holds a voltage. Equations are the balances of active power (but at
swing nodes) and of reactive power, and one for each plant and shunt: the voltage of the node that it
holds, its part of the reactive power of several plants that hold one node, or a limit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

_ITERATIONS = 60
_LARGEST_ANGLE, _LARGEST_VOLTAGE = 0.5, 0.2  # rad and p.u. of a step


@dataclass(frozen=True)
class Held:
    """Something at a node that makes reactive power: a plant, or a shunt.

    Parameters
    ----------
    node : int
        Where it stands.
    holds : int
        The node whose voltage it holds.
    target : float
        The voltage in p.u.
    fixed : float or None
        Its reactive power, or susceptance, in p.u., where it holds no voltage.
    part : float
        Its part where several hold one node.
    is_shunt : bool
        Whether the unknown is a susceptance.
    """

    node: int
    holds: int
    target: float
    fixed: float | None
    part: float = 1.0
    is_shunt: bool = False


@dataclass(frozen=True)
class Controlled:
    """A network with what holds its voltages.

    Parameters
    ----------
    admittance : csc_array, shape (n_nodes, n_nodes)
        Without the shunts that are among `held`.
    scheduled : callable
        Power into the nodes at voltages (n_nodes,), without that of `held`.
    swing : ndarray of bool, shape (n_nodes,)
        Nodes whose angle is held.
    held : tuple of Held
        Plants and shunts.
    """

    admittance: csc_array
    scheduled: Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
    swing: NDArray[np.bool_]
    held: tuple[Held, ...]

    def with_held(self, held: Sequence[Held]) -> Controlled:
        """The same with other plants and shunts."""
        return replace(self, held=tuple(held))


@dataclass(frozen=True)
class Solution:
    """Voltages (n_nodes,), and the reactive power or susceptance of each of `held`, in p.u."""

    voltage: NDArray[np.complex128]
    reactive: NDArray[np.float64]
    mismatch: NDArray[np.complex128]
    converged: bool


def solve_controlled(problem: Controlled, start: Solution, tolerance: float = 1e-10) -> Solution:
    """Solve from a start; `converged` tells whether the largest mismatch is below `tolerance` p.u."""
    size, angle = np.abs(start.voltage), np.angle(start.voltage)
    made = start.reactive.copy()
    for k, item in enumerate(problem.held):
        made[k] = made[k] if item.fixed is None else item.fixed
    free = np.flatnonzero(~problem.swing)
    best: Solution | None = None
    for _ in range(_ITERATIONS):
        voltage = size * np.exp(1j * angle)
        error = _balance(problem, voltage, made)
        own = _control_errors(problem, size, made)
        worst = max(np.abs(error[free].real).max(initial=0.0), np.abs(error.imag).max(initial=0.0))
        worst = max(worst, np.abs(own).max(initial=0.0))
        shown = np.where(problem.swing, 1j * error.imag, error)
        best = Solution(voltage, made, shown, bool(worst <= tolerance))
        if best.converged or not np.isfinite(worst):
            return best
        matrix = _jacobian(problem, voltage, made, free)
        try:
            residual = np.concatenate([error[free].real, error.imag, own])
            step = -splu(matrix).solve(residual)
        except RuntimeError:  # singular
            return best
        turn, rise, more = np.split(step, [len(free), len(free) + len(size)])
        largest = max(
            np.abs(turn).max(initial=0.0) / _LARGEST_ANGLE,
            np.abs(rise).max(initial=0.0) / _LARGEST_VOLTAGE,
            1.0,
        )
        angle[free] += turn / largest
        size = size + rise / largest
        made = made + more / largest
    assert best is not None
    return best


def _balance(
    problem: Controlled, voltage: NDArray[np.complex128], made: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Power that leaves each node by the network, less what comes in."""
    power = voltage * np.conj(problem.admittance @ voltage) - problem.scheduled(voltage)
    for item, amount in zip(problem.held, made, strict=True):
        size = abs(voltage[item.node]) ** 2 if item.is_shunt else 1.0
        power[item.node] -= 1j * amount * size
    return np.asarray(power)


def _leaders(held: Sequence[Held]) -> dict[int, int]:
    """For each node that is held, the first that holds it."""
    leaders: dict[int, int] = {}
    for k, item in enumerate(held):
        if item.fixed is None:
            leaders.setdefault(item.holds, k)
    return leaders


def _control_errors(
    problem: Controlled, size: NDArray[np.float64], made: NDArray[np.float64]
) -> NDArray[np.float64]:
    leaders = _leaders(problem.held)
    errors = np.zeros(len(made))
    for k, item in enumerate(problem.held):
        leader = leaders.get(item.holds, k)
        if item.fixed is not None:
            errors[k] = made[k] - item.fixed
        elif leader == k:
            errors[k] = size[item.holds] - item.target
        else:
            errors[k] = made[k] / item.part - made[leader] / problem.held[leader].part
    return errors


def _jacobian(
    problem: Controlled,
    voltage: NDArray[np.complex128],
    made: NDArray[np.float64],
    free: NDArray[np.int64],
) -> csc_array:
    """Derivatives of the balances and controls by angles, voltages and what is made."""
    n, m, held = len(voltage), len(made), problem.held
    unit = voltage / np.abs(voltage)
    current = problem.admittance @ voltage
    at, across = diags_array(voltage), diags_array(unit)
    by_angle = 1j * at @ (diags_array(current) - problem.admittance @ at).conj()
    by_size = at @ (problem.admittance @ across).conj() + diags_array(current.conj()) @ across
    nodes = np.array([item.node for item in held], dtype=np.int64)
    shunts = np.array([item.is_shunt for item in held], dtype=bool)
    squared = np.where(shunts, np.abs(voltage[nodes]) ** 2, 1.0) if m else np.zeros(0)
    growth = np.zeros(n)
    if m:
        np.add.at(growth, nodes, np.where(shunts, 2 * made * np.abs(voltage[nodes]), 0.0))
    by_made = coo_array((-squared, (nodes, np.arange(m))), shape=(n, m))
    control_size, control_made = _control_slopes(problem, n)
    reactive_size = by_size.imag - diags_array(growth)
    return csc_array(
        block_array(
            [
                [by_angle.real.tocsr()[free][:, free], by_size.real.tocsr()[free], None],
                [by_angle.imag.tocsr()[:, free], reactive_size, by_made],
                [None, control_size, control_made],
            ],
            format="csc",
        )
    )


def _control_slopes(problem: Controlled, n: int) -> tuple[coo_array, coo_array]:
    held, leaders = problem.held, _leaders(problem.held)
    m = len(held)
    sizes: list[tuple[int, int, float]] = []
    amounts: list[tuple[int, int, float]] = []
    for k, item in enumerate(held):
        leader = leaders.get(item.holds, k)
        if item.fixed is not None:
            amounts.append((k, k, 1.0))
        elif leader == k:
            sizes.append((k, item.holds, 1.0))
        else:
            amounts += [(k, k, 1 / item.part), (k, leader, -1 / held[leader].part)]
    return _sparse(sizes, (m, n)), _sparse(amounts, (m, m))


def _sparse(entries: Sequence[tuple[int, int, float]], shape: tuple[int, int]) -> coo_array:
    rows = np.array([row for row, _, _ in entries], dtype=np.int64)
    columns = np.array([column for _, column, _ in entries], dtype=np.int64)
    values = np.array([value for _, _, value in entries], dtype=float)
    return coo_array((values, (rows, columns)), shape=shape)
