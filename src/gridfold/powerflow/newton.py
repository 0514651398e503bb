"""Power flow by Newton's method, through lightsim2grid's KLU solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from lightsim2grid.algorithm import NRSing_KLU
from numpy.typing import NDArray
from scipy.sparse import csc_array, csc_matrix

from gridfold.errors import PowerFlowError
from gridfold.grid.admittance import bus_admittance
from gridfold.grid.case import Case, Control, Load
from gridfold.grid.islands import island_labels
from gridfold.grid.validation import require_valid
from gridfold.powerflow.result import PowerFlowResult

_MAX_ITERATIONS = 30
_MAX_LOAD_ITERATIONS = 100
_WORST = 5


@dataclass(frozen=True)
class _Problem:
    """One island: admittances, scheduled injections and bus kinds, by position within the island."""

    admittance: csc_array
    scheduled: NDArray[np.complex128]
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


def solve_power_flow(case: Case, tolerance: float = 1e-10) -> PowerFlowResult:
    """Solve the power flow of a case.

    Newton's method starts from the stored voltages, and once more from a flat start if that fails.
    Where loads depend on voltage, it is repeated with the loads of the last voltages until both fit.
    Reactive limits are not enforced.

    Parameters
    ----------
    case : Case
        A valid case.
    tolerance : float
        Largest power mismatch allowed, in per unit on the system base.

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
    labels = island_labels(case)
    for island in np.unique(labels):
        members = np.flatnonzero(labels == island)
        problem = _Problem(
            admittance[np.ix_(members, members)],
            scheduled[members],
            *(
                np.flatnonzero(kind[members] == control).astype(np.int32)
                for control in (Control.SLACK, Control.VOLTAGE, Control.POWER)
            ),
        )
        voltage[members], count = _solve_island(case, problem, stored[members], members, tolerance)
        iterations = max(iterations, count)
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


def _solve_island(
    case: Case,
    problem: _Problem,
    stored: NDArray[np.complex128],
    members: NDArray[np.int64],
    tolerance: float,
) -> tuple[NDArray[np.complex128], int]:
    flat = np.abs(stored).astype(np.complex128)
    flat[problem.power_held] = 1.0
    flat *= np.exp(1j * np.angle(stored[problem.slack[0]]))
    best, best_error = stored, np.inf
    for start in (stored, flat):
        for allowed in (_MAX_ITERATIONS, *range(1, _MAX_ITERATIONS)):
            voltage, count = _newton(problem, start, allowed, tolerance)
            finite = voltage.shape == start.shape and np.isfinite(voltage).all()
            error = np.abs(problem.mismatch(voltage)).max() if finite else np.inf
            if error < best_error:
                best, best_error = voltage, error
            if error <= tolerance:
                return voltage, count
    raise PowerFlowError(_explain(case, problem, best, members))


def _newton(
    problem: _Problem, start: NDArray[np.complex128], allowed: int, tolerance: float
) -> tuple[NDArray[np.complex128], int]:
    solver = NRSing_KLU()
    weights = np.zeros(len(start))
    weights[problem.slack] = 1.0
    solver.compute_pf(
        csc_matrix(problem.admittance), start.copy(), problem.scheduled, problem.slack,
        weights, problem.voltage_held, problem.power_held, allowed, tolerance / 2,
    )  # fmt: skip
    return np.array(solver.get_V()), int(solver.get_nb_iter())


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
