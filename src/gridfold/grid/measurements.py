"""What relays measure, as plain data: a level at a bus, or the impedance seen at an end of a branch."""

from __future__ import annotations

from dataclasses import dataclass

from gridfold.grid.case import UnitKey


@dataclass(frozen=True)
class Level:
    """Something at `bus` is `below` or `above` a threshold; blocked once `unit` is out."""

    bus: int
    below: float | None = None
    above: float | None = None
    unit: UnitKey | None = None


class Voltage(Level):
    """The voltage magnitude in p.u."""


class Frequency(Level):
    """The frequency of the voltage in Hz."""


@dataclass(frozen=True)
class Mho:
    """The impedance seen at `end` (0 or 1) of a branch is in the circle of `reach` times its own."""

    branch: int
    end: int
    reach: float


@dataclass(frozen=True)
class Blinders:
    """The impedance seen at `end` (0 or 1) of a branch is between blinders, in parts of its own.

    Within `inner` or `outer` across the branch, and not more than `reach` beyond its ends along it.
    """

    branch: int
    end: int
    outer: float
    inner: float
    reach: float


Measurement = Voltage | Frequency | Mho | Blinders
