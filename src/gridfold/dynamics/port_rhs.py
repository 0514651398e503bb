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

from collections.abc import Collection, Sequence
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
from gridfold.grid.case import UnitKey
from gridfold.numerics.compiled import compile_callback, compiled_part
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

# The header goes on behind that of the detailed model. Where the linear area's numbers stand follows
# from its sizes: see `LinearPorts.reals`.
(
    ORDER,
    N_PAIRS,
    N_PORTS,
    PORTS_AT,
    AREA_AT,
    PORT_WORK_AT,
    N_ANGLES,
    ANGLES_AT,
    ANGLE_REFERENCE_AT,
    N_MOVERS,
    MOVERS_AT,
    MOVER_REALS_AT,
) = range(HEADER_SIZE, HEADER_SIZE + 12)
_PORT_HEADER = HEADER_SIZE + 12


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

    @property
    def order(self) -> int:
        """Number of coordinates."""
        return len(self.diagonal)

    @property
    def reals(self) -> NDArray[np.float64]:
        """All numbers in the order in which the compiled function reads them."""
        inverse = 1 / self.voltage
        return np.concatenate(
            [
                self.current.real, self.current.imag, inverse.real, inverse.imag, self.turned,
                self.diagonal, self.offset, self.coupling, self.c.ravel(), self.b.T.ravel(),
            ]
        )  # fmt: skip


def pack_port_rhs(
    layout: Layout,
    constants: NDArray[np.float64],
    network: CompiledNetwork,
    ports: NDArray[np.int64],
    area: LinearPorts,
    angles: tuple[Sequence[int], ArrayLike] = ((), ()),
    units_out: Collection[UnitKey] = (),
) -> CompiledRhs:
    """Right-hand side of the exact units in `layout` with a linear area at the terminals `ports`.

    With `angles`, positions of rotor angles in the state and their values at the operating point, the
    network is taken in a frame that turns with their mean.
    """
    data = pack_model(layout, constants, network, layout.blocks, units_out, _PORT_HEADER)
    header = data.header
    header[[ORDER, N_PAIRS, N_PORTS]] = area.order, len(area.coupling), len(ports)
    header[[PORTS_AT, AREA_AT]] = data.integers.add(ports), data.reals.add(area.reals)
    header[PORT_WORK_AT] = data.work_size
    header[[N_ANGLES, ANGLES_AT]] = len(angles[0]), data.integers.add(angles[0])
    header[ANGLE_REFERENCE_AT] = data.reals.add(angles[1])
    if area.movers is not None:
        header[N_MOVERS] = len(area.movers.units)
        header[MOVERS_AT] = data.integers.add(_mover_slots(layout, area.movers.units))
        header[MOVER_REALS_AT] = data.reals.add(area.movers.reals)
    return CompiledRhs(
        address=_compiled().address,
        integers=np.concatenate([header, data.integers.join()]),
        reals=data.reals.join(),
        work_size=data.work_size + 4 * len(ports),
        n_states=layout.n_states + area.order,
    )


def _mover_slots(layout: Layout, units: Collection[UnitKey]) -> list[int]:
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
def _turn(pairs, n, angle):
    """Turn n phasors, real parts before imaginary parts."""
    c, s = np.cos(angle), np.sin(angle)
    for t in range(n):
        real, imag = pairs[t], pairs[n + t]
        pairs[t] = c * real - s * imag
        pairs[n + t] = c * imag + s * real


@compiled_part
def _solve_in_frame(integers, reals, work, angle):
    """Solve the network in a frame that is turned by `angle`."""
    n, at = integers[N_TERMINALS], integers[N_SIGNALS]
    _turn(work[at : at + 2 * n], n, -angle)
    _turn(work[at - 2 * n : at], n, -angle)
    solve_network(integers, reals, work)
    _turn(work[at - 2 * n : at], n, angle)


