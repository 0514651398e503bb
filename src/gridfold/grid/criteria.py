"""What a run has to fulfil beside synchronism: criteria on angles, voltages, frequency and damping.

Each is a record that is checked when it is made. :func:`gridfold.judge` holds a run against them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gridfold.errors import OptionError
from gridfold.grid.selection_text import parse_selection


@dataclass(frozen=True)
class AngleSeparation:
    """No two rotor angles of an island are further apart than `limit_deg`, at any time of the run.

    `machines` chooses those that count, by default all.
    """

    limit_deg: float
    machines: str = ""
    name: str = ""

    def __post_init__(self) -> None:
        _require(self, positive=("limit_deg",))
        _require_selection(self.machines)

    def __str__(self) -> str:
        text = f"angles within {self.limit_deg:g} degrees of each other"
        return self.name or text + _at(self.machines)


@dataclass(frozen=True)
class VoltageDip:
    """After the fault no voltage stays below `level` for longer than `longest` seconds at a stretch.

    With 0, the default, no voltage is below it at all. The level is in p.u., or with `of_initial` a
    part of the voltage at the start. `buses` chooses those that count, by default the study area,
    or all where there is none.
    """

    level: float
    longest: float = 0.0
    buses: str = ""
    of_initial: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        _require(self, positive=("level",), not_negative=("longest",))
        _require_level(self.level)
        _require_selection(self.buses)

    def __str__(self) -> str:
        level = _level(self.level, self.of_initial)
        spell = (
            f"below {level} for more than {self.longest:g} s" if self.longest else f"below {level}"
        )
        return self.name or f"voltage never {spell} after the fault" + _at(self.buses)


@dataclass(frozen=True)
class VoltageRecovery:
    """From `within` seconds after the fault on no voltage is below `level`.

    The level is in p.u., or with `of_initial` a part of the voltage at the start. A voltage that is
    back in time and falls below once more fails. `buses` chooses those that count, by default the
    study area, or all where there is none.
    """

    level: float
    within: float
    buses: str = ""
    of_initial: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        _require(self, positive=("level", "within"))
        _require_level(self.level)
        _require_selection(self.buses)

    def __str__(self) -> str:
        text = f"voltage back to {_level(self.level, self.of_initial)} within {self.within:g} s"
        return self.name or text + _at(self.buses)


@dataclass(frozen=True)
class FrequencyBand:
    """No island's frequency leaves the band for longer than `longest` seconds at a stretch.

    The frequency is that of the centre of inertia. `lowest_hz` or `highest_hz` alone bounds one side.
    With `longest` 0, the default, the band is never left.
    """

    lowest_hz: float | None = None
    highest_hz: float | None = None
    longest: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        if self.lowest_hz is None and self.highest_hz is None:
            raise OptionError("lowest_hz or highest_hz is needed")
        given = [name for name in ("lowest_hz", "highest_hz") if getattr(self, name) is not None]
        _require(self, positive=given, not_negative=("longest",))
        if (self.lowest_hz or 0.0) >= (self.highest_hz or math.inf):
            raise OptionError(
                f"lowest_hz, {self.lowest_hz:g}, must be below highest_hz, {self.highest_hz:g}"
            )

    def __str__(self) -> str:
        if self.highest_hz is None:
            text = f"frequency from {self.lowest_hz:g} Hz"
        elif self.lowest_hz is None:
            text = f"frequency up to {self.highest_hz:g} Hz"
        else:
            text = f"frequency from {self.lowest_hz:g} to {self.highest_hz:g} Hz"
        spell = f", outside for at most {self.longest:g} s" if self.longest else ""
        return self.name or text + spell


@dataclass(frozen=True)
class LeastDamping:
    """The dominant swing after the last event has a damping ratio of at least `percent` %.

    It is the swing of the machine that moves furthest, the column `damping_ratio` of a study. A run in
    which nothing swings fulfils it.
    """

    percent: float
    name: str = ""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.percent) and 0 <= self.percent < 100):
            raise OptionError(f"percent must lie from 0 to 100, not {self.percent!r}")

    def __str__(self) -> str:
        return self.name or f"damping at least {self.percent:g} %"


Criterion = AngleSeparation | VoltageDip | VoltageRecovery | FrequencyBand | LeastDamping

#: Criteria by the kind that files name.
CRITERIA: dict[str, type[Criterion]] = {
    "angle-separation": AngleSeparation,
    "voltage-dip": VoltageDip,
    "voltage-recovery": VoltageRecovery,
    "frequency-band": FrequencyBand,
    "damping": LeastDamping,
}


#: Voltage above which a level is no voltage in p.u., such as one in percent or in kV.
_HIGHEST_LEVEL = 2.0


def _require(
    criterion: Criterion, positive: Iterable[str] = (), not_negative: Iterable[str] = ()
) -> None:
    """Raise unless these fields are numbers of their kind."""
    for name in positive:
        value = getattr(criterion, name)
        if not (math.isfinite(value) and value > 0):
            raise OptionError(f"{name} must be a positive number, not {value!r}")
    for name in not_negative:
        value = getattr(criterion, name)
        if not (math.isfinite(value) and value >= 0):
            raise OptionError(f"{name} must be a number of seconds from 0 on, not {value!r}")


def _require_level(level: float) -> None:
    if level > _HIGHEST_LEVEL:
        raise OptionError(f"level is a part of 1, such as 0.9, not {level:g}")


def _require_selection(text: str) -> None:
    if text:
        parse_selection(text, "the choice")


def _level(level: float, of_initial: bool) -> str:
    return f"{100 * level:g} % of the initial" if of_initial else f"{level:g}"


def _at(selection: str) -> str:
    return f" ({selection})" if selection else ""


_PRESETS: tuple[Criterion, ...] = (
    VoltageRecovery(0.9, 1.0),
    VoltageRecovery(0.8, 0.5),
    VoltageDip(0.7),
    VoltageDip(0.8, 0.5),
    FrequencyBand(59.0, 61.0),
    FrequencyBand(49.0, 51.0),
    LeastDamping(3.0),
    LeastDamping(5.0),
    AngleSeparation(120.0),
)
#: Criteria by a name that says what each of them is; none is that of a standard.
PRESETS: dict[str, Criterion] = {str(criterion): criterion for criterion in _PRESETS}
