"""A linear area seen from its ports: what drives it, and what it does to the rest.

With the voltages at its ports given, the area is a network of its own, with its machines and loads
linearized:

    x' = A x + B u,    u = (arg V, ln |V|) of the ports.

The rest of the system sees a Norton current J at each port, which depends on these states alone,
beside an admittance that belongs to the network. What happens in the rest changes neither A, B nor J.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from gridfold.dynamics.descriptor import grid_descriptor, node_currents
from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network import real_form
from gridfold.dynamics.prime_movers import PrimeMovers
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.partition.ports import Ports
from gridfold.systems.descriptor import DescriptorSystem

Matrix = NDArray[np.float64]
#: Angle in rad that a speed deviation of 1 p.u. is in a swing of 1 Hz, at 60 Hz.
BASE_TURN = 60.0


@dataclass(frozen=True)
class PortArea:
    """A linear area at an operating point.

    Parameters
    ----------
    ports : Ports
        Where it meets the rest.
    system : DescriptorSystem
        A and B of its machines, with angles, then logarithms of magnitudes of the port voltages as
        inputs; its outputs are changes of the port currents, weighed. States of machines that are
        out decay, seen by nothing.
    state_index : ndarray of int, shape (n,)
        Positions of its states in the state vector of the whole model.
    x0, drift : ndarrays, shape (n,)
        States and derivatives there; the latter are zero but for angles that turn with a new
        frequency.
    voltage, current : ndarrays of complex, shape (n_ports,)
        Port voltages V and Norton currents J there, in p.u.
    log_slopes : ndarray, shape (2 n_ports, n)
        Slopes of ln |J|, then of arg J, in the states.
    turn : ndarray, shape (n, 1)
        What a common turn of all angles by 1 rad does to the states; machines that are out
        do not turn.
    turned : ndarray, shape (2 n_ports,)
        By how much more than 1 rad logarithm and angle of J change when the currents of all linear
        machines turn by 1 rad: 0 but for loads behind the ports that are no impedances.
    movers : PrimeMovers or None
        Prime movers that do not belong to the area, though their machines do.
    """

    ports: Ports
    system: DescriptorSystem
    state_index: NDArray[np.int64]
    x0: Matrix
    drift: Matrix
    voltage: NDArray[np.complex128]
    current: NDArray[np.complex128]
    log_slopes: Matrix
    turn: Matrix
    turned: Matrix
    movers: PrimeMovers | None = None

    @property
    def speeds(self) -> Matrix:
        """Ones where a speed that a prime mover is given is a state of the area, (k, n)."""
        at = np.zeros(0) if self.movers is None else self.movers.speed_index
        return np.asarray(at[:, None] == self.state_index, dtype=float)

    @property
    def powers(self) -> Matrix:
        """What the powers of prime movers do to the states of the area, (n, k)."""
        if self.movers is None:
            return np.zeros((len(self.state_index), 0))
        return np.asarray(self.movers.slopes[self.state_index])

    @property
    def driven(self) -> DescriptorSystem:
        """The area with the powers as further inputs and the speeds as further outputs.

        Speeds count as the angles that they are in a swing of 1 Hz, powers in p.u.
        """
        plain, powers = self.system, self.powers
        units = () if self.movers is None else self.movers.units
        return replace(
            plain,
            b1=np.hstack([plain.b1, powers]),
            b2=np.hstack([plain.b2, np.zeros((len(plain.b2), len(units)))]),
            c=np.vstack([plain.c, BASE_TURN * self.speeds]),
            input_names=(*plain.input_names, *(f"power:{unit}" for unit in units)),
        )


def interface_weights(model: DetailedModel, ports: Ports) -> Matrix:
    """R with |R dJ| the root of the summed squares of the voltages that dJ causes, (2 p, 2 p).

    dJ are real, then imaginary parts of changes of the port currents in p.u.; the voltages are those
    of the ports and of the terminals of all machines that are not linear, in p.u.
    """
    linear = set(ports.units)
    kept = [unit.bus for unit in model.layout.source_units if unit not in linear]
    row = _rows(model)
    injected = np.zeros((len(model.equations.live), len(ports.buses)), dtype=np.complex128)
    injected[[row[bus] for bus in ports.buses], np.arange(len(ports.buses))] = 1.0
    seen = [row[bus] for bus in dict.fromkeys([*ports.buses, *kept]) if bus in row]
    caused = model.equations.factors.solve(injected)[seen]
    return np.asarray(np.linalg.qr(real_form(caused), mode="r"))


def linearize_ports(
    ports: Ports,
    model: DetailedModel,
    x: Matrix,
    weights: Matrix,
    movers: PrimeMovers | None = None,
    grid: DescriptorSystem | None = None,
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
    movers : PrimeMovers, optional
        Prime movers that are left out of it, at `x`.
    grid : DescriptorSystem, optional
        The whole linearized there, if that is known.

    Raises
    ------
    OptionError
        A port has no voltage, or no machine feeds it.
    """
    grid = grid_descriptor(model, x) if grid is None else grid
    row, index = _rows(model), area_states(model, ports.units)
    if movers is not None:
        index = np.setdiff1d(index, movers.state_index)
        grid = replace(grid, a11=grid.a11 - _direct(movers, model.n_states))
    idle = np.isin(index, area_states(model, model.state.units_out))
    port_rows = [_port_row(row, bus) for bus in ports.buses]
    if len(set(port_rows)) < len(port_rows):
        raise OptionError(_joined_ports(ports.buses, port_rows))
    behind = dict.fromkeys(row[bus] for bus in sorted(ports.inside) if bus in row)
    at = _both(model, port_rows)
    inside = _both(model, [k for k in behind if k not in port_rows])
    voltage = model.bus_voltages(x[None, :])[0][[model.case.bus_index[b] for b in ports.buses]]
    inner = _inner_system(grid, ports, voltage, (index, at, inside), idle)
    passed_on = inner.algebraic_transposed(grid.a22[at][:, inside].toarray().T).T
    into_node = grid.a21[:, index]
    slopes = into_node[at].toarray() - passed_on @ into_node[inside]
    machines = [unit in set(ports.units) for unit in model.layout.source_units]
    source = node_currents(model, x)[:, machines].sum(axis=1)
    ahead = np.concatenate([-source[len(source) // 2 :], source[: len(source) // 2]])
    current, quarter = (_phasors(s[at] - passed_on @ s[inside]) for s in (source, ahead))
    least = np.minimum(np.abs(current), np.abs(voltage))
    if not least.all():
        raise _no_port(ports.buses[int(np.argmin(least))])
    angles = np.isin(index, model.layout.angle_states())
    return PortArea(
        ports,
        inner.with_outputs(weights @ slopes),
        index,
        x[index].copy(),
        model.compiled(x)[index],
        voltage,
        current,
        _parts(_phasors(slopes) / current[:, None]),
        (angles & ~idle).astype(float)[:, None],
        _parts(quarter / current - 1j),
        movers,
    )


def _inner_system(
    grid: DescriptorSystem,
    ports: Ports,
    voltage: NDArray[np.complex128],
    places: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    idle: NDArray[np.bool_],
) -> DescriptorSystem:
    """The area behind the ports with angles and logarithms of the port voltages as inputs.

    `places` are its states, and the rows of the ports and of the nodes behind them; `idle` tells which
    of its states belong to machines that are out.
    """
    index, at, inside = places
    driven = _parts(np.hstack([np.diag(1j * voltage), np.diag(voltage)]))
    by_node, between = grid.a12[index], grid.a22[inside]
    return DescriptorSystem(
        a11=grid.a11[index][:, index] - diags_array(idle.astype(float)),
        a12=by_node[:, inside],
        a21=grid.a21[inside][:, index],
        a22=between[:, inside],
        b1=by_node[:, at] @ driven,
        b2=between[:, at] @ driven,
        c=np.zeros((0, len(index))),
        state_names=tuple(grid.state_names[k] for k in index),
        input_names=tuple(f"{u}:{bus}" for u in ("angle", "log_voltage") for bus in ports.buses),
    )


def _direct(movers: PrimeMovers, n_states: int) -> csc_array:
    """What speeds do to states by powers that follow them at once, (n_states, n_states)."""
    at = np.zeros((len(movers.units), n_states))
    at[np.arange(len(movers.units)), movers.speed_index] = movers.direct
    return csc_array(csc_array(movers.slopes) @ csc_array(at))


def area_states(model: DetailedModel, units: Collection[UnitKey]) -> NDArray[np.int64]:
    """Positions of the states of `units` in the state vector of the whole model."""
    wanted = set(units)
    columns = [
        column
        for block in model.layout.blocks
        for unit, column in zip(block.units, block.state_index.T, strict=True)
        if unit in wanted
    ]
    return np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *columns]))


