"""The compiled right-hand side of a model of which one area is linear and acts through ports.

State v = (states of the exact units, coordinates z of the linear area). The linear area is a Norton
source at each of its p ports. Its currents are linear in logarithm and angle, and it is driven by
angle and logarithm of the port voltages:

    J = J0 exp(C z),    z' = A z + B (u - u0) + c,    u = (arg V, ln |V|).

Prime movers of machines in the area may be exact: they are given the speed, linear in z, and their
power drives z.

So a step costs what the exact units and the ports cost, however many machines are behind the ports,
and a common turn of all angles is followed exactly. A is in modal form: real modes first, then the
first coordinates of all pairs, then their second ones.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gridfold.dynamics.layout import Layout
from gridfold.dynamics.network.backend import CompiledNetwork
from gridfold.dynamics.rhs import (
    HEADER_SIZE,
    N_DERIVATIVE_CALLS,
    N_OUTPUT_CALLS,
    N_SIGNALS,
    N_SOURCE_CALLS,
    N_STATES,
    N_TERMINALS,
    add_source_currents,
    freeze,
    load_constants,
    pack_model,
    run_calls,
    solve_network,
)
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.numerics.checked_arrays import require_positions, require_shapes
from gridfold.numerics.compiled import compile_callback, compiled_part, matrix_view
from gridfold.numerics.elementary import angle, exponential, logarithm, sine_cosine
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs
from gridfold.numerics.unit_matrix import given_matrix, result_matrix, state_matrix

# The header goes on behind that of the detailed model.
(
    ORDER,
    LENGTH,
    N_PAIRS,
    N_PORTS,
    PORTS_AT,
    MIDDLE_AT,
    SLOPES_AT,
    AREA_AT,
    PORT_WORK_AT,
    AREA_WORK_AT,
    LANES,
    N_ANGLES,
    ANGLES_AT,
    ANGLE_REFERENCE_AT,
    N_MOVERS,
    MOVERS_AT,
    MOVER_REALS_AT,
) = range(HEADER_SIZE, HEADER_SIZE + 17)
_PORT_HEADER = HEADER_SIZE + 17
# Vector instructions leave no rest where rows are filled up to multiples of these.
_LANES, _ROW = 4, 16
# Rows of the work space. Groups of four ports: logarithm and angle of the current, cosine, sine,
# current (2) and later voltage (2), angle and logarithm of the voltage.
# Area: its coordinates, the other coordinate of each pair, z'.
_PORT_ROWS, _AREA_ROWS = 8, 3
_GROUP = _PORT_ROWS * _LANES


@dataclass(frozen=True)
class PowerInputs:
    """Mechanical powers that drive k machines of a linear area of order r, and their speeds.

    z' gets b (P - power), and the speeds are speed + c z.

    Parameters
    ----------
    units : tuple of UnitKey
        The machines.
    speed, power : ndarrays, shape (k,)
        At the operating point, in p.u.
    c, b : ndarrays, shapes (k, r) and (r, k)
        Slopes of the speeds, and what the powers do.
    """

    units: tuple[UnitKey, ...]
    speed: NDArray[np.float64]
    power: NDArray[np.float64]
    c: NDArray[np.float64]
    b: NDArray[np.float64]

    def __post_init__(self) -> None:
        k, r = len(self.units), len(self.b)
        shapes = {"speed": (k,), "power": (k,), "c": (k, r), "b": (r, k)}
        require_shapes("the prime movers of a linear area", self, shapes)

    @property
    def reals(self) -> NDArray[np.float64]:
        """All numbers in the order in which the compiled function reads them."""
        return np.concatenate([self.speed, self.power, self.c.ravel(), self.b.T.ravel()])


@dataclass(frozen=True)
class LinearPorts:
    """A linear area of order r as its p ports know it.

    Parameters
    ----------
    diagonal, coupling : ndarrays, shapes (r,) and (n_pairs,)
        Real part of each mode; imaginary part of each pair, whose two coordinates are the k-th and
        the (k + n_pairs)-th behind the real modes.
    b : ndarray, shape (r, 2 p)
        Input matrix.
    offset : ndarray, shape (r,)
        Constant part of z'.
    c : ndarray, shape (2 p, r)
        Slopes of logarithm, then of angle, of the port currents.
    current : ndarray of complex, shape (p,)
        J0 in p.u.
    voltage : ndarray of complex, shape (p,)
        Port voltages at the operating point in p.u.
    turned : ndarray, shape (2 p,)
        By how much logarithm and angle of J are off after a common turn of all angles by 1 rad: 0 but
        for loads that are linear in a turning frame.
    movers : PowerInputs or None
        Machines of the area whose prime movers are not linear.
    """

    diagonal: NDArray[np.float64]
    coupling: NDArray[np.float64]
    b: NDArray[np.float64]
    offset: NDArray[np.float64]
    c: NDArray[np.float64]
    current: NDArray[np.complex128]
    voltage: NDArray[np.complex128]
    turned: NDArray[np.float64]
    movers: PowerInputs | None = None

    def __post_init__(self) -> None:
        r, p = len(self.diagonal), len(self.current)
        shapes = {"b": (r, 2 * p), "offset": (r,), "c": (2 * p, r), "voltage": (p,)}
        shapes |= {"turned": (2 * p,)}
        require_shapes("a linear area behind ports", self, shapes)
        movers = 0 if self.movers is None else len(self.movers.units)
        if self.movers is not None:
            require_shapes("its prime movers", self.movers, {"c": (movers, r)})
        if 2 * len(self.coupling) > r:
            raise OptionError(f"{len(self.coupling)} pairs of modes in an area of order {r}")

    @property
    def order(self) -> int:
        """Number of coordinates."""
        return len(self.diagonal)

    @property
    def middle(self) -> NDArray[np.float64]:
        """For each port ln |J0|, arg J0, the phasor J0 / V0 without its size, and `turned`: (p, 6)."""
        with np.errstate(divide="ignore"):
            size = np.log(np.abs(self.current))
        turn = np.angle(self.current)
        phasor = np.exp(1j * (turn - np.angle(self.voltage)))
        turned = self.turned.reshape(2, -1)
        return np.stack([size, turn, phasor.real, phasor.imag, *turned], axis=1)

    @property
    def slopes(self) -> NDArray[np.float64]:
        """C, both rows of each port after each other, filled up."""
        return _filled(self.c[_by_port(len(self.current))])

    @property
    def rows(self) -> NDArray[np.float64]:
        """Rows of diagonal, coupling, offset, then the columns of B port by port, filled up.

        The compiled function takes angles against those of the currents J0, and the logarithms of
        the voltages themselves; the offset knows it.
        """
        n_ports = len(self.current)
        coupling = np.zeros(self.order)
        coupling[self.order - 2 * len(self.coupling) :] = *self.coupling, *-self.coupling
        zero = np.concatenate([np.angle(self.current), np.log(np.abs(self.voltage))])
        columns = np.zeros((max(2 * (n_ports + n_ports % 2), 4), self.order))
        columns[: 2 * n_ports] = self.b.T[_by_port(n_ports)]
        return _filled(np.stack([self.diagonal, coupling, self.offset - self.b @ zero, *columns]))


def _by_port(n_ports: int) -> NDArray[np.int64]:
    """Positions of first and second quantity of each port."""
    return np.arange(2 * n_ports).reshape(2, n_ports).T.ravel()


def _up(size: int, step: int) -> int:
    """The next multiple of `step`."""
    return -(-size // step) * step


def _filled(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows filled up with zeros."""
    return np.pad(rows, ((0, 0), (0, _up(rows.shape[1], _ROW) - rows.shape[1])))


