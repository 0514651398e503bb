"""Quantities of buses. Angle and frequency are missing (NaN) where there is no voltage."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.runs.monitor.view import Reader, View, power_names

#: Time constant in s of the filter through which the frequency of a bus is seen.
FREQUENCY_FILTER = 0.04
#: Voltage in p.u. below which a bus has no angle.
_NO_VOLTAGE = 1e-9


@dataclass(frozen=True)
class Voltages:
    """Magnitudes of bus voltages in p.u.: ``voltage_pu:101``."""

    numbers: tuple[int, ...]
    columns: NDArray[np.int64]

    @property
    def names(self) -> tuple[str, ...]:
        """``voltage_pu:BUS``."""
        return tuple(f"voltage_pu:{bus}" for bus in self.numbers)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Each bus."""
        return tuple((bus,) for bus in self.numbers)

    def reader(self) -> Reader:
        """Their values."""
        return lambda view: np.abs(view.voltages[:, self.columns])


@dataclass(frozen=True)
class VoltageAngles:
    """Angles of bus voltages in degrees against a frame of nominal frequency, without jumps of 360."""

    numbers: tuple[int, ...]
    columns: NDArray[np.int64]

    @property
    def names(self) -> tuple[str, ...]:
        """``voltage_angle_deg:BUS``."""
        return tuple(f"voltage_angle_deg:{bus}" for bus in self.numbers)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Each bus."""
        return tuple((bus,) for bus in self.numbers)

    def reader(self) -> Reader:
        """Their values."""
        follower = _Unwrapped()
        return lambda view: np.rad2deg(follower.take(view.voltages[:, self.columns]))


@dataclass(frozen=True)
class Frequencies:
    r"""Frequencies of buses in Hz: ``frequency_hz:101``.

    The rate of the voltage's angle :math:`\theta` against a frame of nominal frequency :math:`f_0`,
    through a filter of first order,

    .. math:: f = f_0 + \frac{1}{2 \pi} \frac{s}{1 + s T} \theta, \quad T = 0.04\ \text{s}.

    :math:`\theta` runs straight between two rows. Its jump at an event is no frequency and is left out.
    A bus without voltage has none, and goes on from its last frequency when it comes back.
    """

    numbers: tuple[int, ...]
    columns: NDArray[np.int64]
    nominal_hz: float

    @property
    def names(self) -> tuple[str, ...]:
        """``frequency_hz:BUS``."""
        return tuple(f"frequency_hz:{bus}" for bus in self.numbers)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Each bus."""
        return tuple((bus,) for bus in self.numbers)

    def reader(self) -> Reader:
        """Their values."""
        return _FrequencyFilter(self.columns, self.nominal_hz).take


@dataclass(frozen=True)
class Loads:
    """What the loads of buses draw: ``load_mw:101`` and ``load_mvar:101``."""

    numbers: tuple[int, ...]
    columns: NDArray[np.int64]
    base_mva: float

    @property
    def names(self) -> tuple[str, ...]:
        """Active powers, then reactive ones."""
        return power_names("load_mw", "load_mvar", map(str, self.numbers))

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Each bus."""
        return 2 * tuple((bus,) for bus in self.numbers)

    def reader(self) -> Reader:
        """Their values."""
        return self._values

    def _values(self, view: View) -> NDArray[np.float64]:
        power = view.loads[:, self.columns] * self.base_mva
        return np.hstack([power.real, power.imag])


@dataclass
class _Unwrapped:
    """Angles of phasors in rad without jumps of a turn; NaN where there is no voltage."""

    last: NDArray[np.float64] | None = None

    def take(self, voltages: NDArray[np.complex128]) -> NDArray[np.float64]:
        """The angles of the next rows, (n, m)."""
        angles = np.angle(voltages)
        angles[np.abs(voltages) < _NO_VOLTAGE] = np.nan
        last = np.zeros(angles.shape[1]) if self.last is None else self.last
        for row in angles:
            row -= 2 * np.pi * np.round((row - last) / (2 * np.pi))
            last = np.where(np.isnan(row), last, row)
        self.last = last
        return angles


@dataclass
class _FrequencyFilter:
    """The frequency of buses along a run; `lag` is the filtered rate of the angle in rad/s."""

    columns: NDArray[np.int64]
    nominal_hz: float
    unwrapped: _Unwrapped = field(default_factory=_Unwrapped)
    lag: NDArray[np.float64] | None = None
    before: NDArray[np.float64] | None = None
    time: float = 0.0

    def take(self, view: View) -> NDArray[np.float64]:
        """Frequencies of the next rows in Hz, (n, m)."""
        result = np.empty((len(view.part), len(self.columns)))
        rows = zip(view.part.times, self._angles(view), strict=True)
        for k, (time, angle) in enumerate(rows):
            if k == 0 and (self.before is None or time <= self.time):
                self.before = angle  # the angle may have jumped with the network
            result[k] = self.nominal_hz + self._advance(float(time), angle) / (2 * np.pi)
            result[k, np.isnan(angle)] = np.nan
        self._to_the_end(view)
        return result

    def _advance(self, time: float, angle: NDArray[np.float64]) -> NDArray[np.float64]:
        lag = np.zeros(len(angle)) if self.lag is None else self.lag
        step = time - self.time
        if step > 0 and self.before is not None:
            rate = (angle - self.before) / step
            decay = np.exp(-step / FREQUENCY_FILTER)
            lag = np.where(np.isnan(rate), lag, decay * lag + (1 - decay) * rate)
        self.lag, self.before, self.time = lag, angle, time
        return lag

    def _to_the_end(self, view: View) -> None:
        """Go on to the end of the piece, which no row shows: the next one begins there."""
        ending = view.part.following
        if len(ending):
            angles = self._angles(replace(view, part=ending))
            self._advance(float(ending.times[0]), angles[0])

    def _angles(self, view: View) -> NDArray[np.float64]:
        return self.unwrapped.take(view.voltages[:, self.columns])
