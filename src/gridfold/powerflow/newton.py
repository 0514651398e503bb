"""Power flow: voltages at which the network carries what loads, units and dc lines draw and give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import PowerFlowError
from gridfold.grid.case import Case, Control
from gridfold.powerflow.dc_flow import DcFlow
from gridfold.powerflow.injections import (
    dc_flows,
    dc_power,
    depends_on_voltage,
    load_power,
    share_out,
)
from gridfold.powerflow.island import Problem, solve_island
from gridfold.powerflow.network import FlowNetwork
from gridfold.powerflow.result import PowerFlowResult

_MAX_LOAD_ITERATIONS = 100
_WORST = 5
_RANK = {Control.POWER: 0, Control.VOLTAGE: 1, Control.SLACK: 2}


def solve_power_flow(
    case: Case, tolerance: float = 1e-10, network: FlowNetwork | None = None
) -> PowerFlowResult:
    """Solve the power flow of a case.

    Newton's method starts from the stored voltages, and once more from a flat start if that fails or
    leaves more than 45 degrees across an impedance. The angles of a flat start follow the phase shifts
    of transformers; it comes first where stored angles do not. Of two solutions that with the smaller
    angles is taken.
    Where loads or dc lines depend on voltage, it is repeated with their powers at the last voltages
    until both fit. Buses that branches without impedance join are one node. Every swing bus holds its
    stored voltage and angle. Reactive limits are not enforced.

    Parameters
    ----------
    case : Case
        A valid case.
    tolerance : float
        Largest power mismatch allowed, in per unit on the system base. Where admittances are so large
        that rounding alone leaves more, ``100 eps (|Y| |V|)_i |V_i|`` at bus i is allowed.
    network : FlowNetwork, optional
        Its network, from another case that differs in powers alone; the case is not checked then.

    Returns
    -------
    PowerFlowResult
        Voltages (n_buses,), powers of units (n_generators,) and loads (n_buses,), per unit.

    Raises
    ------
    CaseError
        The case is not valid.
    PowerFlowError
        No solution was found; names the buses with the largest mismatch.
    """
    network = FlowNetwork.of(case) if network is None else network
    nodes = network.nodes
    voltage = _at_set_points(case, nodes, _stored(case, nodes))
    iterations, change = 0, 0.0
    load, flows = _drawn(case, voltage[nodes])
    depends = case.dc_lines or any(depends_on_voltage(item) for item in case.loads)
    part = tolerance / 2 if depends else tolerance
    for _ in range(_MAX_LOAD_ITERATIONS):
        drawn = load + dc_power(case, flows)
        voltage, count, worst = _solve_islands(case, network, drawn, voltage, part)
        iterations += count
        if not depends:
            break
        load, flows = _drawn(case, voltage[nodes])
        change = float(np.abs(load + dc_power(case, flows) - drawn).max())
        if change <= part:
            break
    else:
        raise PowerFlowError(
            f"case {case.name}: the loads and dc lines that depend on voltage did not settle in "
            f"{_MAX_LOAD_ITERATIONS} power flows; they still change by "
            f"{change * case.base_mva:.3g} MVA"
        )
    generation = voltage * np.conj(network.admittance @ voltage)
    np.add.at(generation, nodes, load + dc_power(case, flows))
    unit_power, sent = share_out(case, nodes, generation)
    flows = tuple(_with_held_voltage(case, flow, sent) for flow in flows)
    return PowerFlowResult(
        case, voltage[nodes], unit_power, load, iterations, worst + change, flows
    )


def _drawn(
    case: Case, voltage: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], tuple[DcFlow, ...]]:
    """Loads (n_buses,) in per unit and dc lines at these voltages of the buses."""
    size = np.abs(voltage)
    return load_power(case, size), dc_flows(case, size)


def _with_held_voltage(case: Case, flow: DcFlow, sent: dict[int, float]) -> DcFlow:
    """The dc line with the reactive power of converters that hold the voltage of their bus."""
    holding = flow.line.voltage_buses
    first, second = (
        power - 1j * sent[bus] * case.base_mva if bus in holding else power
        for bus, power in zip(flow.line.buses, flow.power_mva, strict=True)
    )
    return replace(flow, power_mva=(first, second))


def _solve_islands(
    case: Case,
    network: FlowNetwork,
    drawn: NDArray[np.complex128],
    start: NDArray[np.complex128],
    tolerance: float,
) -> tuple[NDArray[np.complex128], int, float]:
    """Voltages of nodes with constant power, most Newton iterations, largest mismatch."""
    scheduled, kind = _schedule(case, network.nodes, drawn)
    stored = _at_set_points(case, network.nodes, start)
    voltage = stored.copy()
    iterations, worst = 0, 0.0
    for island in network.islands:
        members = island.members
        problem = Problem(
            island.admittance,
            scheduled[members],
            island.branches,
            *(
                np.flatnonzero(kind[members] == control).astype(np.int32)
                for control in (Control.SLACK, Control.VOLTAGE, Control.POWER)
            ),
        )
        found = solve_island(problem, stored[members], tolerance)
        if found.excess > 1:
            raise PowerFlowError(_explain(case, problem, found.voltage, members))
        voltage[members] = found.voltage
        iterations = max(iterations, found.iterations)
        worst = max(worst, float(np.abs(problem.mismatch(voltage[members])).max()))
    return voltage, iterations, worst


def _stored(case: Case, nodes: NDArray[np.int64]) -> NDArray[np.complex128]:
    """Stored voltages by node, (n_buses,): of a node with a swing unit those of that unit's bus."""
    voltage = np.array(
        [bus.voltage_pu * np.exp(1j * np.deg2rad(bus.angle_deg)) for bus in case.buses]
    )
    swinging = [
        case.bus_index[unit.bus]
        for unit in case.generators
        if unit.in_service and unit.control is Control.SLACK
    ]
    by_node = voltage.copy()
    for at in reversed(swinging):
        by_node[nodes[at]] = voltage[at]
    return by_node


