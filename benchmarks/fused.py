"""The floor: the nine-state model as one hand-written kernel.

It knows nothing but this one model: two-axis machine, type-1 exciter, first-order governor and
non-reheat turbine on every unit, equations (1) of Osipov & Sun, and the admittance matrix reduced to
the voltages E behind the transient reactances. N sine and cosine pairs, one complex matrix-vector
product in real arithmetic, one pass over the units; no table of devices, no signals, no gathering of
inputs. What the modular right-hand side takes longer than this is the price of its being modular.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold import DetailedModel
from gridfold.numerics.compiled import compile_callback, matrix_view
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs

STATES = (
    "rotor_angle", "speed", "d_transient_voltage", "q_transient_voltage",
    "regulator_voltage", "rate_feedback", "field_voltage", "governor_power", "mechanical_power",
)  # fmt: skip
DELTA, OMEGA, ED1, EQ1, VR, RF, EFD, PGV, PM = range(9)

PARAMETERS = (
    "inertia", "damping", "resistance", "d_reactance", "q_reactance", "d_transient_reactance",
    "d_open_circuit_time", "q_open_circuit_time", "base_speed",
    "regulator_gain", "regulator_time", "exciter_gain", "exciter_time", "feedback_gain",
    "feedback_time", "saturation_a", "saturation_b", "voltage_reference",
    "droop", "governor_time", "power_reference", "charging_time",
)  # fmt: skip
(
    H, D, RA, XD, XQ, XD1, TD0, TQ0, BASE_SPEED,
    KA, TA, KE, TE, KF, TF, AE, BE, VREF,
    R, TGV, PREF, TCH,
) = range(22)  # fmt: skip

# Rows of the scratch space.
SIN, COS, E_R, E_I, I_R, I_I = range(6)


def fuse(model: DetailedModel) -> CompiledRhs:
    """The fused right-hand side of `model`, over the same state vector.

    Raises
    ------
    ValueError
        The model is not made of nine-state units alone.
    """
    units = model.layout.blocks[0].units
    expected = tuple(f"{name}:{unit}" for name in STATES for unit in units)
    if model.state_names != expected or np.any(model.constants):
        raise ValueError("the fused kernel is for nine-state units alone")
    parameters = _parameters(model)
    admittance = _reduced_admittance(model, parameters[RA] + 1j * parameters[XD1])
    n = len(units)
    return CompiledRhs(
        address=_compiled().address,
        integers=np.array([n], dtype=np.int64),
        reals=np.concatenate([admittance.real, admittance.imag, parameters]).ravel(),
        work_size=6 * n,
        n_states=len(STATES) * n,
    )


def largest_difference(
    first: CompiledRhs, second: CompiledRhs, x0: NDArray[np.float64], count: int = 20
) -> float:
    """Largest difference of two right-hand sides at `count` states around `x0`."""
    random = np.random.default_rng(1)
    states = x0 + 0.05 * random.standard_normal((count, len(x0)))
    return max(float(np.abs(first(x) - second(x)).max()) for x in states)


def _parameters(model: DetailedModel) -> NDArray[np.float64]:
    rows = {
        name: row
        for block in model.layout.blocks
        for name, row in zip(block.device.parameter_rows, block.parameters, strict=True)
    }
    return np.array([rows[name] for name in PARAMETERS])


def _reduced_admittance(
    model: DetailedModel, stator: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Y in I = Y E, from the terminal impedances that hold the machines' own admittances."""
    terminal = model.layout.sources[:, 2]
    impedance = model.equations.terminal_impedance()[np.ix_(terminal, terminal)]
    return np.asarray(np.diag(1 / stator) - impedance / np.outer(stator, stator))


def _fused(integers, reals, work, x_flat, dx_flat):
    n = integers[0]
    y_r, y_i = matrix_view(reals, 0, n, n), matrix_view(reals, n * n, n, n)
    p = matrix_view(reals, 2 * n * n, 22, n)
    w = matrix_view(work, 0, 6, n)
    x, dx = matrix_view(x_flat, 0, 9, n), matrix_view(dx_flat, 0, 9, n)
    for k in range(n):
        s, c = np.sin(x[DELTA, k]), np.cos(x[DELTA, k])
        w[E_R, k] = x[ED1, k] * s + x[EQ1, k] * c
        w[E_I, k] = x[EQ1, k] * s - x[ED1, k] * c
        w[SIN, k], w[COS, k] = s, c
    for k in range(n):
        i_r = i_i = 0.0
        for j in range(n):
            i_r += y_r[k, j] * w[E_R, j] - y_i[k, j] * w[E_I, j]
            i_i += y_r[k, j] * w[E_I, j] + y_i[k, j] * w[E_R, j]
        w[I_R, k], w[I_I, k] = i_r, i_i
    for k in range(n):
        i_d = w[I_R, k] * w[SIN, k] - w[I_I, k] * w[COS, k]
        i_q = w[I_R, k] * w[COS, k] + w[I_I, k] * w[SIN, k]
        v_r = w[E_R, k] - p[RA, k] * w[I_R, k] + p[XD1, k] * w[I_I, k]
        v_i = w[E_I, k] - p[RA, k] * w[I_I, k] - p[XD1, k] * w[I_R, k]
        slip = x[OMEGA, k] - 1
        power = x[ED1, k] * i_d + x[EQ1, k] * i_q
        dx[DELTA, k] = p[BASE_SPEED, k] * slip
        dx[OMEGA, k] = (x[PM, k] - power - p[D, k] * slip) / (2 * p[H, k])
        dx[ED1, k] = (-x[ED1, k] + (p[XQ, k] - p[XD1, k]) * i_q) / p[TQ0, k]
        dx[EQ1, k] = (-x[EQ1, k] - (p[XD, k] - p[XD1, k]) * i_d + x[EFD, k]) / p[TD0, k]
        feedback = p[KF, k] / p[TF, k] * x[EFD, k]
        error = p[VREF, k] - np.sqrt(v_r * v_r + v_i * v_i)
        dx[VR, k] = (-x[VR, k] + p[KA, k] * (x[RF, k] - feedback + error)) / p[TA, k]
        dx[RF, k] = (-x[RF, k] + feedback) / p[TF, k]
        saturation = p[AE, k] * np.exp(p[BE, k] * x[EFD, k])
        dx[EFD, k] = (-(p[KE, k] + saturation) * x[EFD, k] + x[VR, k]) / p[TE, k]
        dx[PGV, k] = (-x[PGV, k] + p[PREF, k] - slip / p[R, k]) / p[TGV, k]
        dx[PM, k] = (-x[PM, k] + x[PGV, k]) / p[TCH, k]


@cache
def _compiled() -> Any:
    return compile_callback(_fused, RHS_SIGNATURE)
