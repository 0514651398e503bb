"""Quantities of machines. They are missing (NaN) where the machine is out of service."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import UnitKey
from gridfold.grid.network_state import NetworkState
from gridfold.runs.monitor.view import Reader, View, power_names


@dataclass(frozen=True)
class Signals:
    """A signal of units: ``field_voltage:101:1``; rotor angles in degrees."""

    prefix: str
    units: tuple[UnitKey, ...]
    slots: NDArray[np.int64]
    factor: float = 1.0

    @property
    def names(self) -> tuple[str, ...]:
        """``PREFIX:BUS:ID``."""
        return tuple(f"{self.prefix}:{unit}" for unit in self.units)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """The bus of each unit."""
        return tuple((unit.bus,) for unit in self.units)

    def reader(self) -> Reader:
        """Their values."""
        return self._values

    def _values(self, view: View) -> NDArray[np.float64]:
        values = view.signals(self.slots) * self.factor
        return _without(values, self.units, view.state)


@dataclass(frozen=True)
class RelativeAngles:
    """Rotor angles in degrees against the centre of inertia of the island: ``angle_coi_deg:101:1``."""

    units: tuple[UnitKey, ...]
    slots: NDArray[np.int64]
    columns: NDArray[np.int64]

    @property
    def names(self) -> tuple[str, ...]:
        """``angle_coi_deg:BUS:ID``."""
        return tuple(f"angle_coi_deg:{unit}" for unit in self.units)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """The bus of each machine."""
        return tuple((unit.bus,) for unit in self.units)

    def reader(self) -> Reader:
        """Their values."""
        return self._values

    def _values(self, view: View) -> NDArray[np.float64]:
        angles = view.signals(self.slots) - view.references[:, self.columns]
        return _without(np.rad2deg(angles), self.units, view.state)


@dataclass(frozen=True)
class Generation:
    """Power of units on the system base: ``generation_mw:101:1`` and ``generation_mvar:101:1``."""

    units: tuple[UnitKey, ...]
    columns: NDArray[np.int64]
    base_mva: float

    @property
    def names(self) -> tuple[str, ...]:
        """Active powers, then reactive ones."""
        return power_names("generation_mw", "generation_mvar", map(str, self.units))

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """The bus of each unit."""
        return 2 * tuple((unit.bus,) for unit in self.units)

    def reader(self) -> Reader:
        """Their values."""
        return self._values

    def _values(self, view: View) -> NDArray[np.float64]:
        power = view.generation[:, self.columns] * self.base_mva
        values = np.hstack([power.real, power.imag])
        return _without(values, 2 * self.units, view.state)


def _without(
    values: NDArray[np.float64], units: tuple[UnitKey, ...], state: NetworkState
) -> NDArray[np.float64]:
    """Values (n, n_units) without those of units that are out."""
    if state.units_out:
        values[:, [k for k, unit in enumerate(units) if unit in state.units_out]] = np.nan
    return values