def pack_port_rhs(
    layout: Layout,
    constants: NDArray[np.float64],
    network: CompiledNetwork,
    ports: NDArray[np.int64],
    area: LinearPorts,
    angles: tuple[ArrayLike, ArrayLike] = ((), ()),
    units_out: Collection[UnitKey] = (),
) -> CompiledRhs:
    """Right-hand side of the exact units in `layout` with a linear area at the terminals `ports`.

    With `angles`, positions of rotor angles in the state and their values at the operating point, the
    network is taken in a frame that turns with their mean.
    """
    require_shapes("the ports of a linear area", area, {"current": (len(ports),)})
    require_positions("ports of a linear area", ports, len(layout.terminals))
    require_positions("rotor angles", np.asarray(angles[0]), layout.n_states)
    data = pack_model(layout, constants, network, layout.blocks, units_out, _PORT_HEADER)
    header = data.header
    length = _up(area.order, _ROW)
    header[[ORDER, LENGTH, N_PAIRS]] = area.order, length, len(area.coupling)
    header[[N_PORTS, PORTS_AT]] = len(ports), data.integers.add(ports)
    header[MIDDLE_AT] = data.reals.add(area.middle)
    header[[SLOPES_AT, AREA_AT]] = data.reals.add(area.slopes), data.reals.add(area.rows)
    header[LANES] = _LANES  # read while running: a loop of known length would be unrolled instead
    header[PORT_WORK_AT] = data.work_size
    header[AREA_WORK_AT] = data.work_size + max(_up(len(ports), _LANES), _LANES) * _PORT_ROWS
    header[[N_ANGLES, ANGLES_AT]] = np.size(angles[0]), data.integers.add(angles[0])
    header[ANGLE_REFERENCE_AT] = data.reals.add(angles[1])
    if area.movers is not None:
        header[N_MOVERS] = len(area.movers.units)
        header[MOVERS_AT] = data.integers.add(mover_slots(layout, area.movers.units))
        header[MOVER_REALS_AT] = data.reals.add(area.movers.reals)
    return CompiledRhs(
        address=_compiled().address,
        integers=np.concatenate([header, data.integers.join()]),
        reals=data.reals.join(),
        work_size=int(header[AREA_WORK_AT]) + _AREA_ROWS * length,
        n_states=layout.n_states + area.order,
    )


