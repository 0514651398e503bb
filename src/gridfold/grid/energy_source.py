"""What drives a generating unit."""

from __future__ import annotations

from enum import Enum


class EnergySource(Enum):
    """What drives a unit: a turbine, or through a converter wind and sun."""

    UNKNOWN = "unknown"
    STEAM = "steam"
    GAS = "gas"
    HYDRO = "hydro"
    WIND = "wind"
    SOLAR = "solar"
