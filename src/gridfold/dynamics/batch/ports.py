"""The compiled right-hand side of many runs of one model with a linear area behind ports.

It is that of :mod:`gridfold.dynamics.port_rhs`, v = (exact states, z), for runs that stand side by side
as in :mod:`gridfold.dynamics.batch.rhs`: entry `s` of member `b` at ``s * members + b``. All are on one
network, and loads are impedances. What the modes do is then a product of a matrix with r x members.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gridfold.dynamics.batch.factors import (
    ROW,
    column_factors,
    put_currents,
    solve_group,
    take_voltages,
)
from gridfold.dynamics.batch.rhs import batch_form, side_by_side
from gridfold.dynamics.network.backend import CompiledNetwork
from gridfold.dynamics.port_model import PortParts
from gridfold.dynamics.port_rhs import mover_slots
from gridfold.dynamics.rhs import (
    HEADER_SIZE,
    N_DERIVATIVE_CALLS,
    N_OUTPUT_CALLS,
    N_SIGNALS,
    N_SOURCE_CALLS,
    N_STATES,
    N_TERMINALS,
    SCRATCH_AT,
    load_constants,
    pack_model,
    run_calls,
)
from gridfold.numerics.compiled import compile_callback, compiled_part
from gridfold.numerics.elementary import angle, exponential, logarithm, sine_cosine
from gridfold.numerics.lanes import WIDTH, aligned, all_lanes, load_lanes, store_lanes
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

# The header goes on behind that of the detailed model.
(
    MEMBERS,
    N_MACHINES,
    MACHINES_AT,
    FACTORS_AT,
    FACTOR_REALS_AT,
    ORDER,
    N_PAIRS,
    N_PORTS,
    PORTS_AT,
    MIDDLE_AT,
    SLOPES_AT,
    MODES_AT,
    DRIVES_AT,
    PORT_WORK_AT,
    N_MOVERS,
    MOVERS_AT,
    MOVER_REALS_AT,
) = range(HEADER_SIZE, HEADER_SIZE + 17)
_SIZE = HEADER_SIZE + 17
# Work space: blocks of ports x members. Logarithm and angle of the current; its phasor; the current,
# later the voltage; angle and logarithm of the voltage.
_LOG, _TURN, _COS, _SIN, _REAL, _IMAGINARY, _INPUTS = range(7)
_BLOCKS = 8


def batch_ports(parts: PortParts, members: int) -> CompiledRhs:
    """For states of shape (n, members), flattened; `members` is a multiple of eight."""
    layout, area = parts.layout, parts.area
    wide, equations = side_by_side(layout, members), parts.equations
    factors = column_factors(equations, every_bus=False)
    none = CompiledNetwork(0, np.zeros(0, dtype=np.int64), np.zeros(0), factors.n_rows * ROW)
    constants = np.repeat(parts.constants, members)
    compiled_of = batch_form(layout)
    data = pack_model(wide, constants, none, wide.blocks, header_size=_SIZE, compiled=compiled_of)
    header, integers, reals = data.header, data.integers, data.reals
    order, n_ports = area.order, len(area.current)
    header[MEMBERS] = members
    header[[N_MACHINES, MACHINES_AT]] = len(layout.sources), integers.add(layout.sources)
    header[FACTORS_AT] = integers.add(factors.integers)
    header[FACTOR_REALS_AT] = reals.add(factors.values(equations))
    header[[ORDER, N_PAIRS]] = order, len(area.coupling)
    header[[N_PORTS, PORTS_AT]] = n_ports, integers.add(parts.ports)
    header[MIDDLE_AT], header[SLOPES_AT] = reals.add(area.middle[:, :4]), reals.add(area.c)
    header[MODES_AT], header[DRIVES_AT] = reals.add(area.rows[:3, :order]), reals.add(area.b)
    header[PORT_WORK_AT] = data.work_size
    if area.movers is not None:
        header[N_MOVERS] = len(area.movers.units)
        header[MOVERS_AT] = integers.add(mover_slots(layout, area.movers.units))
        header[MOVER_REALS_AT] = reals.add(area.movers.reals)
    return CompiledRhs(
        _compiled().address,
        np.concatenate([header, integers.join()]),
        aligned(reals.join()),
        data.work_size + _BLOCKS * n_ports * members,
        (layout.n_states + order) * members,
    )


@compiled_part
def _give_speeds(integers, reals, work, z):
    """Speeds of linear machines for prime movers that are not linear."""
    members, count, order = integers[MEMBERS], integers[N_MOVERS], integers[ORDER]
    slots, values = integers[integers[MOVERS_AT] :], reals[integers[MOVER_REALS_AT] :]
    for m in range(count):
        for b in range(0, members, WIDTH):
            total = all_lanes(values[m])
            for k in range(order):
                total = total + values[2 * count + m * order + k] * load_lanes(z, k * members + b)
            store_lanes(work, slots[m] * members + b, total)


@compiled_part
def _add_powers(integers, reals, work, dz):
    """What the powers of these prime movers do to the linear area."""
    members, count, order = integers[MEMBERS], integers[N_MOVERS], integers[ORDER]
    slots, values = integers[integers[MOVERS_AT] :], reals[integers[MOVER_REALS_AT] :]
    for m in range(count):
        column = (2 + order) * count + m * order
        for b in range(0, members, WIDTH):
            at = slots[count + m] * members + b
            power = load_lanes(work, at) - all_lanes(values[count + m])
            for k in range(order):
                here = load_lanes(dz, k * members + b)
                store_lanes(dz, k * members + b, here + values[column + k] * power)


@compiled_part
def _find_port_currents(integers, reals, work, z):
    """Logarithms and angles of the port currents; then the currents and their phasors."""
    members, n_ports, order = integers[MEMBERS], integers[N_PORTS], integers[ORDER]
    size = n_ports * members
    ports = work[integers[PORT_WORK_AT] :]
    middle, slopes = reals[integers[MIDDLE_AT] :], reals[integers[SLOPES_AT] :]
    for b in range(0, members, WIDTH):
        for p in range(n_ports):
            log, turn = all_lanes(middle[4 * p]), all_lanes(middle[4 * p + 1])
            of_log, of_turn = p * order, (n_ports + p) * order
            for k in range(order):
                mode = load_lanes(z, k * members + b)
                log = log + slopes[of_log + k] * mode
                turn = turn + slopes[of_turn + k] * mode
            store_lanes(ports, _LOG * size + p * members + b, log)
            store_lanes(ports, _TURN * size + p * members + b, turn)
    cosines, sines = ports[_COS * size :], ports[_SIN * size :]
    reals_of, imaginaries = ports[_REAL * size :], ports[_IMAGINARY * size :]
    turns = ports[_TURN * size :]
    for i in range(size):
        magnitude, (s, c) = exponential(ports[i]), sine_cosine(turns[i])
        cosines[i], sines[i] = c, s
        reals_of[i], imaginaries[i] = magnitude * c, magnitude * s


@compiled_part
def _add_currents(integers, work):
    """Add up the currents of the exact machines and of the ports at the terminals."""
    members, n, n_ports = integers[MEMBERS], integers[N_TERMINALS], integers[N_PORTS]
    currents = work[integers[N_SIGNALS] :]
    for k in range(0, 2 * n, WIDTH):
        store_lanes(currents, k, all_lanes(0.0))
    machines = integers[integers[MACHINES_AT] :]
    for s in range(integers[N_MACHINES]):
        real, imaginary = machines[3 * s] * members, machines[3 * s + 1] * members
        _add_rows(
            work[real:], work[imaginary:], currents, machines[3 * s + 2] * members, n, members
        )
    ports = work[integers[PORT_WORK_AT] :]
    for p in range(n_ports):
        real, imaginary = (_REAL * n_ports + p) * members, (_IMAGINARY * n_ports + p) * members
        at = integers[integers[PORTS_AT] + p] * members
        _add_rows(ports[real:], ports[imaginary:], currents, at, n, members)


@compiled_part
def _add_rows(real, imaginary, currents, at, n, members):
    for b in range(0, members, WIDTH):
        here = load_lanes(currents, at + b)
        store_lanes(currents, at + b, here + load_lanes(real, b))
        here = load_lanes(currents, n + at + b)
        store_lanes(currents, n + at + b, here + load_lanes(imaginary, b))


@compiled_part
def _solve(integers, reals, work):
    members, n = integers[MEMBERS], integers[N_TERMINALS]
    currents = work[integers[N_SIGNALS] :]
    voltages = work[integers[N_SIGNALS] - 2 * n :]
    scratch = work[integers[SCRATCH_AT] :]
    factors, values = integers[integers[FACTORS_AT] :], reals[integers[FACTOR_REALS_AT] :]
    for first in range(0, members, WIDTH):
        put_currents(factors, currents, members, first, scratch)
        solve_group(factors, values, scratch)
        take_voltages(factors, scratch, members, first, voltages)


@compiled_part
def _find_inputs(integers, reals, work):
    """Angles and logarithms of the port voltages, angles within half a turn of the current's."""
    members, n, n_ports = integers[MEMBERS], integers[N_TERMINALS], integers[N_PORTS]
    size = n_ports * members
    voltages = work[integers[N_SIGNALS] - 2 * n :]
    ports = work[integers[PORT_WORK_AT] :]
    middle = reals[integers[MIDDLE_AT] :]
    reals_of, imaginaries = ports[_REAL * size :], ports[_IMAGINARY * size :]
    for p in range(n_ports):
        at = integers[integers[PORTS_AT] + p] * members
        w_r, w_i = middle[4 * p + 2], middle[4 * p + 3]
        for b in range(0, members, WIDTH):
            v_r, v_i = load_lanes(voltages, at + b), load_lanes(voltages, n + at + b)
            store_lanes(reals_of, p * members + b, v_r * w_r - v_i * w_i)
            store_lanes(imaginaries, p * members + b, v_r * w_i + v_i * w_r)
    cosines, sines, turns = ports[_COS * size :], ports[_SIN * size :], ports[_TURN * size :]
    angles, logarithms = ports[_INPUTS * size :], ports[(_INPUTS + 1) * size :]
    for i in range(size):
        c, s, v_r, v_i = cosines[i], sines[i], reals_of[i], imaginaries[i]
        angles[i] = turns[i] + angle(v_i * c - v_r * s, v_r * c + v_i * s)
        logarithms[i] = 0.5 * logarithm(v_r * v_r + v_i * v_i)


