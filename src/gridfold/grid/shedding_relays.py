"""Relays that shed load in stages, at low frequency or voltage."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.event_checks import check_bus, check_time, chosen_buses, place_text
from gridfold.grid.load_events import shed_load
from gridfold.grid.measurements import Frequency, Measurement, Voltage
from gridfold.grid.network_state import NetworkState
from gridfold.grid.relay import Element, Relay


@dataclass(frozen=True)
class SheddingStage:
    """A stage of load shedding: the threshold (Hz, or p.u.), its delay (s), the share of load shed."""

    pickup: float
    delay: float
    share: float


@dataclass(frozen=True)
class _Shedding(Relay):
    stages: tuple[SheddingStage, ...]
    buses: str = ""
    areas: str = ""
    zones: str = ""
    measured_at: int | None = None

    def _measurement(self, bus: int, pickup: float) -> Measurement:
        raise NotImplementedError

    def _elements(self, case: Case, name: str, unit: str) -> Iterator[Element]:
        where = f"{name} at {place_text(self.buses, self.areas, self.zones)}"
        wanted = chosen_buses(where, case, self.buses, self.areas, self.zones)
        there = sorted({load.bus for load in case.loads if load.in_service} & wanted)
        if not there:
            raise EventError(f"{where}: there is no load in service")
        if not self.stages:
            raise EventError(f"{where}: it has no stages")
        if math.fsum(stage.share for stage in self.stages) > 1 + 1e-9:
            raise EventError(f"{where}: the stages shed more than all load")
        if self.measured_at is not None:
            check_bus(where, case, self.measured_at)
        groups = [(bus,) for bus in there] if self.measured_at is None else [tuple(there)]
        for number, stage in enumerate(self.stages, start=1):
            at = f"{where}, stage {number}"
            check_time(at, "delay", stage.delay)
            if not (math.isfinite(stage.pickup) and stage.pickup > 0):
                raise EventError(f"{at}: pickup must be a positive number, not {stage.pickup!r}")
            if not 0 < stage.share <= 1:
                raise EventError(
                    f"{at}: share must be more than 0 and at most 1, not {stage.share!r}"
                )
            for group in groups:
                yield Element(
                    f"{name} stage {number} ({stage.pickup:g} {unit}): {100 * stage.share:g} % of the "
                    f"load at {_listed(group)} shed",
                    self._measurement(self.measured_at or group[0], stage.pickup),
                    stage.delay,
                    _shedding(group, stage.share),
                    group,
                )


@dataclass(frozen=True)
class UnderFrequencyShedding(_Shedding):
    """Load shedding at low frequency, in stages.

    Parameters
    ----------
    stages : tuple of SheddingStage
        Frequency in Hz below which a stage is picked up, delay in s, share of the load at the start.
    buses, areas, zones : str
        Where load is shed, such as ``1-36,78``; all that one of them names.
    measured_at : int, optional
        Bus whose frequency counts for all; by default each bus measures its own.
    """

    def elements(self, case: Case) -> list[Element]:
        """One for each stage and bus."""
        return list(self._elements(case, "under-frequency shedding", "Hz"))

    def _measurement(self, bus: int, pickup: float) -> Measurement:
        return Frequency(bus, below=pickup)


@dataclass(frozen=True)
class UnderVoltageShedding(_Shedding):
    """Load shedding at low voltage, in stages.

    Parameters
    ----------
    stages : tuple of SheddingStage
        Voltage in p.u. below which a stage is picked up, delay in s, share of the load at the start.
    buses, areas, zones : str
        Where load is shed, such as ``1-36,78``; all that one of them names.
    measured_at : int, optional
        Bus whose voltage counts for all; by default each bus measures its own.
    """

    def elements(self, case: Case) -> list[Element]:
        """One for each stage and bus."""
        return list(self._elements(case, "under-voltage shedding", "p.u."))

    def _measurement(self, bus: int, pickup: float) -> Measurement:
        return Voltage(bus, below=pickup)


def _listed(buses: Sequence[int]) -> str:
    shown = ", ".join(str(bus) for bus in buses[:8])
    more = f" and {len(buses) - 8} more" if len(buses) > 8 else ""
    return f"{'bus' if len(buses) == 1 else 'buses'} {shown}{more}"


def _shedding(buses: tuple[int, ...], share: float) -> Callable[[NetworkState], NetworkState]:
    return lambda state: shed_load(state, buses, share)
