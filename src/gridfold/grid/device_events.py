"""The event that sets a parameter or a reference of a device."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gridfold.errors import EventError
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.change import Change
from gridfold.grid.event_checks import check_bus, check_finite, check_time
from gridfold.grid.network_state import NetworkState, Setting


@dataclass(frozen=True)
class SetParameter:
    """A parameter or reference of a device takes another value at `time` (s).

    Parameters
    ----------
    bus : int
        Bus of the unit.
    parameter : str
        Name of a parameter as in the tables of devices, or of a reference: ``voltage_reference``,
        ``power_reference``, or ``speed_reference``, which is 1 for synchronous speed and moves the
        power reference by as much as holds the same power at the other speed.
    value, change : float
        The new value, or by how much it changes: one of them. Parameters are on the base that they have
        in files, references in the per unit of the device's equations.
    id : str
        Id of the unit.
    model : str
        Model of the device, such as ``sexs``, where several of the unit have the parameter.
    time : float
        In seconds.
    """

    bus: int
    parameter: str
    value: float | None = None
    change: float | None = None
    id: str = "1"
    model: str = ""
    time: float = 0.0

    def changes(self, case: Case) -> list[Change]:
        """The parameter changes; whether the device has it is told when its model is made."""
        key = UnitKey(self.bus, str(self.id))
        where = f"{self.parameter} of unit {key}"
        check_time(where, "time", self.time)
        check_bus(where, case, self.bus)
        self._check_sizes(where)
        if not any(g.key == key and g.in_service for g in case.generators):
            known = ", ".join(str(g.key) for g in case.generators if g.bus == self.bus) or "none"
            raise EventError(f"{where}: no such unit in service (at bus {self.bus}: {known})")
        models = [record.model for record in case.devices if record.key == key]
        if self.model and self.model not in models:
            known = ", ".join(models) or "none"
            raise EventError(f"{where}: the unit has no device {self.model!r}; it has: {known}")

        def apply(state: NetworkState) -> NetworkState:
            if key in state.units_out:
                raise EventError(f"{where}: the unit is out of service at {self.time:g} s")
            name = (key, self.model, self.parameter)
            found = {(s.unit, s.model, s.name): s for s in state.settings}
            old = found.get(name, Setting(*name, None, 0.0))
            if self.value is not None:
                found[name] = old._replace(value=self.value, change=0.0)
            else:
                found[name] = old._replace(change=old.change + (self.change or 0.0))
            return replace(state, settings=tuple(found[k] for k in sorted(found)))

        how = f"set to {self.value:g}" if self.value is not None else f"changed by {self.change:+g}"
        return [Change(self.time, f"{where} {how}", apply, (self.bus,))]

    def _check_sizes(self, where: str) -> None:
        sizes = {"value": self.value, "change": self.change}
        given = {name: size for name, size in sizes.items() if size is not None}
        if len(given) != 1:
            raise EventError(f"{where}: give value or change, one of the two")
        check_finite(where, **given)
        if not self.parameter:
            raise EventError(f"{where}: parameter is empty")
        if self.change == 0:
            raise EventError(f"{where}: change is 0, which changes nothing")
