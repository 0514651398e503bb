"""Extreme values of a run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Extreme:
    """An extreme value, where (bus number) and when (s)."""

    value: float
    bus: int
    at_seconds: float


@dataclass(frozen=True)
class VoltageRange:
    """Lowest and highest voltage of energized buses after the last event; None where there is none."""

    lowest: Extreme | None
    highest: Extreme | None
