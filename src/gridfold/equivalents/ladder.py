"""A ladder of models: detailed, machines near the boundary retained, linear, linear throughout.

The adaptive algorithm climbs and descends it. What a step of each rung takes is measured once, and a
rung that is not cheaper than the one above it is not used.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card, first_few
from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.equilibrium import Equilibrium
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.families import Mode, SmallModel
from gridfold.equivalents.fit import Fit
from gridfold.equivalents.folded import FoldedArea
from gridfold.grid.case import UnitKey
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition
from gridfold.runs.method import fit_stepper
from gridfold.simulation.run import run_segments
from gridfold.simulation.segment import Segment
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.protocol import System

#: Steps by which a rung's cost is measured, and how often; the fastest counts.
_STEPS, _TIMES = 200, 5


@dataclass(frozen=True, eq=False, repr=False)
class Ladder(Card):
    """Models of one partitioned system, the most exact first.

    Parameters
    ----------
    areas : tuple of FoldedArea
        The external area with machines near the boundary exact, and with none of them; or one of
        the two.
    whole : bool
        Whether there is a rung on which everything is linear.
    step_seconds : mapping
        What a step of each rung took on the machine that measured it, in seconds; empty takes every
        rung for cheaper than the one above it.
    light_limits : mapping
        Rungs on which limits of linear machines are passed over, and the error in degrees that this
        makes in sample swings; :func:`gridfold.equivalents.limit_weight.light_limits`.
    place : Place, optional
        Another operating point; each area moves there when a rung first needs it.
    fit : Fit, optional
        How it was chosen for a tolerance; :func:`gridfold.fit_ladder`.
    fine : FoldedArea, optional
        An area that is finer than those of the rungs, in which errors travel, if it is there.
    """

    areas: tuple[FoldedArea, ...]
    whole: bool = False
    step_seconds: Mapping[Mode, float] = field(default_factory=dict)
    light_limits: Mapping[Mode, float] = field(default_factory=dict)
    place: Place | None = None
    fit: Fit | None = None
    fine: FoldedArea | None = field(default=None, repr=False)

    def _facts(self) -> dict[str, object]:
        last = self.areas[-1]
        return {
            "case": self.parts.model.case.name,
            "rungs": first_few(rung.value for rung in self.rungs),
            "states": f"{len(last.area.state_index)} reduced to {last.bases.order}",
            "retained": first_few(self.retained),
            "ports": first_few(last.ports.buses),
        }

    @property
    def rungs(self) -> tuple[Mode, ...]:
        """All rungs below the detailed model."""
        return (*(area.mode for area in self.areas), *((Mode.WHOLE,) if self.whole else ()))

    @property
    def modes(self) -> tuple[Mode, ...]:
        """For each band of deviations the cheapest rung that is exact enough for it.

        At another operating point nothing is linear throughout: to make that takes longer than its
        steps save.
        """
        best, found = Mode.DETAILED, []
        for rung in self.rungs:
            made = self.place is None or rung is not Mode.WHOLE
            cost = self.step_seconds
            if made and (not cost or cost[rung] < cost[best]):
                best = rung
            found.append(best)
        return tuple(found)

    @property
    def parts(self) -> Partition:
        """Study and external area."""
        return self.areas[0].parts

    @property
    def retained(self) -> tuple[UnitKey, ...]:
        """External machines that stay exact on the highest rung."""
        return self.areas[0].retained

    @property
    def reference_unit(self) -> UnitKey | None:
        """The electrically furthest machine."""
        return self.areas[0].reference_unit

    @property
    def study_units(self) -> tuple[UnitKey, ...]:
        """Machines of the study area."""
        return self.areas[0].study_units

    @property
    def origin(self) -> NDArray[np.float64]:
        """State of the whole system at the operating point."""
        return self.areas[0].origin if self.place is None else self.place.point.x

    def how(self, mode: Mode) -> str:
        """How the area of a rung came about."""
        return self.area_of(mode).how(mode)

    def held_at_limits(self, mode: Mode) -> tuple[str, ...]:
        """Limits of the units that are linear in `mode` that act at the operating point."""
        return self.area_of(mode).held_at_limits(mode)

    def build(self, mode: Mode, model: DetailedModel) -> SmallModel:
        """The rung `mode` on the network of `model`."""
        return self.area_of(mode).build(mode, model)

    def moved(self, model: DetailedModel, point: Equilibrium) -> Ladder:
        """About another operating point; what steps cost is known."""
        return replace(self, place=Place(model, point))

    def measured(self, stepper: Stepper | None = None) -> Ladder:
        """The same with what a step of each rung takes on this machine.

        By default with the stepper that :func:`gridfold.simulate` takes.
        """
        model = self.parts.model
        rule = fit_stepper(model, stepper).stepper
        models: dict[Mode, tuple[System, NDArray[np.float64]]] = {Mode.DETAILED: (model, model.x0)}
        for rung in self.rungs:
            small = self.build(rung, model)
            models[rung] = small.system, small.coordinates.restrict(model.x0)
        spent = dict.fromkeys(models, np.inf)
        for _ in range(_TIMES):  # in turn, so that a busy moment is not taken for a slow rung
            for rung, (system, start) in models.items():
                spent[rung] = min(spent[rung], step_seconds(system, start, rule))
        return replace(self, step_seconds=spent)

    def area_of(self, mode: Mode) -> FoldedArea:
        """The folded area of a rung; throughout linear is the one with the fewest states."""
        area = next((area for area in self.areas if area.mode is mode), self.areas[-1])
        return area if self.place is None else self.place.moved(area)


class Place:
    """An operating point other than that of the intact network, and the areas that have moved there."""

    def __init__(self, model: DetailedModel, point: Equilibrium) -> None:
        self.model, self.point = model, point
        self._areas: dict[int, FoldedArea] = {}

    def moved(self, area: FoldedArea) -> FoldedArea:
        """The area about this point."""
        if id(area) not in self._areas:
            self._areas[id(area)] = area.moved(self.model, self.point, self._grid)
        return self._areas[id(area)]

    @cached_property
    def _grid(self) -> DescriptorSystem:
        return grid_descriptor(self.model, self.point.x)


def step_seconds(system: System, start: NDArray[np.float64], stepper: Stepper) -> float:
    """CPU seconds of this thread that one step of a run with `system` takes."""
    began = clock.thread_time()
    run_segments([Segment(system, _STEPS * stepper.step)], start, stepper)
    return (clock.thread_time() - began) / _STEPS