@compiled_part
def _move_area(integers, reals, work, z, dz):
    """Set z' from the modes and the inputs."""
    members, order, n_pairs = integers[MEMBERS], integers[ORDER], integers[N_PAIRS]
    n_ports = integers[N_PORTS]
    modes, drives = reals[integers[MODES_AT] :], reals[integers[DRIVES_AT] :]
    inputs = work[integers[PORT_WORK_AT] + _INPUTS * n_ports * members :]
    first_pair, second = order - 2 * n_pairs, order - n_pairs
    for b in range(0, members, WIDTH):
        for k in range(order):
            other = k if k < first_pair else (k + n_pairs if k < second else k - n_pairs)
            own = modes[k] * load_lanes(z, k * members + b) + all_lanes(modes[2 * order + k])
            own = own + modes[order + k] * load_lanes(z, other * members + b)
            by_logarithm, row = all_lanes(0.0), 2 * n_ports * k
            for p in range(n_ports):
                own = own + drives[row + p] * load_lanes(inputs, p * members + b)
                at = (n_ports + p) * members + b
                by_logarithm = by_logarithm + drives[row + n_ports + p] * load_lanes(inputs, at)
            store_lanes(dz, k * members + b, own + by_logarithm)


def _batch_ports(integers, reals, work, v, dv):
    n = integers[N_STATES]
    for i in range(0, n, WIDTH):
        store_lanes(work, i, load_lanes(v, i))
    z, dz = v[n:], dv[n:]
    load_constants(integers, reals, work)
    _give_speeds(integers, reals, work, z)
    n_source, n_output = integers[N_SOURCE_CALLS], integers[N_OUTPUT_CALLS]
    run_calls(0, n_source, integers, reals, work, v, dv)
    _find_port_currents(integers, reals, work, z)
    _add_currents(integers, work)
    _solve(integers, reals, work)
    run_calls(n_source, n_output, integers, reals, work, v, dv)
    run_calls(n_source + n_output, integers[N_DERIVATIVE_CALLS], integers, reals, work, v, dv)
    _find_inputs(integers, reals, work)
    _move_area(integers, reals, work, z, dz)
    _add_powers(integers, reals, work, dz)


@cache
def _compiled() -> Any:
    return compile_callback(_batch_ports, RHS_SIGNATURE)
