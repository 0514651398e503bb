"""The operating point by set points, reactive limits and switched shunts, in place of the stored one.

Plants hold the voltage of their bus, or of a remote one, within their reactive limits: one beyond a
limit is put there, and let go again when the voltage asks for less. Several plants that hold one bus
share by their parts. Then switched shunts bring voltages into their bands, continuous ones to the edge,
discrete ones a step at a time; one that turns back stays. Swing units have no reactive limits. Taps and
phase shifters stay as stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import CaseError, OptionError, PowerFlowError
from gridfold.grid.admittance import bus_admittance
from gridfold.grid.case import Case, Control
from gridfold.grid.islands import island_labels
from gridfold.grid.nodes import joined, node_of_buses
from gridfold.grid.validation import require_valid
from gridfold.powerflow.angles import shifted_branches
from gridfold.powerflow.controlled import Controlled, Solution, solve_controlled
from gridfold.powerflow.injections import dc_flows, dc_power, load_power
from gridfold.powerflow.moved import moved_case
from gridfold.powerflow.plants import (
    Plant,
    Switched,
    control_faults,
    out_of_reach,
    plants_of,
    switched_shunts_of,
)
from gridfold.powerflow.switching import MARGIN, At, Switching

_ROUNDS = 200
_STORED_MARGIN = 1e-4  # p.u. of stored values, which files round
_WORST = 5


def with_limits(case: Case) -> Case:
    """The case at the operating point that its set points, limits and switched shunts give.

    Its stored voltages, reactive powers and shunts are those of that point; units hold what they came
    to. `notices` tells what was moved.

    Parameters
    ----------
    case : Case
        A case with the controls of its file.

    Raises
    ------
    OptionError
        The case has no such controls.
    CaseError
        The case is not valid, or set points and limits make no sense; lists every fault.
    PowerFlowError
        There is no such point, or none was found; names buses with the largest mismatch.
    """
    if not case.flow_controls:
        raise OptionError(
            f"case {case.name} gives no set points and limits, so that it can only be solved as "
            "stored; RAW and MATPOWER files do"
        )
    require_valid(case)
    if faults := control_faults(case):
        raise CaseError(faults, f"case {case.name}, set points and limits")
    return _Search(case).found()


class _Search:
    """Rounds of power flows, each with what the last one asked for."""

    def __init__(self, case: Case):
        self.case = case
        self.nodes = node_of_buses(case)
        self.firsts, self.place = np.unique(self.nodes, return_inverse=True)
        islands = island_labels(case)[self.firsts]
        self.plants: tuple[Plant, ...] = plants_of(case, self.place, islands)
        self.astray = out_of_reach(case, self.place, islands)
        self.shunts: tuple[Switched, ...] = switched_shunts_of(case, self.place, islands)
        self.problem = self._problem()

    def found(self) -> Case:
        """The case where nothing is left to switch."""
        state = Switching(
            self.plants,
            self.shunts,
            [self._stored_at(plant) for plant in self.plants],
            [shunt.stored for shunt in self.shunts],
            [None] * len(self.shunts),
        )
        solution = self._first(state)
        for _ in range(_ROUNDS):
            if not (state.move_plants(solution) or state.move_shunts(solution)):
                return self._as_case(state, solution)
            solution = self._solved(state, solution)
        raise PowerFlowError(
            f"case {self.case.name}: limits and switched shunts did not settle in {_ROUNDS} rounds"
        )

    def _stored_at(self, plant: Plant) -> At:
        """Where a plant is as stored: at a limit if its voltage is on the side that belongs to it."""
        below = plant.target - self.case.buses[self.firsts[plant.holds]].voltage_pu
        for at, limit in ((At.MOST, plant.most), (At.LEAST, plant.least)):
            reached = abs(plant.stored - limit) <= _STORED_MARGIN
            if reached and at * below > _STORED_MARGIN and not plant.swings:
                return at
        return At.HOLDING

    def _problem(self) -> Controlled:
        case, n = self.case, len(self.firsts)
        controlled = {shunt.shunt for shunt in self.shunts}
        fixed = tuple(s for k, s in enumerate(case.shunts) if k not in controlled)
        by_bus = joined(bus_admittance(replace(case, shunts=fixed)), self.nodes)
        admittance = by_bus[self.firsts][:, self.firsts].tocsc()
        steady = np.zeros(n, dtype=np.complex128)
        swing = np.zeros(n, dtype=bool)
        for unit in case.generators:
            if unit.in_service:
                at = self.place[case.bus_index[unit.bus]]
                swing[at] |= unit.control is Control.SLACK
                given = unit.reactive_mvar if unit.control is Control.POWER else 0.0
                steady[at] += complex(unit.active_mw, given) / case.base_mva

        def scheduled(voltage: NDArray[np.complex128]) -> NDArray[np.complex128]:
            size = np.abs(voltage)[self.place]
            drawn = load_power(case, size) + dc_power(case, dc_flows(case, size))
            power = steady.copy()
            np.subtract.at(power, self.place, drawn)
            return power

        return Controlled(admittance, scheduled, swing, ())

    def _first(self, state: Switching) -> Solution:
        """From the stored voltages, else from a flat start with the angles of phase shifts."""
        buses = [self.case.buses[at] for at in self.firsts]
        stored = np.array([b.voltage_pu * np.exp(1j * np.deg2rad(b.angle_deg)) for b in buses])
        idle = shifted_branches(self.case).idle_angles(len(self.case.buses))[self.firsts]
        flat = np.exp(1j * (idle + np.angle(stored[np.argmax(self.problem.swing)])))
        flat[self.problem.swing] = stored[self.problem.swing]
        for unit in self.case.generators:  # of joined buses that of the swing unit counts
            at = self.case.bus_index[unit.bus]
            if unit.in_service and unit.control is Control.SLACK:
                bus = self.case.buses[at]
                phasor = bus.voltage_pu * np.exp(1j * np.deg2rad(bus.angle_deg))
                stored[self.place[at]] = flat[self.place[at]] = phasor
        made = np.array([*(plant.stored for plant in self.plants), *state.levels])
        problem, trouble = self.problem.with_held(state.held), ""
        for start in (stored, flat):
            try:
                nothing = np.zeros_like(start)
                found = solve_controlled(problem, Solution(start, made, nothing, converged=False))
            except PowerFlowError as error:  # a dc line at voltages on the way
                trouble = str(error)
                continue
            if found.converged:
                return found
            trouble = self._explain(found, "with all units at their set points")
        raise PowerFlowError(trouble)

    def _solved(self, state: Switching, before: Solution) -> Solution:
        found = solve_controlled(self.problem.with_held(state.held), before)
        if not found.converged:
            limited = sum(at is not At.HOLDING for at in state.at)
            raise PowerFlowError(self._explain(found, f"with {limited} plants at a reactive limit"))
        return found

    def _as_case(self, state: Switching, solution: Solution) -> Case:
        made = solution.reactive.tolist()
        count = len(self.plants)
        limited = [
            (plant, made[k])
            for k, (plant, at) in enumerate(zip(self.plants, state.at, strict=True))
            if at is not At.HOLDING
        ]
        over = [
            (plant, made[k])
            for k, plant in enumerate(self.plants)
            if plant.swings and not plant.least - MARGIN <= made[k] <= plant.most + MARGIN
        ]
        switched = [
            (shunt, made[count + k])
            for k, shunt in enumerate(self.shunts)
            if abs(made[count + k] - shunt.stored) > MARGIN
        ]
        stuck = [self.shunts[k] for k in sorted(state.stuck)]
        voltage = solution.voltage[self.place]
        return moved_case(
            self.case,
            voltage,
            zip(self.plants, made, strict=False),
            limited,
            over,
            switched,
            stuck,
            self.astray,
        )

    def _explain(self, solution: Solution, when: str) -> str:
        error = solution.mismatch * self.case.base_mva
        worst: Sequence[int] = np.argsort(-np.abs(np.nan_to_num(error, nan=np.inf)))[
            :_WORST
        ].tolist()
        lines = [
            f"  bus {self.case.buses[self.firsts[k]].number}: {error[k].real:+.4g} MW, "
            f"{error[k].imag:+.4g} Mvar at {abs(solution.voltage[k]):.4f} p.u."
            for k in worst
        ]
        return (
            f"case {self.case.name}: no operating point was found {when}; the largest mismatches at "
            "the last voltages:\n" + "\n".join(lines)
        )
