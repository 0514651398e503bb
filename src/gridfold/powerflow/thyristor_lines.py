r"""Operating point of a dc line with thyristors at given ac voltages, with its taps held.

With :math:`B` bridges, :math:`E` the line voltage behind the transformer and :math:`X`, :math:`R` per
bridge, the dc voltages are

.. math::

    V_r = B_r (\tfrac{3\sqrt 2}{\pi} E_r \cos\alpha - \tfrac 3\pi X_r I - 2 R_r I),\quad
    V_i = B_i (\tfrac{3\sqrt 2}{\pi} E_i \cos\gamma - \tfrac 3\pi X_i I + 2 R_i I),\quad
    V_r = V_i + R I.

The rectifier holds current or power by :math:`\alpha`, the inverter its voltage by :math:`\gamma`. An
inverter at its least :math:`\gamma` lets the voltage go; a rectifier at its least :math:`\alpha` leaves
the current, less the margin, to the inverter. The largest angles are nominal: PSS/E steps taps there,
and with taps held they are passed. Reactive power follows from the angle of overlap :math:`\mu`,
:math:`\cos(\alpha + \mu) = \cos\alpha - \sqrt 2 X I / E`:

.. math::

    \tan\varphi =
    \frac{2\mu + \sin 2\alpha - \sin 2(\alpha + \mu)}{\cos 2\alpha - \cos 2(\alpha + \mu)}.

E. W. Kimbark, Direct Current Transmission, vol. I, 1971, chapter 3; PSS/E Program Application Guide,
vol. I, chapter on direct current transmission.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, cos, pi, radians, sin, sqrt

from gridfold.errors import PowerFlowError
from gridfold.grid.dc_lines import LineControl, ThyristorEnd, ThyristorLine
from gridfold.powerflow.dc_flow import DcFlow

_BRIDGE = 3 * sqrt(2) / pi
_ROUNDING = 1e-9  # of a cosine


@dataclass(frozen=True)
class _Bridge:
    """An end at one ac voltage: its dc voltage is ``idle cos(angle) - drop I`` (kV, kA)."""

    end: ThyristorEnd
    ac_kv: float
    sign: int

    @property
    def idle(self) -> float:
        return self.end.bridges * _BRIDGE * self.ac_kv

    @property
    def drop(self) -> float:
        by_overlap = 3 / pi * self.end.reactance_ohm
        return self.end.bridges * (by_overlap + self.sign * 2 * self.end.resistance_ohm)

    @property
    def highest(self) -> float:
        """Cosine of the least angle."""
        return cos(radians(self.end.angle_min_deg))

    @property
    def lowest(self) -> float:
        """Cosine of the largest angle."""
        return cos(radians(self.end.angle_max_deg))

    def cosine(self, voltage: float, current: float) -> float:
        return (voltage + self.drop * current) / self.idle

    def power(self, cosine: float, voltage: float, current: float) -> complex:
        """Power drawn from the ac network in MVA."""
        losses = self.end.bridges * 2 * self.end.resistance_ohm * current**2
        active = self.sign * voltage * current + losses
        sine = sqrt(2) * self.end.reactance_ohm * current / self.ac_kv
        angle = acos(max(-1.0, min(1.0, cosine)))
        after = acos(max(-1.0, min(1.0, cosine - sine)))
        overlap = after - angle
        if overlap < 1e-6:  # rad
            return complex(active, abs(active) * sin(angle) / max(abs(cosine), _ROUNDING))
        above = 2 * overlap + sin(2 * angle) - sin(2 * after)
        spread = cos(2 * angle) - cos(2 * after)
        if spread <= 0:
            raise PowerFlowError(
                f"the converter of a dc line at bus {self.end.bus} has no operating point: its "
                f"commutation takes {overlap * 180 / pi:.1f} degrees"
            )
        return complex(active, abs(active) * above / spread)


def thyristor_flow(line: ThyristorLine, rectifier_pu: float, inverter_pu: float) -> DcFlow:
    """The line at these magnitudes of the voltages at its ends, in p.u.

    Raises
    ------
    PowerFlowError
        No current gives the power, or a converter would need more voltage than it has.
    """
    if not line.in_service or line.setting == 0:
        return DcFlow(line, (0j, 0j), "blocked" if not line.in_service else "without current")
    rectifier = _Bridge(line.rectifier, _behind(line.rectifier, rectifier_pu), 1)
    inverter = _Bridge(line.inverter, _behind(line.inverter, inverter_pu), -1)
    current, voltage, told = _held_voltage(line, inverter)
    sent = voltage + line.resistance_ohm * current
    if rectifier.cosine(sent, current) > rectifier.highest + _ROUNDING:
        told = "the rectifier is at its least angle, and the inverter holds the current"
        current *= 1 - line.margin
        sent = rectifier.idle * rectifier.highest - rectifier.drop * current
        voltage = sent - line.resistance_ohm * current
    alpha, gamma = rectifier.cosine(sent, current), inverter.cosine(voltage, current)
    if not (voltage > 0 and abs(gamma) <= 1 and abs(alpha) <= 1):
        raise PowerFlowError(
            f"{line}: its converters have no operating point at {rectifier_pu:.4f} p.u. (rectifier) "
            f"and {inverter_pu:.4f} p.u. (inverter): {current * 1000:.1f} A, {sent:.2f} and "
            f"{voltage:.2f} kV"
        )
    if not told and (alpha < rectifier.lowest or gamma < inverter.lowest):
        told = "an angle is above its nominal largest one, at which PSS/E would step a tap"
    powers = rectifier.power(alpha, sent, current), inverter.power(gamma, voltage, current)
    return DcFlow(
        line, powers, told, current * 1000, (sent, voltage), (_degrees(alpha), _degrees(gamma))
    )


def _behind(end: ThyristorEnd, voltage_pu: float) -> float:
    return end.base_kv * voltage_pu * end.transformer_ratio / end.tap


def _held_voltage(line: ThyristorLine, inverter: _Bridge) -> tuple[float, float, str]:
    """Current (kA) and voltage of the inverter (kV) with the current held by the rectifier.

    Besides what limits them, in words.
    """
    current = _current(line, line.voltage_kv, line.compounding_ohm)
    voltage, told = line.voltage_kv - line.compounding_ohm * current, ""
    if inverter.cosine(voltage, current) > inverter.highest + _ROUNDING:
        told = "the inverter is at its least angle"
        current = _current(line, inverter.idle * inverter.highest, inverter.drop)
        voltage = inverter.idle * inverter.highest - inverter.drop * current
    if line.control is LineControl.POWER and voltage < line.switch_kv:
        told = f"it holds its current as the inverter is below {line.switch_kv:g} kV"
        current = abs(line.setting) / line.voltage_kv
        least_angle = inverter.idle * inverter.highest - inverter.drop * current
        voltage = min(line.voltage_kv - line.compounding_ohm * current, least_angle)
    return current, voltage, told


def _current(line: ThyristorLine, idle_kv: float, drop_ohm: float) -> float:
    """Current in kA where the inverter's voltage is ``idle_kv - drop_ohm I``."""
    if line.control is LineControl.CURRENT:
        return abs(line.setting) / 1000
    power = abs(line.setting)
    rise = line.resistance_ohm - drop_ohm if line.setting > 0 else -drop_ohm
    inner = idle_kv**2 + 4 * rise * power
    if inner < 0 or idle_kv <= 0:
        raise PowerFlowError(
            f"{line}: no current carries {power:g} MW at {idle_kv:.2f} kV less {drop_ohm:.3g} ohm"
        )
    return 2 * power / (idle_kv + sqrt(inner))


def _degrees(cosine: float) -> float:
    return acos(cosine) * 180 / pi
