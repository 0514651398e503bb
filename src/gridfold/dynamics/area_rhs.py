"""The compiled right-hand side of a system of which one part is linear and may be reduced.

State v = (states of the nonlinear units, reduced coordinates z). Of the linear part only those states
are formed that somebody reads: what enters Norton currents, and all states of the corrected units.
The linear part moves by

    z' = A z + B du + c + T (f - F z - G du),

Here du are deviations of boundary voltages (angle, magnitude) or of states of the nonlinear units,
and the last term, over the rows of the corrected units, puts their nonlinear functions f back into
their places (equations (14)-(15) of Osipov & Sun, in correction form).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.layout import Block, Layout
from gridfold.dynamics.network.backend import CompiledNetwork
from gridfold.dynamics.rhs import (
    HEADER_SIZE,
    N_DERIVATIVE_CALLS,
    N_OUTPUT_CALLS,
    N_SIGNALS,
    N_SOURCE_CALLS,
    N_STATES,
    N_TERMINALS,
    freeze,
    load_constants,
    pack_model,
    run_calls,
    solve_voltages,
)
from gridfold.grid.case import UnitKey
from gridfold.numerics.checked_arrays import (
    require_partners,
    require_positions,
    require_shapes,
)
from gridfold.numerics.compiled import compile_callback, compiled_part, matrix_view
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

# The header goes on behind that of the detailed model.
(
    N_EXACT,
    EXACT_SLOTS_AT,
    ORDER,
    N_FORMED,
    FORMED_SLOTS_AT,
    FORMED_REFERENCE_AT,
    FORMED_MATRIX_AT,
    N_PORTS,
    PORTS_AT,
    N_INPUT_STATES,
    INPUT_SLOTS_AT,
    INPUT_REFERENCE_AT,
    N_ANGLES,
    ANGLE_SLOTS_AT,
    ANGLE_REFERENCE_AT,
    IS_MODAL,
    A_AT,
    PARTNERS_AT,
    B_AT,
    OFFSET_AT,
    N_CORRECTED,
    CORRECTED_SLOTS_AT,
    F_AT,
    G_AT,
    T_AT,
    DERIVATIVE_AT,
    DU_AT,
    CORRECTION_AT,
    N_HELD,
    HELD_AT,
) = range(HEADER_SIZE, HEADER_SIZE + 30)
_AREA_HEADER = HEADER_SIZE + 30


@dataclass(frozen=True)
class LinearPart:
    """The linear part of a system, in coordinates z of order r.

    Parameters
    ----------
    a : ndarray, shape (r, r), or (2, r) for a modal form
        The matrix, or its diagonal and the coupling of each coordinate to its partner.
    partners : ndarray of int, shape (r,), or None
        Partner of each coordinate of a modal form; None if `a` is a full matrix.
    b : ndarray, shape (r, n_inputs)
        Input matrix.
    offset : ndarray, shape (r,)
        Constant part of z'.
    formed : ndarray of int, shape (n_formed,)
        Positions in the state vector of the states that are formed.
    reference, lift : ndarrays, shapes (n_formed,) and (n_formed, r)
        They are ``reference + lift @ z``.
    input_reference : ndarray, shape (n_inputs,)
        Value of the inputs at the operating point: angles, magnitudes, then states.
    ports : ndarray of int
        Terminals whose voltages are inputs.
    input_states : ndarray of int
        Positions of the states that are inputs.
    corrected : ndarray of int, shape (n_corrected,)
        Positions of the states whose functions stay nonlinear.
    f, g, t : ndarrays, shapes (n_corrected, r), (n_corrected, n_inputs), (r, n_corrected)
        Linear part of these functions, and where they act.
    """

    a: NDArray[np.float64]
    partners: NDArray[np.int64] | None
    b: NDArray[np.float64]
    offset: NDArray[np.float64]
    formed: NDArray[np.int64]
    reference: NDArray[np.float64]
    lift: NDArray[np.float64]
    input_reference: NDArray[np.float64]
    ports: NDArray[np.int64]
    input_states: NDArray[np.int64]
    corrected: NDArray[np.int64]
    f: NDArray[np.float64]
    g: NDArray[np.float64]
    t: NDArray[np.float64]

    def __post_init__(self) -> None:
        r, k, c = len(self.b), len(self.formed), len(self.corrected)
        m = 2 * len(self.ports) + len(self.input_states)
        a = (r, r) if self.partners is None else (2, r)
        shapes = {"a": a, "b": (r, m), "offset": (r,), "reference": (k,), "lift": (k, r)}
        shapes |= {"input_reference": (m,), "f": (c, r), "g": (c, m), "t": (r, c)}
        require_shapes("the linear part of an area model", self, shapes)
        if self.partners is not None:
            require_partners("partners in an area model", self.partners, r)

    @property
    def order(self) -> int:
        """Number of coordinates."""
        return len(self.b)


def pack_area_rhs(
    layout: Layout,
    constants: NDArray[np.float64],
    network: CompiledNetwork,
    active: Sequence[Block],
    exact: NDArray[np.int64],
    angles: tuple[NDArray[np.int64], NDArray[np.float64]],
    linear: LinearPart,
    units_out: Collection[UnitKey] = (),
    held: NDArray[np.int64] | None = None,
) -> CompiledRhs:
    """Right-hand side of a model whose `active` blocks are evaluated and the rest is `linear`.

    Parameters
    ----------
    layout, constants, network
        The model with its blocks divided by area, and its network.
    active : sequence of Block
        Blocks of the nonlinear and of the corrected units.
    exact : ndarray of int
        Positions of the states of the nonlinear units: the first entries of v.
    angles : tuple of ndarrays
        Rotor angles of nonlinear units (positions and values at the operating point); boundary
        angles are taken within half a turn of their mean deviation.
    linear : LinearPart
        The linear part.
    units_out : collection of UnitKey
        Units that are disconnected.
    held : ndarray of int, shape (n_held, 3), optional
        Terminals whose voltage is held during a step, and where in v its real and imaginary part
        are kept.
    """
    for places in (exact, linear.formed, linear.corrected, linear.input_states, angles[0]):
        require_positions("states of an area model", places, layout.n_states)
    require_positions("ports of an area model", linear.ports, len(layout.terminals))
    data = pack_model(layout, constants, network, active, units_out, _AREA_HEADER)
    header, integers, reals = data.header, data.integers, data.reals
    header[[N_EXACT, EXACT_SLOTS_AT]] = len(exact), integers.add(exact)
    header[ORDER] = linear.order
    header[[N_FORMED, FORMED_SLOTS_AT]] = len(linear.formed), integers.add(linear.formed)
    header[[FORMED_REFERENCE_AT, FORMED_MATRIX_AT]] = (
        reals.add(linear.reference),
        reals.add(linear.lift),
    )
    header[[N_PORTS, PORTS_AT]] = len(linear.ports), integers.add(linear.ports)
    header[[N_INPUT_STATES, INPUT_SLOTS_AT]] = (
        len(linear.input_states), integers.add(linear.input_states),
    )  # fmt: skip
    header[INPUT_REFERENCE_AT] = reals.add(linear.input_reference)
    header[[N_ANGLES, ANGLE_SLOTS_AT]] = len(angles[0]), integers.add(angles[0])
    header[ANGLE_REFERENCE_AT] = reals.add(angles[1])
    header[[IS_MODAL, A_AT]] = linear.partners is not None, reals.add(linear.a)
    header[PARTNERS_AT] = integers.add([] if linear.partners is None else linear.partners)
    header[[B_AT, OFFSET_AT]] = reals.add(linear.b), reals.add(linear.offset)
    header[[N_CORRECTED, CORRECTED_SLOTS_AT]] = (
        len(linear.corrected), integers.add(linear.corrected),
    )  # fmt: skip
    header[[F_AT, G_AT, T_AT]] = reals.add(linear.f), reals.add(linear.g), reals.add(linear.t)
    held = np.zeros((0, 3), dtype=np.int64) if held is None else held
    header[[N_HELD, HELD_AT]] = len(held), integers.add(held)
    header[DERIVATIVE_AT] = data.work_size
    header[DU_AT] = data.work_size + layout.n_states
    header[CORRECTION_AT] = header[DU_AT] + len(linear.input_reference)
    return CompiledRhs(
        address=_compiled().address,
        integers=np.concatenate([header, integers.join()]),
        reals=reals.join(),
        work_size=int(header[CORRECTION_AT]) + len(linear.corrected),
        n_states=len(exact) + linear.order,
        after_step=_compiled_hold().address if len(held) else 0,
    )


@compiled_part
def _add_product(matrix, vector, result):
    """Result += matrix @ vector."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * vector[j]
        result[i] += total


