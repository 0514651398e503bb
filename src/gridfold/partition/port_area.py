"""A linear area seen from its ports: what drives it, and what it does to the rest.

With the voltages at its ports given, the area is a network of its own, with its machines and loads
linearized:

    x' = A x + B u,    u = (arg V, ln |V|) of the ports.

The rest of the system sees a Norton current J at each port, which depends on these states alone,
beside an admittance that belongs to the network. What happens in the rest changes neither A, B nor J.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import NetworkEquations, real_form
from gridfold.dynamics.network.real_sparse import real_matrix
from gridfold.errors import OptionError
from gridfold.partition.ports import Ports
from gridfold.systems.descriptor import DescriptorSystem

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class PortArea:
    """A linear area at an operating point.

    Parameters
    ----------
    ports : Ports
        Where it meets the rest.
    system : DescriptorSystem
        A and B of its machines, with angles, then logarithms of magnitudes of the port voltages as
        inputs; its outputs are the changes of the port currents by :func:`interface_weights`.
    state_index : ndarray of int, shape (n,)
        Positions of its states in the state vector of the whole model.
    x0, drift : ndarrays, shape (n,)
        States and derivatives there; the latter are zero but for angles that turn with a new
        frequency.
    voltage, current : ndarrays of complex, shape (n_ports,)
        Port voltages V and Norton currents J there, in p.u.
    log_slopes : ndarray, shape (2 n_ports, n)
        Slopes of ln |J|, then of arg J, in the states.
    """

    ports: Ports
    system: DescriptorSystem
    state_index: NDArray[np.int64]
    x0: Matrix
    drift: Matrix
    voltage: NDArray[np.complex128]
    current: NDArray[np.complex128]
    log_slopes: Matrix


def interface_weights(model: DetailedModel, ports: Ports) -> Matrix:
    """R with |R dJ| the root of the summed squares of the voltages that dJ causes, (2 p, 2 p).

    dJ are real, then imaginary parts of changes of the port currents in p.u.; the voltages are those
    of the ports and of the terminals of all machines that are not linear, in p.u.
    """
    linear = set(ports.units)
    kept = [unit.bus for unit in model.layout.source_units if unit not in linear]
    equations, row = model.equations, _rows(model)
    injected = np.zeros((len(equations.live), len(ports.buses)), dtype=np.complex128)
    injected[[row[bus] for bus in ports.buses], np.arange(len(ports.buses))] = 1.0
    seen = [row[bus] for bus in dict.fromkeys([*ports.buses, *kept]) if bus in row]
    caused = equations.factors.solve(injected)[seen]
    return np.asarray(np.linalg.qr(real_form(caused), mode="r"))


def linearize_ports(
    ports: Ports, model: DetailedModel, x: Matrix, weights: Matrix
) -> PortArea:
    """Linearize the area behind `ports` at the state `x` of the whole system.

    Parameters
    ----------
    ports : Ports
        Where the area meets the rest.
    model : DetailedModel
        The whole system in the network state in which `x` is meant.
    x : ndarray, shape (n_states,)
        The state.
    weights : ndarray, shape (k, 2 n_ports)
        How changes of the port currents count in the outputs.

    Raises
    ------
    OptionError
        A port has no voltage, or no machine feeds it.
    """
    network = _area_network(ports, model, x)
    index = _states_of(model, ports)
    partials = model.partials(x)
    currents = csc_array(partials.currents[:, index])
    by_voltage = csc_array(partials.voltages[index])
    slopes = network.seen_from_ports(currents)
    current = _phasors(network.seen_from_ports(_norton_currents(model, x, ports))[:, 0])
    voltage = model.bus_voltages(x[None, :])[0][[model.case.bus_index[b] for b in ports.buses]]
    least = np.minimum(np.abs(current), np.abs(voltage))
    if not least.all():
        dead = ports.buses[int(np.argmin(least))]
        raise OptionError(f"bus {dead} is no port: it has no voltage, or no machine feeds it")
    polar = np.hstack([np.diag(1j * voltage), np.diag(voltage)])
    driven = np.vstack([polar.real, polar.imag])
    relative = _phasors(slopes) / current[:, None]
    system = DescriptorSystem(
        a11=csc_array(partials.states[index][:, index]),
        a12=csc_array(by_voltage @ network.to_inside),
        a21=csc_array(network.to_inside.T @ currents),
        a22=csc_array(-network.inner),
        b1=by_voltage @ (network.to_ports @ driven),
        b2=-(network.from_ports @ driven),
        c=weights @ slopes,
        state_names=tuple(model.state_names[k] for k in index),
        input_names=tuple(f"{u}:{bus}" for u in ("angle", "log_voltage") for bus in ports.buses),
    )
    return PortArea(
        ports,
        system,
        index,
        x[index].copy(),
        model.compiled(x)[index],
        voltage,
        current,
        np.vstack([relative.real, relative.imag]),
    )


@dataclass(frozen=True)
class _AreaNetwork:
    """The network behind ports in real form: real, then imaginary parts over its nodes.

    `inner` are admittances between the k inner nodes, `from_ports` and `outward` those to and from
    the ports; `to_inside` and `to_ports` are the columns of the inner nodes and of the ports among
    all terminals, (2 n_terminals, 2 k) and (2 n_terminals, 2 n_ports).
    """

    inner: csc_array
    from_ports: csc_array
    outward: csc_array
    to_inside: csc_array
    to_ports: csc_array

    def seen_from_ports(self, currents: csc_array) -> Matrix:
        """Norton currents at the ports, (2 n_ports, j), of currents into terminals, (..., j)."""
        direct = (self.to_ports.T @ currents).toarray()
        if not self.inner.shape[0]:
            return np.asarray(direct)
        passed = splu(csc_array(self.inner.T)).solve(self.outward.toarray().T).T
        return np.asarray(direct - (self.to_inside @ passed.T).T @ currents)


def _area_network(ports: Ports, model: DetailedModel, x: Matrix) -> _AreaNetwork:
    equations, row = model.equations, _rows(model)
    matrix = _with_linear_loads(ports, model, x)
    inside = np.array([row[bus] for bus in sorted(ports.inside) if bus in row], dtype=np.int64)
    at = np.array([row[bus] for bus in ports.buses], dtype=np.int64)
    n = len(equations.live)
    inside_both, at_both = np.r_[inside, n + inside], np.r_[at, n + at]
    return _AreaNetwork(
        csc_array(matrix[inside_both][:, inside_both]),
        csc_array(matrix[inside_both][:, at_both]),
        csc_array(matrix[at_both][:, inside_both]),
        _terminals_at(equations, inside),
        _terminals_at(equations, at),
    )


def _with_linear_loads(ports: Ports, model: DetailedModel, x: Matrix) -> csc_array:
    """The network matrix in real form, with the slopes at `x` of loads outside the study area."""
    loads = model.injections.nonlinear
    if loads is None:
        none = np.zeros(0, dtype=np.int64)
        return csc_array(real_matrix(model.equations, np.zeros((0, 2, 2)), none))
    outside = [k for k, bus in enumerate(loads.buses) if bus not in ports.study]
    places = loads.places(model.layout.terminals)
    slopes = loads.slopes(model.terminal_voltages(x[None, :])[0][places])
    rows = model.equations.terminals[places]
    return csc_array(real_matrix(model.equations, slopes[outside], rows[outside]))


def _terminals_at(equations: NetworkEquations, nodes: NDArray[np.int64]) -> csc_array:
    """Ones where a terminal, in real form (2 n_terminals), is one of the nodes (2 n_nodes)."""
    place = {int(node): k for k, node in enumerate(nodes)}
    found = [(t, place[int(r)]) for t, r in enumerate(equations.terminals) if int(r) in place]
    rows, columns = np.array(found, dtype=np.int64).reshape(-1, 2).T
    n, k = len(equations.terminals), len(nodes)
    ones = np.ones(2 * len(rows))
    both = np.r_[rows, n + rows], np.r_[columns, k + columns]
    return csc_array(coo_array((ones, both), shape=(2 * n, 2 * k)))


def _norton_currents(model: DetailedModel, x: Matrix, ports: Ports) -> csc_array:
    """Currents of the linear machines into the terminals, (2 n_terminals, 1), at the state `x`."""
    signals, n = model.signals(x[None, :])[0], len(model.layout.terminals)
    wanted = set(ports.units) - set(model.state.units_out)
    currents = np.zeros((2 * n, 1))
    for (real, imag, at), unit in zip(model.layout.sources, model.layout.source_units, strict=True):
        if unit in wanted:
            currents[at] += signals[real]
            currents[n + at] += signals[imag]
    return csc_array(currents)


def _states_of(model: DetailedModel, ports: Ports) -> NDArray[np.int64]:
    wanted = set(ports.units)
    columns = [
        column
        for block in model.layout.blocks
        for unit, column in zip(block.units, block.state_index.T, strict=True)
        if unit in wanted
    ]
    return np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *columns]))


def _rows(model: DetailedModel) -> dict[int, int]:
    """Row of each live bus, by number, in the network equations."""
    numbers = [bus.number for bus in model.case.buses]
    live = model.equations.live
    return {numbers[bus]: row for row, bus in enumerate(live.tolist()) if bus < len(numbers)}


def _phasors(parts: Matrix) -> NDArray[np.complex128]:
    """Complex rows (k, ...) from real rows above imaginary ones (2 k, ...)."""
    real, imag = np.split(parts, 2)
    return np.asarray(real + 1j * imag)
