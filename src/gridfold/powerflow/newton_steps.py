"""Newton's method on the power flow of one island."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csc_array, diags_array
from scipy.sparse.linalg import splu


def newton_steps(
    admittance: csc_array,
    start: NDArray[np.complex128],
    scheduled: NDArray[np.complex128],
    slack: NDArray[np.int32],
    voltage_held: NDArray[np.int32],
    power_held: NDArray[np.int32],
    allowed: int,
    tolerance: float,
) -> tuple[NDArray[np.complex128], int]:
    """Newton's method in angles and logarithms of magnitudes, with sparse LU factors.

    Parameters
    ----------
    admittance : csc_array, shape (n, n)
        Bus admittances in per unit.
    start : ndarray, shape (n,)
        Voltages to start from, in per unit.
    scheduled : ndarray, shape (n,)
        Injections in per unit.
    slack, voltage_held, power_held : ndarray
        Positions of buses that hold voltage and angle, voltage and active power, and power.
    allowed : int
        Most iterations.
    tolerance : float
        Mismatch in per unit at which it ends.

    Returns
    -------
    voltage : ndarray, shape (n,)
        The last voltages, whether they solve it or not.
    iterations : int
        How many steps were taken.
    """
    angles = np.concatenate((voltage_held, power_held))
    voltage = start.copy()
    for count in range(allowed):
        with np.errstate(over="ignore", invalid="ignore"):
            current = admittance @ voltage
            error = voltage * np.conj(current) - scheduled
            mismatch = np.concatenate((error.real[angles], error.imag[power_held]))
        if not np.isfinite(mismatch).all() or np.abs(mismatch).max(initial=0.0) <= tolerance:
            return voltage, count
        through = diags_array(voltage) @ (admittance @ diags_array(voltage)).conj()
        own = diags_array(voltage * np.conj(current))
        by_angle, by_size = (1j * (own - through)).tocsc(), (own + through).tocsc()
        active = by_angle.real[angles][:, angles], by_size.real[angles][:, power_held]
        reactive = by_angle.imag[power_held][:, angles], by_size.imag[power_held][:, power_held]
        jacobian = block_array([active, reactive], format="csc")
        try:
            step = splu(jacobian).solve(-mismatch)
        except RuntimeError:  # exactly singular
            return voltage, count
        voltage[angles] *= np.exp(1j * step[: len(angles)])
        voltage[power_held] *= 1 + step[len(angles) :]
    return voltage, allowed
