"""Operating point of a dc line with voltage-source converters.

One converter holds the dc voltage V, the other the power P that it sends into its ac network. Each
loses ``max(least, a + b I)`` kW. With I from the first to the second,

    (V - R I) I = P + loss(I),

and the first draws ``V I + loss(I)`` from its ac network. Reactive power follows from a power factor,
within limits, or is what holds the voltage of the bus. PSS/E Program Operation Manual, voltage source
converter dc line data.
"""

from __future__ import annotations

from math import acos, sqrt, tan

from gridfold.errors import PowerFlowError
from gridfold.grid.dc_lines import DcControl, TransistorEnd, TransistorLine
from gridfold.powerflow.dc_flow import DcFlow

_ITERATIONS, _SETTLED = 100, 1e-13


def transistor_flow(line: TransistorLine) -> DcFlow:
    """The line in the power flow.

    Raises
    ------
    PowerFlowError
        No current carries the power.
    """
    ends = (line.first, line.second)
    if not line.in_service:
        return DcFlow(line, (0j, 0j), "out of service")
    holds = next(end for end in ends if end.control is DcControl.VOLTAGE)
    sends = line.second if holds is line.first else line.first
    volts = holds.setting
    if sends.control is DcControl.OUT:
        idle = _loss(holds, 0.0)
        drawn = {id(holds): idle, id(sends): 0.0}
        current, told = 0.0, f"the converter at bus {sends.bus} is out of service"
    else:
        current, told = _current(line, volts, sends), ""
        drawn = {id(holds): volts * current + _loss(holds, current), id(sends): -sends.setting}
    first, second = (_with_reactive(end, drawn[id(end)]) for end in ends)
    far = volts - line.resistance_ohm * current
    kilovolts = (volts, far) if holds is line.first else (far, volts)
    return DcFlow(line, (first, second), told, abs(current) * 1000, kilovolts)


def _current(line: TransistorLine, volts: float, sends: TransistorEnd) -> float:
    """Current in kA, by a fixed point of the loss, which hardly depends on it."""
    current = 0.0
    for _ in range(_ITERATIONS):
        power = sends.setting + _loss(sends, current)
        inner = volts**2 - 4 * line.resistance_ohm * power
        if inner < 0:
            break
        before, current = current, 2 * power / (volts + sqrt(inner))
        if abs(current - before) <= _SETTLED * max(1.0, abs(current)):
            return current
    raise PowerFlowError(
        f"{line}: no current carries {sends.setting:g} MW at {volts:g} kV over "
        f"{line.resistance_ohm:g} ohm"
    )


def _loss(end: TransistorEnd, current: float) -> float:
    """Loss of a converter in MW."""
    by_current = end.loss_kw + end.loss_kw_per_a * abs(current) * 1000
    return max(end.least_loss_kw, by_current) / 1000


def _with_reactive(end: TransistorEnd, drawn_mw: float) -> complex:
    """Power drawn in MVA."""
    if end.holds_voltage or end.control is DcControl.OUT or end.power_factor == 0:
        return complex(drawn_mw)
    sign = 1 if end.power_factor > 0 else -1
    sent = sign * -drawn_mw * tan(acos(min(1.0, abs(end.power_factor))))
    sent = min(max(sent, end.reactive_min_mvar), end.reactive_max_mvar)
    return complex(drawn_mw, -sent)
