"""The ends of dc lines in a run: loads of constant power, or of constant current, of either sign.

A line that holds power keeps the active and reactive power of both ends, one that holds current their
currents, at the power-flow solution; below 0.7 p.u. an end is a constant impedance as loads are
(:mod:`gridfold.dynamics.network.loads`). A line with a de-energized end draws nothing at the other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.network.equations import Injections
from gridfold.grid.dc_lines import DcLine
from gridfold.grid.islands import Islands
from gridfold.powerflow.dc_flow import DcFlow
from gridfold.powerflow.injections import dc_power
from gridfold.powerflow.result import PowerFlowResult


def dead_lines(power_flow: PowerFlowResult, islands: Islands) -> tuple[DcLine, ...]:
    """Dc lines in service of which an end is de-energized."""
    index = power_flow.case.bus_index
    return tuple(
        line
        for line in power_flow.case.dc_lines
        if line.in_service and not all(islands.energized[index[bus]] for bus in line.buses)
    )


def end_powers(
    power_flow: PowerFlowResult, flows: Iterable[DcFlow]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Constant-power and constant-current parts at the initial voltages in p.u., each (n_buses,)."""
    case, every = power_flow.case, tuple(flows)
    held = [flow for flow in every if not flow.line.holds_current]
    return dc_power(case, held), dc_power(case, [flow for flow in every if flow.line.holds_current])


def without_dead_lines(
    power_flow: PowerFlowResult, whole: Injections, islands: Islands
) -> Injections:
    """The injections `whole`, less both ends of each line with a de-energized one."""
    dead = set(dead_lines(power_flow, islands))
    if not dead or whole.nonlinear is None:
        return whole
    power, current = end_powers(power_flow, (f for f in power_flow.dc_flows if f.line in dead))
    loads, index = whole.nonlinear, power_flow.case.bus_index
    at = np.array([index[bus] for bus in loads.buses], dtype=np.int64)
    return replace(
        whole,
        load=whole.load - np.conj(power + current) / np.abs(power_flow.voltage) ** 2,
        nonlinear=loads.less(power[at], current[at]),
    )