@compiled_part
def _add_port_currents(integers, reals, work, z, frame):
    """Add the currents of the linear area, and keep logarithm and phasor of their change."""
    order, n_ports, n_terminals = integers[ORDER], integers[N_PORTS], integers[N_TERMINALS]
    at = integers[AREA_AT]
    turned = at + 4 * n_ports
    slopes = at + 6 * n_ports + 2 * order + integers[N_PAIRS]
    kept = work[integers[PORT_WORK_AT] :]
    currents = work[integers[N_SIGNALS] : integers[N_SIGNALS] + 2 * n_terminals]
    for row in range(2 * n_ports):
        total = -frame * reals[turned + row]
        for k in range(order):
            total += reals[slopes + row * order + k] * z[k]
        kept[row] = total
    for p in range(n_ports):
        gain, turn = np.exp(kept[p]), kept[n_ports + p]
        c, s = np.cos(turn), np.sin(turn)
        kept[2 * n_ports + p], kept[3 * n_ports + p] = c, s
        j_r, j_i = gain * reals[at + p], gain * reals[at + n_ports + p]
        terminal = integers[integers[PORTS_AT] + p]
        currents[terminal] += c * j_r - s * j_i
        currents[n_terminals + terminal] += c * j_i + s * j_r


@compiled_part
def _port_inputs(integers, reals, work):
    """Deviations of angle and logarithm of the port voltages, into the kept places.

    An angle is taken within half a turn of that of the port's own current.
    """
    n_ports, n_terminals = integers[N_PORTS], integers[N_TERMINALS]
    at = integers[AREA_AT] + 2 * n_ports
    voltages_at = integers[N_SIGNALS] - 2 * n_terminals
    kept = work[integers[PORT_WORK_AT] :]
    for p in range(n_ports):
        terminal = integers[integers[PORTS_AT] + p]
        v_r, v_i = work[voltages_at + terminal], work[voltages_at + n_terminals + terminal]
        w_r, w_i = reals[at + p], reals[at + n_ports + p]
        d_r, d_i = v_r * w_r - v_i * w_i, v_r * w_i + v_i * w_r
        c, s = kept[2 * n_ports + p], kept[3 * n_ports + p]
        kept[p] = kept[n_ports + p] + np.arctan2(d_i * c - d_r * s, d_r * c + d_i * s)
        kept[n_ports + p] = 0.5 * np.log(d_r * d_r + d_i * d_i)


@compiled_part
def _move_area(integers, reals, work, z, dz):
    """Set z' from the inputs."""
    order, n_pairs, n_ports = integers[ORDER], integers[N_PAIRS], integers[N_PORTS]
    diagonal = integers[AREA_AT] + 6 * n_ports
    offset, coupling = diagonal + order, diagonal + 2 * order
    columns = coupling + n_pairs + 2 * n_ports * order
    du = work[integers[PORT_WORK_AT] :]
    for k in range(order):
        dz[k] = reals[diagonal + k] * z[k] + reals[offset + k]
    first = order - 2 * n_pairs
    for k in range(n_pairs):
        dz[first + k] += reals[coupling + k] * z[first + n_pairs + k]
    for k in range(n_pairs):
        dz[first + n_pairs + k] -= reals[coupling + k] * z[first + k]
    for j in range(2 * n_ports):
        u = du[j]
        for k in range(order):
            dz[k] += reals[columns + j * order + k] * u


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
    _add_port_currents(integers, reals, work, v[n:], frame)
    if integers[N_ANGLES] > 0:
        _solve_in_frame(integers, reals, work, frame)
    else:
        solve_network(integers, reals, work)
    run_calls(n_source, n_output, integers, reals, work, v, dv)
    run_calls(n_source + n_output, integers[N_DERIVATIVE_CALLS], integers, reals, work, v, dv)
    freeze(integers, dv)
    _port_inputs(integers, reals, work)
    _move_area(integers, reals, work, v[n:], dv[n:])
    _add_powers(integers, reals, work, dv[n:])


@cache
def _compiled() -> Any:
    return compile_callback(_port_rhs, RHS_SIGNATURE)
