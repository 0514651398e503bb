"""Loads of which a part is shed; ends of dc lines at the same buses stay."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from gridfold.dynamics.network.equations import Injections
from gridfold.powerflow.injections import dc_power
from gridfold.powerflow.result import PowerFlowResult


def without_shed(
    power_flow: PowerFlowResult, whole: Injections, shed: Collection[tuple[int, float]]
) -> Injections:
    """The injections less parts of the load at some buses, (number, part) each."""
    if not shed:
        return whole
    case = power_flow.case
    gone = np.zeros(len(case.buses))
    for bus, part in shed:
        gone[case.bus_index[bus]] += part
    ends = np.conj(power_flow.converter_power) / np.abs(power_flow.voltage) ** 2
    load = whole.load - gone * (whole.load - ends)
    loads = whole.nonlinear
    if loads is not None:
        at = np.array([case.bus_index[bus] for bus in loads.buses], dtype=np.int64)
        held, current = (
            dc_power(
                case, [flow for flow in power_flow.dc_flows if flow.line.holds_current is kind]
            )
            for kind in (False, True)
        )
        own = loads.less(held[at], current[at])
        loads = replace(loads, power=loads.power - gone[at][:, None] * own.power)
    return replace(whole, load=load, nonlinear=loads)
