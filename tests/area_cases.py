"""The external area written out once more from the case data, and a reducer that reduces nothing."""

from __future__ import annotations

import numpy as np

import gridfold as gf
from gridfold.partition import Partition
from gridfold.reduction import Reduction
from gridfold.systems import LinearSystem, StateMap


class Unreduced:
    """T = I: a reducer that leaves everything as it is."""

    def reduce(self, system: LinearSystem, reference: np.ndarray) -> Reduction:
        return Reduction(system, StateMap.identity(reference), None, 0.0, 0)


def external_admittance(parts: Partition) -> np.ndarray:
    """Admittance between internal voltages of the external area, by plain dense Kron reduction.

    First the external machines in order of `parts.external_units`, then one fictitious generator for
    each tie line, behind its series impedance.
    """
    model, case = parts.model, parts.model.case
    flow = model.power_flow
    outside = [bus.number for bus in case.buses if bus.number not in parts.study_buses]
    place = {bus: k for k, bus in enumerate(outside)}
    position = {bus.number: k for k, bus in enumerate(case.buses)}
    squared = np.abs(flow.voltage) ** 2
    ties = [case.branches[tie.branch] for tie in parts.tie_lines]
    n, m = len(outside), len(parts.external_units)
    y = np.zeros((n + m + len(ties),) * 2, dtype=complex)
    nodes = dict(place)
    for branch in case.branches:
        inner = branch.from_bus in place, branch.to_bus in place
        if not any(inner):
            continue
        far = n + m + ties.index(branch) if branch in ties else None
        i, j = nodes.get(branch.from_bus, far), nodes.get(branch.to_bus, far)
        series = 1 / complex(branch.resistance, branch.reactance)
        tap = branch.ratio * np.exp(1j * np.deg2rad(branch.shift_deg))
        y[i, i] += (series + 0.5j * branch.susceptance) / abs(tap) ** 2
        y[j, j] += series + 0.5j * branch.susceptance
        y[i, j] -= series / np.conj(tap)
        y[j, i] -= series / tap
    for shunt in case.shunts:
        if shunt.bus in place:
            k = place[shunt.bus]
            y[k, k] += complex(shunt.conductance_mw, shunt.susceptance_mvar) / case.base_mva
    for load in case.loads:
        if load.bus in place:
            k = place[load.bus]
            power = complex(load.active_mw, load.reactive_mvar) / case.base_mva
            y[k, k] += np.conj(power) / squared[position[load.bus]]
    machines = {r.key: r.parameters for r in case.devices if r.model == "two_axis"}
    for generator, power in zip(case.generators, flow.unit_power, strict=True):
        if generator.key not in machines and generator.bus in place:
            k = place[generator.bus]
            y[k, k] -= np.conj(power) / squared[position[generator.bus]]
    for inside, unit in enumerate(parts.external_units, start=n):
        record = machines[unit]
        own = 1 / complex(record["resistance"], record["d_transient_reactance"])
        k = place[unit.bus]
        y[k, k] += own
        y[inside, inside] += own
        y[k, inside] -= own
        y[inside, k] -= own
    return y[n:, n:] - y[n:, :n] @ np.linalg.solve(y[:n, :n], y[:n, n:])


def external_derivatives(
    parts: Partition, admittance: np.ndarray, x: np.ndarray, boundary: np.ndarray
) -> np.ndarray:
    """Equations (1) and (2) of the external machines, the boundary buses' voltages given.

    `x` are the states of the whole system, `boundary` the voltages of `parts.boundary_buses`; the
    result stands at the places of the external states.
    """
    model, units = parts.model, parts.external_units
    p: dict[str, np.ndarray] = {}
    for block in model.layout.blocks:
        columns = [block.units.index(unit) for unit in units]
        rows = zip(block.device.parameter_rows, block.parameters[:, columns], strict=True)
        p |= dict(rows)

    def state(name: str) -> np.ndarray:
        return x[model.slots(name, units)]

    e_d, e_q = state("d_transient_voltage"), state("q_transient_voltage")
    turn = np.exp(1j * (state("rotor_angle") - np.pi / 2))
    far = [parts.boundary_buses.index(tie.study_bus) for tie in parts.tie_lines]
    sources = np.concatenate([(e_d + 1j * e_q) * turn, boundary[far]])
    current = (admittance[: len(units)] @ sources) / turn
    i_d, i_q = current.real, current.imag
    r_a, x_1 = p["resistance"], p["d_transient_reactance"]
    v_t = np.hypot(e_d - r_a * i_d + x_1 * i_q, e_q - r_a * i_q - x_1 * i_d)
    slip, field = state("speed") - 1, state("field_voltage")
    feedback = p["feedback_gain"] / p["feedback_time"] * field
    error = p["voltage_reference"] - v_t + state("rate_feedback") - feedback
    saturation = p["saturation_a"] * np.exp(p["saturation_b"] * field)
    derivatives = {
        "rotor_angle": 120 * np.pi * slip,
        "mechanical_power": (state("governor_power") - state("mechanical_power"))
        / p["charging_time"],
        "governor_power": (p["power_reference"] - slip / p["droop"] - state("governor_power"))
        / p["governor_time"],
        "regulator_voltage": (p["regulator_gain"] * error - state("regulator_voltage"))
        / p["regulator_time"],
        "rate_feedback": (feedback - state("rate_feedback")) / p["feedback_time"],
        "field_voltage": (state("regulator_voltage") - (p["exciter_gain"] + saturation) * field)
        / p["exciter_time"],
        "d_transient_voltage": ((p["q_reactance"] - x_1) * i_q - e_d) / p["q_open_circuit_time"],
        "q_transient_voltage": (field - e_q - (p["d_reactance"] - x_1) * i_d)
        / p["d_open_circuit_time"],
        "speed": (state("mechanical_power") - e_d * i_d - e_q * i_q - p["damping"] * slip)
        / (2 * p["inertia"]),
    }
    result = np.zeros(model.n_states)
    for name, values in derivatives.items():
        result[model.slots(name, units)] = values
    return result[parts.states_of(units)]


def boundary_voltages(parts: Partition, model: gf.DetailedModel, x: np.ndarray) -> np.ndarray:
    """Voltages of the boundary buses at the state `x` of the whole system."""
    index = model.case.bus_index
    voltages = model.bus_voltages(x[None, :])[0]
    return voltages[[index[bus] for bus in parts.boundary_buses]]
