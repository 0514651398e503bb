"""Power flow by Newton's method, through lightsim2grid's KLU solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from lightsim2grid.algorithm import NRSing_KLU
from numpy.typing import NDArray
from scipy.sparse import csc_array, csc_matrix

from gridfold.errors import PowerFlowError
from gridfold.grid.admittance import bus_admittance
from gridfold.grid.case import Case, Control, Load
from gridfold.grid.islands import island_labels
from gridfold.grid.validation import require_valid
from gridfold.powerflow.angles import ShiftedBranches, shifted_branches
from gridfold.powerflow.result import PowerFlowResult
from gridfold.powerflow.rounding import rounding_power

_MAX_ITERATIONS = 30
_MAX_LOAD_ITERATIONS = 100
_WORST = 5
_PROGRESS = 0.1  # of an iteration that rounding does not hold up


@dataclass(frozen=True)
class _Problem:
    """One island: admittances, scheduled injections and bus kinds, by position within the island."""

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
class _Point:
    """Voltages of an island after some iterations, and how far they exceed what is allowed."""

    voltage: NDArray[np.complex128]
    iterations: int
    excess: float


def solve_power_flow(case: Case, tolerance: float = 1e-10) -> PowerFlowResult:
    """Solve the power flow of a case.

    Newton's method starts from the stored voltages, and once more from a flat start if that fails or
    leaves more than 45 degrees across an impedance. The angles of a flat start follow the phase shifts
    of transformers; it comes first where stored angles do not. Of two solutions that with the smaller
    angles is taken.
    Where loads depend on voltage, it is repeated with the loads of the last voltages until both fit.
    Reactive limits are not enforced.

    Parameters
    ----------
    case : Case
        A valid case.
    tolerance : float
        Largest power mismatch allowed, in per unit on the system base. Where admittances are so large
        that rounding alone leaves more, ``100 eps (|Y| |V|)_i |V_i|`` at bus i is allowed.

    Returns
    -------
    PowerFlowResult
        Voltages (n_buses,), powers of units (n_generators,) and loads (n_buses,), per unit.

    Raises
    ------
    CaseError
        The case is not valid.
    PowerFlowError
        No solution was found; names the buses with the largest mismatch.
    """
    require_valid(case)
    admittance = bus_admittance(case)
    voltage = np.array(
        [bus.voltage_pu * np.exp(1j * np.deg2rad(bus.angle_deg)) for bus in case.buses]
    )
    load = _load_power(case, np.abs(_at_set_points(case, voltage)))
    if not any(_depends_on_voltage(item) for item in case.loads):
        voltage, iterations, worst = _solve_islands(case, admittance, load, voltage, tolerance)
    else:
        voltage, load, iterations, worst = _solve_with_loads(
            case, admittance, load, voltage, tolerance
        )
    injection = voltage * np.conj(admittance @ voltage)
    unit_power = _share_out(case, injection + load)
    return PowerFlowResult(case, voltage, unit_power, load, iterations, worst)


def _solve_with_loads(
    case: Case,
    admittance: csc_array,
    load: NDArray[np.complex128],
    voltage: NDArray[np.complex128],
    tolerance: float,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], int, float]:
    """Voltages and loads that fit each other: power flows with the loads of the voltages before.

    Half of the tolerance is left to the power flow, half to the change of the loads.
    """
    iterations = 0
    for _ in range(_MAX_LOAD_ITERATIONS):
        voltage, count, worst = _solve_islands(case, admittance, load, voltage, tolerance / 2)
        iterations += count
        drawn = _load_power(case, np.abs(voltage))
        change = float(np.abs(drawn - load).max())
        load = drawn
        if change <= tolerance / 2:
            return voltage, load, iterations, worst + change
    raise PowerFlowError(
        f"case {case.name}: the loads that depend on voltage did not settle in "
        f"{_MAX_LOAD_ITERATIONS} power flows; they still change by {change * case.base_mva:.3g} MVA"
    )


def _solve_islands(
    case: Case,
    admittance: csc_array,
    load: NDArray[np.complex128],
    start: NDArray[np.complex128],
    tolerance: float,
) -> tuple[NDArray[np.complex128], int, float]:
    """Voltages with loads of constant power, most Newton iterations, largest mismatch."""
    scheduled, kind = _schedule(case, load)
    stored = _at_set_points(case, start)
    voltage = stored.copy()
    iterations, worst = 0, 0.0
    labels, branches = island_labels(case), shifted_branches(case)
    for members in np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1]):
        problem = _Problem(
            admittance[np.ix_(members, members)],
            scheduled[members],
            branches.among(members),
            *(
                np.flatnonzero(kind[members] == control).astype(np.int32)
                for control in (Control.SLACK, Control.VOLTAGE, Control.POWER)
            ),
        )
        found = _solve_island(problem, stored[members], tolerance)
        if found.excess > 1:
            raise PowerFlowError(_explain(case, problem, found.voltage, members))
        voltage[members] = found.voltage
        iterations = max(iterations, found.iterations)
        worst = max(worst, float(np.abs(problem.mismatch(voltage[members])).max()))
    return voltage, iterations, worst


def _depends_on_voltage(load: Load) -> bool:
    return load.in_service and any(
        (
            load.current_active_mw,
            load.current_reactive_mvar,
            load.impedance_active_mw,
            load.impedance_reactive_mvar,
        )
    )


def _load_power(case: Case, magnitude: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Load at each bus at these voltage magnitudes, all in per unit, shape (n_buses,)."""
    power = np.zeros(len(case.buses), dtype=np.complex128)
    for load in case.loads:
        if not load.in_service:
            continue
        at = case.bus_index[load.bus]
        power[at] += complex(load.active_mw, load.reactive_mvar)
        if _depends_on_voltage(load):
            v = magnitude[at]
            power[at] += complex(load.current_active_mw, load.current_reactive_mvar) * v
            power[at] += complex(load.impedance_active_mw, load.impedance_reactive_mvar) * v**2
    return power / case.base_mva


