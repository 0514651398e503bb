"""The external area as a linear system: equations (2) and (3) of Osipov & Sun.

Its inputs are angle and magnitude of the boundary buses' voltages, u = (theta, V); its outputs are its
states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import real_form
from gridfold.errors import OptionError
from gridfold.partition.areas import Partition
from gridfold.partition.coupling import external_network
from gridfold.systems.linear import LinearSystem


@dataclass(frozen=True)
class ExternalLinearization:
    """The external area linearized at an operating point.

    Parameters
    ----------
    system : LinearSystem
        A, B and C = I of (3).
    x0 : ndarray, shape (n_external_states,)
        The states there.
    u0 : ndarray, shape (2 * n_boundary,)
        The inputs there: angles in rad, then magnitudes in per unit.
    state_index : ndarray of int, shape (n_external_states,)
        Positions of the external states in the state vector of the whole model.
    drift : ndarray, shape (n_external_states,)
        Derivatives there: zero at an equilibrium, but for angles that turn with its frequency.
    """

    system: LinearSystem
    x0: NDArray[np.float64]
    u0: NDArray[np.float64]
    state_index: NDArray[np.int64]
    drift: NDArray[np.float64]


def linearize_external(
    parts: Partition,
    model: DetailedModel | None = None,
    x: NDArray[np.float64] | None = None,
) -> ExternalLinearization:
    """Linearize the external area at a state of the whole system.

    Parameters
    ----------
    parts : Partition
        The areas.
    model : DetailedModel, optional
        The whole system in the network state in which `x` is meant; the intact one by default.
    x : ndarray, shape (n_states,), optional
        The state; the equilibrium of the intact system by default.
    """
    model = parts.model if model is None else model
    x = model.x0 if x is None else np.asarray(x, dtype=float)
    voltages = model.bus_voltages(x[None, :])[0]
    boundary = _boundary_voltages(parts, voltages)
    partials = model.partials(x)
    index = np.array(parts.states_of(parts.external_units), dtype=np.int64)
    terminal = {bus: k for k, bus in enumerate(model.layout.terminals)}
    at = np.array([terminal[unit.bus] for unit in parts.external_units])
    # One row a bus: machines at the same bus see the same voltage.
    buses, first = np.unique(at, return_index=True)
    both = np.concatenate([buses, len(terminal) + buses])
    impedance, transfer = _response(parts, model, voltages, first)
    a = partials.states[index][:, index].toarray()
    to_voltage = partials.voltages[index][:, both].toarray()
    currents = partials.currents[both][:, index].toarray()
    a += to_voltage @ (impedance @ currents)
    polar = np.block([[np.diag(1j * boundary), np.diag(boundary / np.abs(boundary))]])
    b = to_voltage @ (transfer @ np.concatenate([polar.real, polar.imag]))
    u0 = np.concatenate([np.angle(boundary), np.abs(boundary)])
    names = tuple(model.state_names[k] for k in index)
    inputs = tuple(
        f"{name}:{bus}" for name in ("angle", "magnitude") for bus in parts.boundary_buses
    )
    system = LinearSystem(
        a, b, np.eye(len(index)), state_names=names, input_names=inputs, output_names=names
    )
    drift = model.compiled(x)[index]
    return ExternalLinearization(system, x[index].copy(), u0, index, drift)


def _response(
    parts: Partition,
    model: DetailedModel,
    voltages: NDArray[np.complex128],
    rows: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slopes of the voltages at external units `rows` in their currents and boundary voltages.

    Both in real form: (2 n, 2 n) and (2 n, 2 n_boundary).
    """
    loads = model.injections.nonlinear
    outside = [] if loads is None else [bus for bus in loads.buses if bus not in parts.study_buses]
    network = external_network(parts, outside)
    chosen = np.concatenate([rows, np.arange(len(parts.external_units), len(network.impedance))])
    impedance = real_form(network.impedance[np.ix_(chosen, chosen)])
    transfer = real_form(network.transfer[chosen])
    n, total = len(rows), len(chosen)
    if loads is not None and outside:
        at_loads = voltages[[model.case.bus_index[bus] for bus in loads.buses]]
        own = [loads.buses.index(bus) for bus in outside]
        slopes = loads.scattered(loads.slopes(at_loads)[own], np.arange(n, total), total)
        closing = np.eye(2 * total) - impedance @ slopes
        impedance = np.asarray(np.linalg.solve(closing, impedance), dtype=np.float64)
        transfer = np.asarray(np.linalg.solve(closing, transfer), dtype=np.float64)
    kept = np.concatenate([np.arange(n), np.arange(total, total + n)])
    return impedance[np.ix_(kept, kept)], transfer[kept]


def _boundary_voltages(
    parts: Partition, voltages: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    index = parts.model.case.bus_index
    boundary = voltages[[index[bus] for bus in parts.boundary_buses]]
    if not np.abs(boundary).all():
        dead = parts.boundary_buses[int(np.argmin(np.abs(boundary)))]
        raise OptionError(f"the voltage of boundary bus {dead} is zero; it has no angle")
    return boundary
