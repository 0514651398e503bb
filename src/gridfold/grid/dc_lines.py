"""Direct-current lines with two ends, as planners' files give them.

Voltages and currents of the dc side are in kV and kA or A, resistances and reactances in ohm: nothing
of them is per unit but taps and the voltages of buses.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class LineControl(Enum):
    """What a line with thyristors holds."""

    BLOCKED = "blocked"
    POWER = "power"
    CURRENT = "current"


@dataclass(frozen=True)
class ThyristorEnd:
    """Rectifier or inverter of a dc line: bridges in series behind a transformer each.

    Parameters
    ----------
    bus : int
        Bus number.
    bridges : int
        Bridges in series.
    angle_max_deg, angle_min_deg : float
        Limits of the firing angle of a rectifier, of the extinction angle of an inverter.
    resistance_ohm, reactance_ohm : float
        Commutating resistance and reactance of a bridge.
    base_kv : float
        Base voltage at the bus.
    transformer_ratio, tap : float
        The voltage behind the transformer is the bus's times `transformer_ratio` / `tap`.
    """

    bus: int
    bridges: int = 1
    angle_max_deg: float = 90.0
    angle_min_deg: float = 0.0
    resistance_ohm: float = 0.0
    reactance_ohm: float = 0.0
    base_kv: float = 1.0
    transformer_ratio: float = 1.0
    tap: float = 1.0


@dataclass(frozen=True)
class ThyristorLine:
    """A two-terminal dc line with line-commutated converters.

    Parameters
    ----------
    name : str
        Its name.
    control : LineControl
        What is held.
    setting : float
        Power in MW, at the rectifier if it is positive, at the inverter if it is negative; or current
        in A.
    resistance_ohm : float
        Of the line.
    voltage_kv : float
        Voltage held at the inverter, `compounding_ohm` along the line towards the rectifier.
    compounding_ohm : float
        See `voltage_kv`.
    switch_kv : float
        Voltage of the inverter below which a line that holds power holds the current of that power at
        `voltage_kv`.
    margin : float
        Part of the current by which that of the inverter is less where it takes over the control.
    rectifier, inverter : ThyristorEnd
        Its ends.
    """

    name: str
    control: LineControl
    setting: float
    resistance_ohm: float
    voltage_kv: float
    rectifier: ThyristorEnd
    inverter: ThyristorEnd
    compounding_ohm: float = 0.0
    switch_kv: float = 0.0
    margin: float = 0.0

    @property
    def buses(self) -> tuple[int, int]:
        """Bus numbers of the ends."""
        return self.rectifier.bus, self.inverter.bus

    @property
    def in_service(self) -> bool:
        """Whether it is not blocked."""
        return self.control is not LineControl.BLOCKED

    @property
    def holds_current(self) -> bool:
        """Whether it holds current rather than power."""
        return self.control is LineControl.CURRENT

    @property
    def voltage_buses(self) -> tuple[int, ...]:
        """Buses whose voltage it holds: none."""
        return ()

    def __str__(self) -> str:
        return f'dc line "{self.name}"'


class DcControl(Enum):
    """What a transistor converter holds on its dc side."""

    OUT = "out"
    VOLTAGE = "voltage"
    POWER = "power"


@dataclass(frozen=True)
class TransistorEnd:
    """A voltage-source converter.

    Parameters
    ----------
    bus : int
        Bus number.
    control : DcControl
        What it holds on the dc side.
    setting : float
        Dc voltage in kV, or power into the ac network in MW.
    holds_voltage : bool
        Whether it holds the stored voltage of its bus; else it holds its power factor.
    power_factor : float
        Power factor; where it is negative, reactive power has the other sign than active power.
    voltage_pu, regulated_bus : float, int
        Set point of the voltage, and the bus where it is meant, 0 for the own one; the stored operating
        point goes before them.
    loss_kw, loss_kw_per_a, least_loss_kw : float
        Losses: constant, by dc current, and the least.
    reactive_max_mvar, reactive_min_mvar : float
        Limits of the reactive power into the ac network.
    """

    bus: int
    control: DcControl
    setting: float = 0.0
    holds_voltage: bool = False
    power_factor: float = 1.0
    voltage_pu: float = 1.0
    regulated_bus: int = 0
    loss_kw: float = 0.0
    loss_kw_per_a: float = 0.0
    least_loss_kw: float = 0.0
    reactive_max_mvar: float = 9999.0
    reactive_min_mvar: float = -9999.0


@dataclass(frozen=True)
class TransistorLine:
    """A two-terminal dc line with voltage-source converters.

    Parameters
    ----------
    name : str
        Its name.
    in_service : bool
        Whether it is in service.
    resistance_ohm : float
        Of the line.
    first, second : TransistorEnd
        Its ends; one of them holds the dc voltage.
    """

    name: str
    in_service: bool
    resistance_ohm: float
    first: TransistorEnd
    second: TransistorEnd

    @property
    def buses(self) -> tuple[int, int]:
        """Bus numbers of the ends."""
        return self.first.bus, self.second.bus

    @property
    def holds_current(self) -> bool:
        """Whether it holds current rather than power: never."""
        return False

    @property
    def voltage_buses(self) -> tuple[int, ...]:
        """Buses whose voltage it holds."""
        live = (self.first, self.second) if self.in_service else ()
        return tuple(
            end.bus for end in live if end.holds_voltage and end.control is not DcControl.OUT
        )

    def __str__(self) -> str:
        return f'VSC dc line "{self.name}"'


DcLine = ThyristorLine | TransistorLine
