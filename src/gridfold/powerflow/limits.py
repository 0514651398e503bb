"""The operating point by set points, reactive limits and switched shunts, in place of the stored one.

Plants hold the voltage of their bus, or of a remote one, within their reactive limits: one beyond a
limit is put there, and let go again when the voltage asks for less. Several plants that hold one bus
share by their parts. Then switched shunts bring voltages into their bands, continuous ones to the edge,
discrete ones a step at a time; one that turns back stays. Swing units have no reactive limits. Taps and
phase shifters stay as stored.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError, PowerFlowError
from gridfold.grid.admittance import bus_admittance
from gridfold.grid.case import Case, Control
from gridfold.grid.flow_controls import ShuntMode
from gridfold.grid.islands import island_labels
from gridfold.grid.nodes import joined, node_of_buses
from gridfold.grid.validation import require_valid
from gridfold.powerflow.angles import shifted_branches
from gridfold.powerflow.controlled import Controlled, Held, Solution, solve_controlled
from gridfold.powerflow.injections import dc_flows, dc_power, load_power
from gridfold.powerflow.moved import moved_case
from gridfold.powerflow.plants import Plant, Switched, plants_of, switched_shunts_of

_ROUNDS = 200
_MARGIN = 1e-6  # p.u. of reactive power or voltage beyond a limit that counts
_STORED_MARGIN = 1e-4  # p.u., the same of stored values
_RETURNS = 3  # times that a plant is let go from its limits
_WORST = 5


class _At(IntEnum):
    """Where a plant is."""

    LEAST = -1
    HOLDING = 0
    MOST = 1


@dataclass
class _State:
    """What is switched: where each plant is, what each shunt holds, and how often they turned."""

    plants: list[_At]
    levels: list[float]
    targets: list[float | None]
    returns: Counter[int] = field(default_factory=Counter)
    turned: dict[int, int] = field(default_factory=dict)
    stuck: set[int] = field(default_factory=set)


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
        The case is not valid.
    PowerFlowError
        There is no such point, or none was found; names buses with the largest mismatch.
    """
    if not case.flow_controls:
        raise OptionError(
            f"case {case.name} gives no set points and limits, so that it can only be solved as "
            "stored; RAW and MATPOWER files do"
        )
    require_valid(case)
    return _Search(case).found()