def _at_set_points(
    case: Case, nodes: NDArray[np.int64], voltage: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """`voltage` of the nodes with the magnitudes that generators hold."""
    held = voltage.copy()
    for unit in case.generators:
        if unit.in_service and unit.control is not Control.POWER:
            at = nodes[case.bus_index[unit.bus]]
            held[at] = voltage[at] * (unit.voltage_pu / np.abs(voltage[at]))
    return held


def _schedule(
    case: Case, nodes: NDArray[np.int64], drawn: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.object_]]:
    """Scheduled injection and kind of each node, at the place of its first bus."""
    scheduled = np.zeros(len(nodes), dtype=np.complex128)
    np.subtract.at(scheduled, nodes, drawn)
    kind = np.full(len(nodes), Control.POWER, dtype=object)
    for line in case.dc_lines:
        for bus in line.voltage_buses:
            kind[nodes[case.bus_index[bus]]] = Control.VOLTAGE
    for unit in case.generators:
        if not unit.in_service:
            continue
        at = nodes[case.bus_index[unit.bus]]
        scheduled[at] += complex(unit.active_mw, unit.reactive_mvar) / case.base_mva
        if _RANK[unit.control] > _RANK[kind[at]]:
            kind[at] = unit.control
    return scheduled, kind


def _explain(
    case: Case, problem: Problem, voltage: NDArray[np.complex128], members: NDArray[np.int64]
) -> str:
    error = problem.mismatch(voltage) * case.base_mva
    worst = np.argsort(-np.abs(error))[:_WORST]
    lines = [
        f"  bus {case.buses[members[k]].number}: {error[k].real:+.4g} MW, {error[k].imag:+.4g} Mvar "
        f"at {abs(voltage[k]):.4f} p.u."
        for k in worst
    ]
    return (
        f"case {case.name}: the power flow did not converge, neither from the stored voltages nor "
        f"from a flat start; the largest mismatches at the nearest point found:\n"
        + "\n".join(lines)
    )
