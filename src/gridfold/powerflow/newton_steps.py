"""Newton's method on the power flow of one island."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
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
    slopes: _Slopes | None = None
    voltage = start.copy()
    for count in range(allowed):
        with np.errstate(over="ignore", invalid="ignore"):
            current = admittance @ voltage
            error = voltage * np.conj(current) - scheduled
            mismatch = np.concatenate((error.real[angles], error.imag[power_held]))
        if not np.isfinite(mismatch).all() or np.abs(mismatch).max(initial=0.0) <= tolerance:
            return voltage, count
        slopes = slopes or _Slopes.of(admittance, angles, power_held)
        try:
            step = splu(slopes.jacobian(voltage, current)).solve(-mismatch)
        except RuntimeError:  # exactly singular
            return voltage, count
        voltage[angles] *= np.exp(1j * step[: len(angles)])
        voltage[power_held] *= 1 + step[len(angles) :]
    return voltage, allowed


@dataclass(frozen=True)
class _Slopes:
    """Where the slopes of the powers in angles and logarithms of magnitudes stand in the Jacobian.

    The slopes of S_i are sums of terms S_ij = V_i conj(Y_ij V_j), one for each admittance, and of
    S_i itself: in the angles 1j (S_i - S_ij), in the logarithms S_i + S_ij. `terms` are their numbers,
    the S_i behind the S_ij, for each of four blocks: active power in angles and in logarithms, reactive
    power in both. `places` are where they are added up among the entries of the Jacobian.
    """

    admittance: csc_array
    columns: NDArray[np.int64]
    terms: tuple[NDArray[np.int64], ...]
    places: NDArray[np.int64]
    indices: NDArray[np.int32]
    pointers: NDArray[np.int32]

    @classmethod
    def of(
        cls, admittance: csc_array, angles: NDArray[np.int32], power_held: NDArray[np.int32]
    ) -> _Slopes:
        """Those of a network; unknowns and equations are the `angles`, then those of `power_held`."""
        n, size = admittance.shape[0], len(angles) + len(power_held)
        columns = np.repeat(np.arange(n), np.diff(admittance.indptr))
        row = np.concatenate([admittance.indices, np.arange(n)])
        column = np.concatenate([columns, np.arange(n)])
        by_angle, by_size = np.full((2, n), -1)
        by_angle[angles] = np.arange(len(angles))
        by_size[power_held] = np.arange(len(angles), size)
        blocks = [(rows, cols) for rows in (by_angle, by_size) for cols in (by_angle, by_size)]
        terms = tuple(
            np.flatnonzero((rows[row] >= 0) & (cols[column] >= 0)) for rows, cols in blocks
        )
        keys = [
            cols[column[term]] * size + rows[row[term]]
            for term, (rows, cols) in zip(terms, blocks, strict=True)
        ]
        found, places = np.unique(np.concatenate(keys), return_inverse=True)
        at_column, at_row = np.divmod(found, size)
        pointers = np.searchsorted(at_column, np.arange(size + 1))
        return cls(
            admittance, columns, terms, places, at_row.astype(np.int32), pointers.astype(np.int32)
        )

    def jacobian(
        self, voltage: NDArray[np.complex128], current: NDArray[np.complex128]
    ) -> csc_array:
        """The Jacobian at voltages and the currents that they cause."""
        matrix = self.admittance
        through = voltage[matrix.indices] * np.conj(matrix.data * voltage[self.columns])
        own = voltage * np.conj(current)
        by_angle = 1j * np.concatenate([-through, own])
        by_size = np.concatenate([through, own])
        parts = (by_angle.real, by_size.real, by_angle.imag, by_size.imag)
        values = [part[term] for part, term in zip(parts, self.terms, strict=True)]
        data = np.bincount(self.places, np.concatenate(values), len(self.indices))
        size = len(self.pointers) - 1
        return csc_array((data, self.indices, self.pointers), shape=(size, size))