def inputs_along(
    area: LinearPorts, compiled: CompiledRhs, states: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What drives the linear area in states of the model, less what it is at the operating point.

    Parameters
    ----------
    area : LinearPorts
        The area.
    compiled : CompiledRhs
        From :func:`pack_port_rhs`.
    states : ndarray, shape (n_times, n)
        States v.

    Returns
    -------
    ndarray, shape (n_times, 2 p + k)
        Angles (rad), then logarithms of the port voltages; powers of the prime movers in p.u.
    """
    header, ports = compiled.integers, np.arange(len(area.current))
    rows = header[PORT_WORK_AT] + ports // _LANES * _GROUP + ports % _LANES
    places, usual = [rows + 6 * _LANES, rows + 7 * _LANES], [np.angle(area.current)]
    usual.append(np.log(np.abs(area.voltage)))
    if area.movers is not None:
        count = len(area.movers.units)
        places.append(header[header[MOVERS_AT] + count :][:count])
        usual.append(area.movers.power)
    found = compiled.work_along(states, np.concatenate(places))
    return np.asarray(found - np.concatenate(usual))


def mover_slots(layout: Layout, units: Collection[UnitKey]) -> list[int]:
    """Where the speeds, then the mechanical powers of `units` stand among the signals."""
    names = ("speed", "mechanical_power")
    return [layout.signal_slots[unit, name] for name in names for unit in units]


@compiled_part
def _give_speeds(integers, reals, work, z):
    """Speeds of linear machines for prime movers that are not linear."""
    count, order, at = integers[N_MOVERS], integers[ORDER], integers[MOVER_REALS_AT]
    for m in range(count):
        total = reals[at + m]
        row = at + 2 * count + m * order
        for k in range(order):
            total += reals[row + k] * z[k]
        work[integers[integers[MOVERS_AT] + m]] = total


@compiled_part
def _add_powers(integers, reals, work, dz):
    """What the powers of these prime movers do to the linear area."""
    count, order, at = integers[N_MOVERS], integers[ORDER], integers[MOVER_REALS_AT]
    for m in range(count):
        power = work[integers[integers[MOVERS_AT] + count + m]] - reals[at + count + m]
        column = at + (2 + order) * count + m * order
        for k in range(order):
            dz[k] += reals[column + k] * power


@compiled_part
def _frame_angle(integers, reals, v):
    """Mean deviation of the rotor angles with which the network's frame turns; 0 if it does not."""
    total, count = 0.0, integers[N_ANGLES]
    for k in range(count):
        angle = v[integers[integers[ANGLES_AT] + k]]
        total += (angle - reals[integers[ANGLE_REFERENCE_AT] + k]) / count
    return total


@compiled_part
def _turn(pairs, n, by):
    """Turn n phasors, real parts before imaginary parts."""
    c, s = np.cos(by), np.sin(by)
    for t in range(n):
        real, imag = pairs[t], pairs[n + t]
        pairs[t] = c * real - s * imag
        pairs[n + t] = c * imag + s * real


@compiled_part
def _solve_in_frame(integers, reals, work, by):
    """Solve the network in a frame that is turned by `by` (rad)."""
    n, at = integers[N_TERMINALS], integers[N_SIGNALS]
    _turn(work[at : at + 2 * n], n, -by)
    _turn(work[at - 2 * n : at], n, -by)
    solve_network(integers, reals, work)
    _turn(work[at - 2 * n : at], n, by)


@compiled_part
def _find_port_currents(integers, reals, work, z, frame):
    """Logarithms and angles of the port currents; then the currents and their phasors."""
    n_ports, length = integers[N_PORTS], integers[LENGTH]
    states = matrix_view(work, integers[AREA_WORK_AT], _AREA_ROWS, length)
    for k in range(integers[ORDER]):
        states[0, k] = z[k]
    middle = matrix_view(reals, integers[MIDDLE_AT], n_ports, 6)
    slopes = matrix_view(reals, integers[SLOPES_AT], 2 * n_ports, length)
    for p in range(n_ports):
        size = middle[p, 0] - frame * middle[p, 4]
        turn = middle[p, 1] - frame * middle[p, 5]
        for k in range(length):
            size += slopes[2 * p, k] * states[0, k]
            turn += slopes[2 * p + 1, k] * states[0, k]
        rows = matrix_view(work, integers[PORT_WORK_AT] + p // _LANES * _GROUP, _PORT_ROWS, _LANES)
        rows[0, p % _LANES], rows[1, p % _LANES] = size, turn
    for p in range(0, n_ports, _LANES):
        _exponentiate(
            matrix_view(work, integers[PORT_WORK_AT] + p // _LANES * _GROUP, _PORT_ROWS, _LANES),
            integers[LANES],
        )


@compiled_part
def _exponentiate(rows, lanes):
    """Currents and their phasors from logarithms and angles."""
    for p in range(lanes):
        size, (s, c) = exponential(rows[0, p]), sine_cosine(rows[1, p])
        rows[2, p], rows[3, p] = c, s
        rows[4, p], rows[5, p] = size * c, size * s


@compiled_part
def _add_port_currents(integers, work):
    """Add the currents of the linear area at its terminals."""
    n_terminals, ports_at = integers[N_TERMINALS], integers[PORTS_AT]
    currents = matrix_view(work, integers[N_SIGNALS], 2, n_terminals)
    for p in range(integers[N_PORTS]):
        terminal = integers[ports_at + p]
        rows = matrix_view(work, integers[PORT_WORK_AT] + p // _LANES * _GROUP, _PORT_ROWS, _LANES)
        currents[0, terminal] += rows[4, p % _LANES]
        currents[1, terminal] += rows[5, p % _LANES]


@compiled_part
def _find_inputs(integers, reals, work):
    """Angles and logarithms of the port voltages.

    An angle is taken within half a turn of that of the port's own current.
    """
    n_ports, n_terminals = integers[N_PORTS], integers[N_TERMINALS]
    voltages = matrix_view(work, integers[N_SIGNALS] - 2 * n_terminals, 2, n_terminals)
    middle = matrix_view(reals, integers[MIDDLE_AT], n_ports, 6)
    for p in range(n_ports):
        terminal = integers[integers[PORTS_AT] + p]
        v_r, v_i = voltages[0, terminal], voltages[1, terminal]
        w_r, w_i = middle[p, 2], middle[p, 3]
        rows = matrix_view(work, integers[PORT_WORK_AT] + p // _LANES * _GROUP, _PORT_ROWS, _LANES)
        rows[4, p % _LANES], rows[5, p % _LANES] = v_r * w_r - v_i * w_i, v_r * w_i + v_i * w_r
    for p in range(n_ports, -(-n_ports // _LANES) * _LANES):
        rows = matrix_view(work, integers[PORT_WORK_AT] + p // _LANES * _GROUP, _PORT_ROWS, _LANES)
        rows[4, p % _LANES] = 1.0
    for p in range(0, n_ports, _LANES):
        _take_logarithms(
            matrix_view(work, integers[PORT_WORK_AT] + p // _LANES * _GROUP, _PORT_ROWS, _LANES),
            integers[LANES],
        )


@compiled_part
def _take_logarithms(rows, lanes):
    """Angles and logarithms of voltages, which stand where the currents were."""
    for p in range(lanes):
        c, s, v_r, v_i = rows[2, p], rows[3, p], rows[4, p], rows[5, p]
        rows[6, p] = rows[1, p] + angle(v_i * c - v_r * s, v_r * c + v_i * s)
        rows[7, p] = 0.5 * logarithm(v_r * v_r + v_i * v_i)


@compiled_part
def _move_area(integers, reals, work, dz):
    """Set z' from the inputs, two ports at a time."""
    order, length, n_pairs = integers[ORDER], integers[LENGTH], integers[N_PAIRS]
    pairs = work[integers[AREA_WORK_AT] + order - 2 * n_pairs :]
    seconds, of_firsts, of_seconds = pairs[n_pairs:], pairs[length:], pairs[length + n_pairs :]
    for k in range(n_pairs):
        of_firsts[k] = seconds[k]
    for k in range(n_pairs):
        of_seconds[k] = pairs[k]
    states = state_matrix(work, integers[AREA_WORK_AT], 2, length)
    rates = result_matrix(work, integers[AREA_WORK_AT] + 2 * length, 1, length)
    m = given_matrix(reals, integers[AREA_AT], 7, length)
    rows = matrix_view(work, integers[PORT_WORK_AT], _PORT_ROWS, _LANES)
    u_0, u_1, u_2, u_3 = rows[6, 0], rows[7, 0], rows[6, 1], rows[7, 1]
    for k in range(length):
        own = m[0, k] * states[0, k] + m[1, k] * states[1, k] + m[2, k]
        rates[0, k] = own + m[3, k] * u_0 + m[4, k] * u_1 + m[5, k] * u_2 + m[6, k] * u_3
    for p in range(2, integers[N_PORTS], 2):
        q = p % _LANES
        rows = matrix_view(work, integers[PORT_WORK_AT] + p // _LANES * _GROUP, _PORT_ROWS, _LANES)
        b = given_matrix(reals, integers[AREA_AT] + (3 + 2 * p) * length, 4, length)
        u_0, u_1, u_2, u_3 = rows[6, q], rows[7, q], rows[6, q + 1], rows[7, q + 1]
        for k in range(length):
            rates[0, k] += b[0, k] * u_0 + b[1, k] * u_1 + b[2, k] * u_2 + b[3, k] * u_3
    for k in range(order):
        dz[k] = rates[0, k]


def _port_rhs(integers, reals, work, v, dv):
    n = integers[N_STATES]
    for i in range(n):
        work[i] = v[i]
    load_constants(integers, reals, work)
    _give_speeds(integers, reals, work, v[n:])
    n_source, n_output = integers[N_SOURCE_CALLS], integers[N_OUTPUT_CALLS]
    run_calls(0, n_source, integers, reals, work, v, dv)
    add_source_currents(integers, work)
    frame = _frame_angle(integers, reals, v)
    _find_port_currents(integers, reals, work, v[n:], frame)
    _add_port_currents(integers, work)
    if integers[N_ANGLES] > 0:
        _solve_in_frame(integers, reals, work, frame)
    else:
        solve_network(integers, reals, work)
    run_calls(n_source, n_output, integers, reals, work, v, dv)
    run_calls(n_source + n_output, integers[N_DERIVATIVE_CALLS], integers, reals, work, v, dv)
    freeze(integers, dv)
    _find_inputs(integers, reals, work)
    _move_area(integers, reals, work, dv[n:])
    _add_powers(integers, reals, work, dv[n:])


@cache
def _compiled() -> Any:
    return compile_callback(_port_rhs, RHS_SIGNATURE)
