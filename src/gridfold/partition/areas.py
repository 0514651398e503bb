"""Divide a grid into the study area, which is simulated in full, and the external area.

Osipov & Sun, section II.A. Any set of buses can be the study area; it need not be coherent.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card
from gridfold.dynamics.area_model import nonlinear_functions
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.selection import select_buses
from gridfold.grid.selection_text import Word


@dataclass(frozen=True)
class TieLine:
    """A branch between the areas: its position in the case, its ends by area (bus numbers)."""

    branch: int
    study_bus: int
    external_bus: int


@dataclass(frozen=True, repr=False)
class Partition(Card):
    """A detailed model divided into two areas.

    Parameters
    ----------
    model : DetailedModel
        The whole system, with its network as the case describes it.
    study_buses : frozenset of int
        Bus numbers of the study area; all others are external.
    tie_lines : tuple of TieLine
        Branches in service between the areas.
    study_units, external_units : tuple of UnitKey
        Machines of each area, in order of the case's generators.
    """

    model: DetailedModel
    study_buses: frozenset[int]
    tie_lines: tuple[TieLine, ...]
    study_units: tuple[UnitKey, ...]
    external_units: tuple[UnitKey, ...]

    def _facts(self) -> dict[str, object]:
        outside = len(self.model.case.buses) - len(self.study_buses)
        return {
            "case": self.model.case.name,
            "study area": f"{len(self.study_buses)} buses, {len(self.study_units)} machines",
            "external area": f"{outside} buses, {len(self.external_units)} machines",
            "tie lines": len(self.tie_lines),
        }

    @property
    def boundary_buses(self) -> tuple[int, ...]:
        """Study-area buses with a tie line: their voltages are the external area's inputs."""
        return tuple(dict.fromkeys(tie.study_bus for tie in self.tie_lines))

    @property
    def boundary_of_both(self) -> tuple[int, ...]:
        """Buses of both areas with a tie line, those of the study area first."""
        outside = dict.fromkeys(tie.external_bus for tie in self.tie_lines)
        return (*self.boundary_buses, *outside)

    @cached_property
    def nonlinear_functions(self) -> NDArray[np.bool_]:
        """Whether the function of each state is nonlinear, shape (n_states,), in any network state."""
        return nonlinear_functions(self.model)

    def states_of(self, units: Collection[UnitKey]) -> list[int]:
        """Positions in the state vector of all states of `units`, in order of the vector."""
        wanted = set(units)
        return sorted(
            int(index)
            for block in self.model.layout.blocks
            for unit, column in zip(block.units, block.state_index.T, strict=True)
            if unit in wanted
            for index in column
        )


def study_buses(
    case: Case,
    buses: Collection[int] = (),
    areas: Collection[int] = (),
    zones: Collection[int] = (),
) -> frozenset[int]:
    """Bus numbers of a study area given by buses, areas and zones (their union).

    Raises
    ------
    OptionError
        One of them is not in the case, or nothing is given.
    """
    known_areas = {bus.area for bus in case.buses}
    known_zones = {bus.zone for bus in case.buses}
    for kind, given, known in (
        ("bus", buses, set(case.bus_index)),
        ("area", areas, known_areas),
        ("zone", zones, known_zones),
    ):
        missing = sorted(set(given) - known)
        if missing:
            raise OptionError(f"study area: there is no {kind} {missing[0]} in case {case.name}")
    chosen = frozenset(buses) | {
        bus.number for bus in case.buses if bus.area in set(areas) or bus.zone in set(zones)
    }
    if not chosen:
        raise OptionError("the study area is empty; give it by buses, areas or zones")
    return chosen


def chosen_study_buses(
    case: Case, where: str, buses: str | None, areas: str | None, zones: str | None
) -> frozenset[int] | None:
    """Bus numbers of a study area that texts choose, their union; None where there is no text.

    The texts are selections (:mod:`gridfold.grid.selection_text`), of which numbers are first those of
    buses, areas or zones; messages call them by `where` and that word.
    """
    asked = ((buses, "buses", Word.BUS), (areas, "areas", Word.AREA), (zones, "zones", Word.ZONE))
    found = [
        select_buses(text, case, f"{where}{name}", word=word)
        for text, name, word in asked
        if text is not None
    ]
    return study_buses(case, {number for part in found for number in part}) if found else None


def partition(model: DetailedModel, study: Collection[int]) -> Partition:
    """Divide `model` into the area of the `study` buses and the rest.

    Raises
    ------
    OptionError
        A bus is not in the case, an area has no machine with states, or no tie line joins them.
    """
    case = model.case
    inside = study_buses(case, study)
    ties = []
    for position, branch in enumerate(case.branches):
        ends = (branch.from_bus in inside, branch.to_bus in inside)
        if position in model.state.branches_out or ends[0] == ends[1]:
            continue
        near, far = branch.from_bus, branch.to_bus
        ties.append(TieLine(position, *((near, far) if ends[0] else (far, near))))
    study_units = tuple(unit for unit in model.units if unit.bus in inside)
    external_units = tuple(unit for unit in model.units if unit.bus not in inside)
    if not study_units or not external_units:
        which = "study" if not study_units else "external"
        raise OptionError(f"the {which} area has no machine")
    if not ties:
        raise OptionError("no tie line joins the study area to the rest of the system")
    return Partition(model, inside, tuple(ties), study_units, external_units)