class _Search:
    """Rounds of power flows, each with what the last one asked for."""

    def __init__(self, case: Case):
        self.case = case
        self.nodes = node_of_buses(case)
        self.firsts, self.place = np.unique(self.nodes, return_inverse=True)
        islands = island_labels(case)[self.firsts]
        self.plants: tuple[Plant, ...] = plants_of(case, self.place, islands)
        self.shunts: tuple[Switched, ...] = switched_shunts_of(case, self.place, islands)
        self.problem = self._problem()

    def found(self) -> Case:
        """The case where nothing is left to switch."""
        state = _State(
            [self._stored_at(plant) for plant in self.plants],
            [shunt.stored for shunt in self.shunts],
            [None] * len(self.shunts),
        )
        solution = self._first(state)
        for _ in range(_ROUNDS):
            if not (self._moved_plants(state, solution) or self._moved_shunts(state, solution)):
                return self._as_case(state, solution)
            solution = self._solved(state, solution)
        raise PowerFlowError(
            f"case {self.case.name}: limits and switched shunts did not settle in {_ROUNDS} rounds"
        )

    def _stored_at(self, plant: Plant) -> _At:
        """Where a plant is as stored: at a limit if its voltage is on the side that belongs to it."""
        below = plant.target - self.case.buses[self.firsts[plant.holds]].voltage_pu
        for at, limit in ((_At.MOST, plant.most), (_At.LEAST, plant.least)):
            reached = abs(plant.stored - limit) <= _STORED_MARGIN
            if reached and at * below > _STORED_MARGIN and not plant.swings:
                return at
        return _At.HOLDING

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

    def _first(self, state: _State) -> Solution:
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
        for start in (stored, flat):
            found = solve_controlled(
                self.problem.with_held(self._held(state)),
                Solution(start, made, np.zeros_like(start), converged=False),
            )
            if found.converged:
                return found
        raise PowerFlowError(self._explain(found, "with all units at their set points"))

    def _solved(self, state: _State, before: Solution) -> Solution:
        found = solve_controlled(self.problem.with_held(self._held(state)), before)
        if not found.converged:
            limited = sum(at is not _At.HOLDING for at in state.plants)
            raise PowerFlowError(self._explain(found, f"with {limited} plants at a reactive limit"))
        return found

    def _held(self, state: _State) -> list[Held]:
        """Plants, then shunts, as equations."""
        held = []
        for plant, at in zip(self.plants, state.plants, strict=True):
            limit = {_At.LEAST: plant.least, _At.HOLDING: None, _At.MOST: plant.most}[at]
            held.append(Held(plant.node, plant.holds, plant.target, limit, plant.part))
        for shunt, level, target in zip(self.shunts, state.levels, state.targets, strict=True):
            fixed = level if target is None else None
            held.append(Held(shunt.node, shunt.holds, target or 1.0, fixed, is_shunt=True))
        return held

    def _moved_plants(self, state: _State, solution: Solution) -> bool:
        """Put plants to limits that they are beyond, and let go those that the voltage frees."""
        moved = False
        size = np.abs(solution.voltage)
        for k, plant in enumerate(self.plants):
            at, made = state.plants[k], float(solution.reactive[k])
            excess = size[plant.holds] - plant.target
            if at is _At.HOLDING and not plant.swings:
                if made > plant.most + _MARGIN:
                    state.plants[k], moved = _At.MOST, True
                elif made < plant.least - _MARGIN:
                    state.plants[k], moved = _At.LEAST, True
            elif at is not _At.HOLDING and at * excess > _MARGIN and state.returns[k] < _RETURNS:
                state.returns[k] += 1
                state.plants[k], moved = _At.HOLDING, True
        return moved

    def _moved_shunts(self, state: _State, solution: Solution) -> bool:
        """Move shunts whose voltage is outside of its band, one for each node that is held."""
        size = np.abs(solution.voltage)
        busy = {p.holds for p, at in zip(self.plants, state.plants, strict=True) if not at}
        moved = False
        for k, shunt in enumerate(self.shunts):
            if shunt.holds in busy and state.targets[k] is not None:
                state.targets[k], moved = None, True  # a plant holds its voltage again
                state.levels[k] = float(solution.reactive[len(self.plants) + k])
            if shunt.holds in busy or k in state.stuck:
                continue
            wanted = (
                self._continuous(state, k, size, float(solution.reactive[len(self.plants) + k]))
                if shunt.mode is ShuntMode.CONTINUOUS
                else self._discrete(state, k, size)
            )
            if wanted:
                busy.add(shunt.holds)
                moved = True
        return moved

    def _continuous(
        self, state: _State, k: int, size: NDArray[np.float64], susceptance: float
    ) -> bool:
        shunt = self.shunts[k]
        if state.targets[k] is not None:
            state.levels[k] = min(max(susceptance, shunt.levels[0]), shunt.levels[-1])
            if state.levels[k] == susceptance:
                return False
            state.targets[k] = None
            return True
        voltage = size[shunt.holds]
        if shunt.band[0] - _MARGIN <= voltage <= shunt.band[1] + _MARGIN:
            return False
        below = voltage < shunt.band[0]
        if state.levels[k] == shunt.levels[-1 if below else 0]:
            return False
        if state.turned.setdefault(k, 1 if below else -1) != (1 if below else -1):
            state.stuck.add(k)
            return False
        state.targets[k] = shunt.band[0] if below else shunt.band[1]
        return True

    def _discrete(self, state: _State, k: int, size: NDArray[np.float64]) -> bool:
        shunt, voltage = self.shunts[k], size[self.shunts[k].holds]
        if shunt.band[0] - _MARGIN <= voltage <= shunt.band[1] + _MARGIN:
            return False
        way = 1 if voltage < shunt.band[0] else -1
        beyond = [level for level in shunt.levels if way * (level - state.levels[k]) > _MARGIN]
        if not beyond:
            return False
        if state.turned.setdefault(k, way) != way:
            state.stuck.add(k)
            return False
        state.levels[k] = min(beyond, key=lambda level: abs(level - state.levels[k]))
        return True

    def _as_case(self, state: _State, solution: Solution) -> Case:
        made = solution.reactive.tolist()
        count = len(self.plants)
        limited = [
            (plant, made[k])
            for k, (plant, at) in enumerate(zip(self.plants, state.plants, strict=True))
            if at is not _At.HOLDING
        ]
        over = [
            (plant, made[k])
            for k, plant in enumerate(self.plants)
            if plant.swings and not plant.least - _MARGIN <= made[k] <= plant.most + _MARGIN
        ]
        switched = [
            (shunt, made[count + k])
            for k, shunt in enumerate(self.shunts)
            if abs(made[count + k] - shunt.stored) > _MARGIN
        ]
        stuck = [self.shunts[k] for k in sorted(state.stuck)]
        voltage = solution.voltage[self.place]
        return moved_case(
            self.case, voltage, zip(self.plants, made, strict=False), limited, over, switched, stuck
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