@compiled_part
def _form_states(integers, reals, work, v):
    """Put the exact states and those formed from z into the signal vector."""
    n_exact, n_formed, order = integers[N_EXACT], integers[N_FORMED], integers[ORDER]
    for k in range(n_exact):
        work[integers[integers[EXACT_SLOTS_AT] + k]] = v[k]
    lift = matrix_view(reals, integers[FORMED_MATRIX_AT], n_formed, order)
    for k in range(n_formed):
        total = 0.0
        for j in range(order):
            total += lift[k, j] * v[n_exact + j]
        slot = integers[integers[FORMED_SLOTS_AT] + k]
        work[slot] = reals[integers[FORMED_REFERENCE_AT] + k] + total


@compiled_part
def _input_deviations(integers, reals, work, du):
    """Deviations of boundary angles, boundary magnitudes and input states."""
    turned = 0.0
    n_angles = integers[N_ANGLES]
    for k in range(n_angles):
        slot = integers[integers[ANGLE_SLOTS_AT] + k]
        turned += (work[slot] - reals[integers[ANGLE_REFERENCE_AT] + k]) / n_angles
    n_ports, n_terminals = integers[N_PORTS], integers[N_TERMINALS]
    voltages_at = integers[N_SIGNALS] - 2 * n_terminals
    reference = integers[INPUT_REFERENCE_AT]
    for k in range(n_ports):
        terminal = integers[integers[PORTS_AT] + k]
        v_r, v_i = work[voltages_at + terminal], work[voltages_at + n_terminals + terminal]
        swing = np.arctan2(v_i, v_r) - reals[reference + k]
        du[k] = swing + 2 * np.pi * np.round((turned - swing) / (2 * np.pi))
        du[n_ports + k] = np.sqrt(v_r * v_r + v_i * v_i) - reals[reference + n_ports + k]
    for k in range(integers[N_INPUT_STATES]):
        slot = integers[integers[INPUT_SLOTS_AT] + k]
        du[2 * n_ports + k] = work[slot] - reals[reference + 2 * n_ports + k]


