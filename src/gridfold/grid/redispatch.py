"""Generation that is moved before a run begins: an event, and what it makes of a case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gridfold.errors import EventError, OptionError
from gridfold.grid.case import Case, Control, Generator, UnitKey
from gridfold.grid.change import Change
from gridfold.grid.event_checks import added, check_finite, chosen_buses, place_text
from gridfold.grid.network_state import NetworkState
from gridfold.grid.selection import select_machines

#: Power in MW below zero that rounding may leave.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Redispatch:
    """Units give more or less power, and the run starts at the equilibrium of that.

    The units in service with positive power share it in proportion to their power. Those at slack buses
    take no part: they balance what is left over, losses included. Two of these events move power from
    one area to another.

    Parameters
    ----------
    active_mw : float
        What they give more, in MW; negative: less.
    buses, areas, zones : str
        Where the units are, such as ``1-36,78``; all that one of them names.
    units : str
        Or which units they are, such as ``101:1,102:1``.
    """

    active_mw: float
    buses: str = ""
    areas: str = ""
    zones: str = ""
    units: str = ""

    def changes(self, case: Case) -> list[Change]:
        """The dispatch changes at the start."""
        units = self._chosen(case)
        total = sum(g.active_mw for g in units)
        steps = {g.key: self.active_mw * g.active_mw / total for g in units}

        def apply(state: NetworkState) -> NetworkState:
            dispatch = added(state.dispatch, steps)
            _require_positive(self._where, units, dict(dispatch))
            return replace(state, dispatch=dispatch)

        count = "1 unit" if len(units) == 1 else f"{len(units)} units"
        return [Change(0.0, f"{self._where}: {self.active_mw:+g} MW by {count}", apply)]

    def dispatched(self, case: Case) -> Case:
        """The case after the change."""
        state = NetworkState()
        for change in self.changes(case):
            state = change.apply(state)
        return redispatched(case, dict(state.dispatch))

    @property
    def _where(self) -> str:
        if self.units:
            return f"redispatch of {self.units}"
        return f"redispatch in {place_text(self.buses, self.areas, self.zones)}"

    def _chosen(self, case: Case) -> list[Generator]:
        """The units that share the power."""
        check_finite(self._where, active_mw=self.active_mw)
        slack = {g.bus for g in case.generators if g.control is Control.SLACK}
        chosen = self._named(case)
        units = [g for g in case.generators if g.in_service and g.key in chosen]
        if self.units and (at_slack := [str(g.key) for g in units if g.bus in slack]):
            listed = ", ".join(at_slack)
            raise EventError(f"{self._where}: {listed} at a slack bus balances what is left over")
        units = [g for g in units if g.active_mw > 0 and g.bus not in slack]
        if not units:
            raise EventError(
                f"{self._where}: no unit in service with positive power, slack buses aside"
            )
        return units

    def _named(self, case: Case) -> frozenset[UnitKey]:
        if not self.units:
            buses = chosen_buses(self._where, case, self.buses, self.areas, self.zones)
            return frozenset(g.key for g in case.generators if g.bus in buses)
        if self.buses or self.areas or self.zones:
            raise EventError(f"{self._where}: give units or where they are, not both")
        try:
            return frozenset(select_machines(str(self.units), case, "units"))
        except OptionError as error:
            raise EventError(f"{self._where}: {error}") from None


def _require_positive(
    where: str, units: list[Generator], dispatch: Mapping[UnitKey, float]
) -> None:
    for unit in units:
        power = unit.active_mw + dispatch.get(unit.key, 0.0)
        if power < -_ROUNDING:
            raise EventError(f"{where}: {unit} would give {power:.4g} MW, less than nothing")


def redispatched(case: Case, dispatch: Mapping[UnitKey, float]) -> Case:
    """The case with the units' powers changed by so many MW."""
    generators = tuple(
        replace(g, active_mw=g.active_mw + dispatch[g.key]) if g.key in dispatch else g
        for g in case.generators
    )
    return replace(case, generators=generators)
