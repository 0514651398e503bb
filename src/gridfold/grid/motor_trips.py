"""The trip of motors at low voltage, as the records of their data ask for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from gridfold.grid.case import Case, UnitKey
from gridfold.grid.measurements import Voltage
from gridfold.grid.network_state import NetworkState
from gridfold.grid.relay import Element, Relay


@dataclass(frozen=True)
class MotorTrips(Relay):
    """Motors whose records say so are disconnected where their voltage stays low.

    Their data are `trip_voltage` (p.u.), `trip_cycles` and `breaker_cycles`; the delay is both of these
    together. These relays belong to the case: they act in every run of it.
    """

    def elements(self, case: Case) -> list[Element]:
        """One for each motor with a trip."""
        return list(_elements(case))


def _elements(case: Case) -> Iterator[Element]:
    for record in case.motors_with_trips:
        key, level = record.key, record.parameters["trip_voltage"]
        cycles = record.parameters["trip_cycles"] + record.parameters.get("breaker_cycles", 0.0)
        delay = cycles / case.frequency_hz

        def act(state: NetworkState, key: UnitKey = key) -> NetworkState:
            return replace(state, units_out=state.units_out | {key})

        label = f"motor {key} tripped, below {level:g} p.u. for {delay:.3g} s"
        yield Element(label, Voltage(key.bus, below=level, unit=key), delay, act, (key.bus,))