def _rows(model: DetailedModel) -> dict[int, int]:
    """Row of each live bus, by number, in the network equations; joined buses share one."""
    rows = model.equations.bus_rows.tolist()
    return {bus.number: row for bus, row in zip(model.case.buses, rows, strict=True) if row >= 0}


def _port_row(row: dict[int, int], bus: int) -> int:
    if bus not in row:
        raise _no_port(bus)
    return row[bus]


def _joined_ports(buses: Sequence[int], rows: Sequence[int]) -> str:
    first = next(k for k, row in enumerate(rows) if row in rows[:k])
    other = buses[rows.index(rows[first])]
    return (
        f"buses {other} and {buses[first]} are ports of one area, and a branch without impedance makes "
        "one node of them: give the branch an impedance, or put both buses on one side"
    )


def _no_port(bus: int) -> OptionError:
    return OptionError(f"bus {bus} is no port: it has no voltage, or no machine feeds it")


def _both(model: DetailedModel, rows: list[int]) -> NDArray[np.int64]:
    """Rows in real form: those of the real, then of the imaginary parts."""
    at = np.array(rows, dtype=np.int64)
    return np.concatenate([at, len(model.equations.live) + at])


def _phasors(parts: Matrix) -> NDArray[np.complex128]:
    """Complex rows (k, ...) from real rows above imaginary ones (2 k, ...)."""
    real, imag = np.split(np.asarray(parts), 2)
    return np.asarray(real + 1j * imag)


def _parts(phasors: NDArray[np.complex128]) -> Matrix:
    """Real rows above imaginary ones (2 k, ...) from complex rows (k, ...)."""
    return np.concatenate([phasors.real, phasors.imag])
