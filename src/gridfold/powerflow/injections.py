"""What is drawn and generated at the buses: loads, dc lines and units, and how units share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import Case, Control, Load
from gridfold.grid.dc_lines import DcLine, ThyristorLine
from gridfold.powerflow.dc_flow import DcFlow
from gridfold.powerflow.thyristor_lines import thyristor_flow
from gridfold.powerflow.transistor_lines import transistor_flow


def depends_on_voltage(load: Load) -> bool:
    """Whether the power of a load in service depends on its voltage."""
    return load.in_service and any(
        (
            load.current_active_mw,
            load.current_reactive_mvar,
            load.impedance_active_mw,
            load.impedance_reactive_mvar,
        )
    )


def load_power(case: Case, magnitude: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Load at each bus at these voltage magnitudes, all in per unit, shape (n_buses,)."""
    power = np.zeros(len(case.buses), dtype=np.complex128)
    for load in case.loads:
        if not load.in_service:
            continue
        at = case.bus_index[load.bus]
        power[at] += complex(load.active_mw, load.reactive_mvar)
        if depends_on_voltage(load):
            v = magnitude[at]
            power[at] += complex(load.current_active_mw, load.current_reactive_mvar) * v
            power[at] += complex(load.impedance_active_mw, load.impedance_reactive_mvar) * v**2
    return power / case.base_mva


def dc_flows(case: Case, magnitude: NDArray[np.float64]) -> tuple[DcFlow, ...]:
    """Operating points of the dc lines at these voltage magnitudes in per unit, (n_buses,)."""

    def flow(line: DcLine) -> DcFlow:
        if isinstance(line, ThyristorLine):
            return thyristor_flow(line, *(magnitude[case.bus_index[bus]] for bus in line.buses))
        return transistor_flow(line)

    return tuple(flow(line) for line in case.dc_lines)


def dc_power(case: Case, flows: Sequence[DcFlow]) -> NDArray[np.complex128]:
    """Power that dc lines draw at each bus, per unit on the system base, shape (n_buses,)."""
    power = np.zeros(len(case.buses), dtype=np.complex128)
    for flow in flows:
        for bus, drawn in zip(flow.line.buses, flow.power_mva, strict=True):
            power[case.bus_index[bus]] += drawn / case.base_mva
    return power


def share_out(
    case: Case, nodes: NDArray[np.int64], generation: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], dict[int, float]]:
    """Divide the generation of each node among its units, and converters that hold its voltage.

    Parameters
    ----------
    case : Case
        The case.
    nodes : ndarray of int, shape (n_buses,)
        The node of each bus.
    generation : ndarray of complex, shape (n_buses,)
        What the first bus of each node generates in per unit.

    Returns
    -------
    tuple of ndarray and dict
        Power of each unit (n_generators,), and reactive power of a converter by bus number, in p.u.
    """
    power = np.zeros(len(case.generators), dtype=np.complex128)
    free_active = generation.real.copy()
    free_reactive = generation.imag.copy()
    active_share = np.zeros(len(case.buses))
    reactive_share = np.zeros(len(case.buses))

    def node(bus: int) -> int:
        return int(nodes[case.bus_index[bus]])

    live = [(k, u, node(u.bus)) for k, u in enumerate(case.generators) if u.in_service]
    for _, unit, at in live:
        if unit.control is Control.SLACK:
            active_share[at] += unit.share
        else:
            free_active[at] -= unit.active_mw / case.base_mva
        if unit.control is Control.POWER:
            free_reactive[at] -= unit.reactive_mvar / case.base_mva
        else:
            reactive_share[at] += unit.share
    holding = [bus for line in case.dc_lines for bus in line.voltage_buses]
    for bus in holding:
        reactive_share[node(bus)] += 1.0
    for k, unit, at in live:
        active, reactive = unit.active_mw / case.base_mva, unit.reactive_mvar / case.base_mva
        if unit.control is Control.SLACK:
            active = free_active[at] * unit.share / active_share[at]
        if unit.control is not Control.POWER:
            reactive = free_reactive[at] * unit.share / reactive_share[at]
        power[k] = complex(active, reactive)
    sent = {bus: free_reactive[node(bus)] / reactive_share[node(bus)] for bus in holding}
    return power, sent
