"""What is put to limits and switched between the power flows of :mod:`gridfold.powerflow.limits`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.flow_controls import ShuntMode
from gridfold.powerflow.controlled import Held, Solution
from gridfold.powerflow.plants import Plant, Switched

#: Reactive power or voltage in p.u. beyond a limit that counts.
MARGIN = 1e-6
_RETURNS = 3  # times that a plant is let go from its limits


class At(IntEnum):
    """Where a plant is."""

    LEAST = -1
    HOLDING = 0
    MOST = 1


@dataclass
class Switching:
    """Where each plant is, what each shunt holds, and how often they turned.

    Parameters
    ----------
    plants : sequence of Plant
        The plants, and `at` where each of them is.
    shunts : sequence of Switched
        The shunts, `levels` their susceptances in p.u., and `targets` the voltages that continuous ones
        hold, None where the susceptance is fixed.
    at, levels, targets : lists
        See above; they are changed in place.
    """

    plants: Sequence[Plant]
    shunts: Sequence[Switched]
    at: list[At]
    levels: list[float]
    targets: list[float | None]
    stuck: set[int] = field(default_factory=set)
    _returns: Counter[int] = field(default_factory=Counter)
    _turned: dict[int, int] = field(default_factory=dict)

    @property
    def held(self) -> list[Held]:
        """Plants, then shunts, as equations."""
        held = []
        for plant, at in zip(self.plants, self.at, strict=True):
            limit = {At.LEAST: plant.least, At.HOLDING: None, At.MOST: plant.most}[at]
            held.append(Held(plant.node, plant.holds, plant.target, limit, plant.part))
        for shunt, level, target in zip(self.shunts, self.levels, self.targets, strict=True):
            fixed = level if target is None else None
            held.append(Held(shunt.node, shunt.holds, target or 1.0, fixed, is_shunt=True))
        return held

    def move_plants(self, solution: Solution) -> bool:
        """Put plants to limits that they are beyond, and let go those that the voltage frees."""
        moved = False
        size = np.abs(solution.voltage)
        for k, plant in enumerate(self.plants):
            at, made = self.at[k], float(solution.reactive[k])
            excess = size[plant.holds] - plant.target
            if at is At.HOLDING and not plant.swings:
                if made > plant.most + MARGIN:
                    self.at[k], moved = At.MOST, True
                elif made < plant.least - MARGIN:
                    self.at[k], moved = At.LEAST, True
            elif at is not At.HOLDING and at * excess > MARGIN and self._returns[k] < _RETURNS:
                self._returns[k] += 1
                self.at[k], moved = At.HOLDING, True
        return moved

    def move_shunts(self, solution: Solution) -> bool:
        """Move shunts whose voltage is outside of its band, one for each node that is held."""
        size = np.abs(solution.voltage)
        busy = {p.holds for p, at in zip(self.plants, self.at, strict=True) if not at}
        moved = False
        for k, shunt in enumerate(self.shunts):
            if shunt.holds in busy and self.targets[k] is not None:
                self.targets[k], moved = None, True  # a plant holds its voltage again
                self.levels[k] = float(solution.reactive[len(self.plants) + k])
            if shunt.holds in busy or k in self.stuck:
                continue
            wanted = (
                self._continuous(k, size, float(solution.reactive[len(self.plants) + k]))
                if shunt.mode is ShuntMode.CONTINUOUS
                else self._discrete(k, size)
            )
            if wanted:
                busy.add(shunt.holds)
                moved = True
        return moved

    def _continuous(self, k: int, size: NDArray[np.float64], susceptance: float) -> bool:
        shunt = self.shunts[k]
        if self.targets[k] is not None:
            self.levels[k] = min(max(susceptance, shunt.levels[0]), shunt.levels[-1])
            if self.levels[k] == susceptance:
                return False
            self.targets[k] = None
            return True
        voltage = size[shunt.holds]
        if shunt.band[0] - MARGIN <= voltage <= shunt.band[1] + MARGIN:
            return False
        below = voltage < shunt.band[0]
        if self.levels[k] == shunt.levels[-1 if below else 0]:
            return False
        if self._turned.setdefault(k, 1 if below else -1) != (1 if below else -1):
            self.stuck.add(k)
            return False
        self.targets[k] = shunt.band[0] if below else shunt.band[1]
        return True

    def _discrete(self, k: int, size: NDArray[np.float64]) -> bool:
        shunt, voltage = self.shunts[k], size[self.shunts[k].holds]
        if shunt.band[0] - MARGIN <= voltage <= shunt.band[1] + MARGIN:
            return False
        way = 1 if voltage < shunt.band[0] else -1
        beyond = [level for level in shunt.levels if way * (level - self.levels[k]) > MARGIN]
        if not beyond:
            return False
        if self._turned.setdefault(k, way) != way:
            self.stuck.add(k)
            return False
        self.levels[k] = min(beyond, key=lambda level: abs(level - self.levels[k]))
        return True