def _at_set_points(case: Case, voltage: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """`voltage` with the magnitudes that generators hold."""
    held = voltage.copy()
    for unit in case.generators:
        if unit.in_service and unit.control is not Control.POWER:
            at = case.bus_index[unit.bus]
            held[at] = voltage[at] * (unit.voltage_pu / np.abs(voltage[at]))
    return held


def _schedule(
    case: Case, load: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.object_]]:
    """Scheduled injection and kind of each bus."""
    scheduled = -load
    kind = np.full(len(case.buses), Control.POWER, dtype=object)
    rank = {Control.POWER: 0, Control.VOLTAGE: 1, Control.SLACK: 2}
    for unit in case.generators:
        if not unit.in_service:
            continue
        at = case.bus_index[unit.bus]
        scheduled[at] += complex(unit.active_mw, unit.reactive_mvar) / case.base_mva
        if rank[unit.control] > rank[kind[at]]:
            kind[at] = unit.control
    return scheduled, kind


def _solve_island(problem: _Problem, stored: NDArray[np.complex128], tolerance: float) -> _Point:
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


def _starts(problem: _Problem, stored: NDArray[np.complex128]) -> Iterator[NDArray[np.complex128]]:
    """Voltages to start from: the stored ones, and flat ones whose angles follow the shifts.

    Stored angles that fit the shifts worse than none at all come second.
    """
    slack = problem.slack[0]
    idle = problem.branches.idle_angles(len(stored))
    turned = np.exp(1j * (idle - idle[slack] + np.angle(stored[slack])))
    size = np.abs(stored)
    if idle.any() and problem.misfit(size * turned) < problem.misfit(stored):
        yield size * turned
    yield stored
    size[problem.power_held] = 1.0
    yield size * turned


def _search(problem: _Problem, start: NDArray[np.complex128], tolerance: float) -> _Point:
    """Where Newton's method ends, at the latest where rounding stops it; else the nearest point."""
    end = _newton(problem, start, _MAX_ITERATIONS, tolerance)
    if end.excess <= 1 and end.iterations < _MAX_ITERATIONS:
        return end
    points = [_Point(start, 0, np.inf)]
    for count in range(1, _MAX_ITERATIONS):
        before = points[-1]
        point = replace(_newton(problem, before.voltage, 1, tolerance), iterations=count)
        if before.excess <= 1 and point.excess > _PROGRESS * before.excess:
            return min(before, point, key=lambda item: item.excess)
        points.append(point)
    return min(*points, end, key=lambda item: item.excess)


def _newton(
    problem: _Problem, start: NDArray[np.complex128], allowed: int, tolerance: float
) -> _Point:
    solver = NRSing_KLU()
    weights = np.zeros(len(start))
    weights[problem.slack] = 1.0
    solver.compute_pf(
        csc_matrix(problem.admittance), start.copy(), problem.scheduled, problem.slack,
        weights, problem.voltage_held, problem.power_held, allowed, tolerance / 2,
    )  # fmt: skip
    voltage = np.array(solver.get_V())
    excess = problem.excess(voltage, tolerance)
    return _Point(voltage if np.isfinite(excess) else start, int(solver.get_nb_iter()), excess)


def _explain(
    case: Case, problem: _Problem, voltage: NDArray[np.complex128], members: NDArray[np.int64]
) -> str:
    error = problem.mismatch(voltage) * case.base_mva
    worst = np.argsort(-np.abs(error))[:_WORST]
    lines = [
        f"  bus {case.buses[members[k]].number}: {error[k].real:+.4g} MW, {error[k].imag:+.4g} Mvar "
        f"at {abs(voltage[k]):.4f} p.u."
        for k in worst
    ]
    return (
        f"case {case.name}: the power flow did not converge, neither from the stored voltages nor "
        f"from a flat start; the largest mismatches at the nearest point found:\n"
        + "\n".join(lines)
    )


def _share_out(case: Case, generation: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Divide the generation at each bus among its units."""
    power = np.zeros(len(case.generators), dtype=np.complex128)
    free_active = generation.real.copy()
    free_reactive = generation.imag.copy()
    active_share = np.zeros(len(case.buses))
    reactive_share = np.zeros(len(case.buses))
    live = [(k, u, case.bus_index[u.bus]) for k, u in enumerate(case.generators) if u.in_service]
    for _, unit, at in live:
        if unit.control is Control.SLACK:
            active_share[at] += unit.share
        else:
            free_active[at] -= unit.active_mw / case.base_mva
        if unit.control is Control.POWER:
            free_reactive[at] -= unit.reactive_mvar / case.base_mva
        else:
            reactive_share[at] += unit.share
    for k, unit, at in live:
        active, reactive = unit.active_mw / case.base_mva, unit.reactive_mvar / case.base_mva
        if unit.control is Control.SLACK:
            active = free_active[at] * unit.share / active_share[at]
        if unit.control is not Control.POWER:
            reactive = free_reactive[at] * unit.share / reactive_share[at]
        power[k] = complex(active, reactive)
    return power