@compiled_part
def _apply_a(integers, reals, z, dz):
    """Set dz = A z, by modes or by the full matrix."""
    order, at = integers[ORDER], integers[A_AT]
    if integers[IS_MODAL]:
        for k in range(order):
            partner = integers[integers[PARTNERS_AT] + k]
            dz[k] = reals[at + k] * z[k] + reals[at + order + k] * z[partner]
    else:
        for k in range(order):
            dz[k] = 0.0
        _add_product(matrix_view(reals, at, order, order), z, dz)


@compiled_part
def _voltages(integers, reals, work, v):
    """Put states, Norton currents and terminal voltages into the signal vector."""
    derivative = work[integers[DERIVATIVE_AT] : integers[DERIVATIVE_AT] + integers[N_STATES]]
    _form_states(integers, reals, work, v)
    load_constants(integers, reals, work)
    states = work[: integers[N_STATES]]
    run_calls(0, integers[N_SOURCE_CALLS], integers, reals, work, states, derivative)
    solve_voltages(integers, reals, work)


def _hold_boundary(integers, reals, work, v, dv):
    """Keep the boundary voltages at the end of a step for the next one."""
    _voltages(integers, reals, work, v)
    n_terminals = integers[N_TERMINALS]
    voltages_at = integers[N_SIGNALS] - 2 * n_terminals
    for k in range(integers[N_HELD]):
        at = integers[HELD_AT] + 3 * k
        terminal = integers[at]
        v[integers[at + 1]] = work[voltages_at + terminal]
        v[integers[at + 2]] = work[voltages_at + n_terminals + terminal]


def _area_rhs(integers, reals, work, v, dv):
    n_exact, order = integers[N_EXACT], integers[ORDER]
    z, dz = v[n_exact:], dv[n_exact:]
    derivative = work[integers[DERIVATIVE_AT] : integers[DERIVATIVE_AT] + integers[N_STATES]]
    _voltages(integers, reals, work, v)
    states = work[: integers[N_STATES]]
    n_source, n_output = integers[N_SOURCE_CALLS], integers[N_OUTPUT_CALLS]
    run_calls(n_source, n_output, integers, reals, work, states, derivative)
    n_derivative = integers[N_DERIVATIVE_CALLS]
    run_calls(n_source + n_output, n_derivative, integers, reals, work, states, derivative)
    freeze(integers, derivative)
    for k in range(n_exact):
        dv[k] = derivative[integers[integers[EXACT_SLOTS_AT] + k]]
    n_inputs = 2 * integers[N_PORTS] + integers[N_INPUT_STATES]
    du = work[integers[DU_AT] : integers[DU_AT] + n_inputs]
    _input_deviations(integers, reals, work, du)
    _apply_a(integers, reals, z, dz)
    _add_product(matrix_view(reals, integers[B_AT], order, n_inputs), du, dz)
    for k in range(order):
        dz[k] += reals[integers[OFFSET_AT] + k]
    n_corrected = integers[N_CORRECTED]
    if n_corrected > 0:
        correction = work[integers[CORRECTION_AT] : integers[CORRECTION_AT] + n_corrected]
        for k in range(n_corrected):
            correction[k] = 0.0
        _add_product(matrix_view(reals, integers[F_AT], n_corrected, order), z, correction)
        _add_product(matrix_view(reals, integers[G_AT], n_corrected, n_inputs), du, correction)
        for k in range(n_corrected):
            slot = integers[integers[CORRECTED_SLOTS_AT] + k]
            correction[k] = derivative[slot] - correction[k]
        _add_product(matrix_view(reals, integers[T_AT], order, n_corrected), correction, dz)


@cache
def _compiled() -> Any:
    return compile_callback(_area_rhs, RHS_SIGNATURE)


@cache
def _compiled_hold() -> Any:
    return compile_callback(_hold_boundary, RHS_SIGNATURE)
