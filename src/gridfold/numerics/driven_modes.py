"""Linear modes under a load that is known at a few times: w' = L w + N w + g(t), g linear between them.

What a mode drives by the links N counts as a load, linear between the times, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.compiled import FAST, jit
from gridfold.numerics.modal_form import ModalForm

#: |L h| below which the quotients of exponentials are taken from their series.
_SERIES = 1e-3


def drive_modes(
    form: ModalForm,
    times: NDArray[np.float64],
    start: NDArray[np.float64],
    load: NDArray[np.float64],
) -> NDArray[np.float64]:
    """W at the times, without links exact for a load that is linear between them.

    Parameters
    ----------
    form : ModalForm
        L and N.
    times : ndarray, shape (n_times,)
        In seconds.
    start : ndarray, shape (n_modes,)
        W at the first time.
    load : ndarray, shape (n_times, n_modes)
        g.

    Raises
    ------
    OptionError
        An array has another shape.
    """
    shape = len(times), len(form.partner)
    for name, array, wanted in (("start", start, shape[1:]), ("load", load, shape)):
        if array.shape != wanted:
            raise OptionError(f"{name} has shape {array.shape}, expected {wanted}")
    result = np.empty(shape)
    result[0] = start
    steps, loaded = np.diff(times), np.ascontiguousarray(load)
    _drive(form.eigenvalues, form.partner, steps, loaded, result)
    for _ in range(form.links.depth):  # each turn follows one link more
        _drive(form.eigenvalues, form.partner, steps, loaded + form.links.drive(result), result)
    return result


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _drive(eigenvalues, partner, steps, load, result):
    factors = np.empty((3, len(eigenvalues)), dtype=np.complex128)
    known = -1.0
    for row in range(len(steps)):
        if abs(steps[row] - known) > 1e-9 * steps[row]:
            known = steps[row]
            _set_factors(eigenvalues, known, factors)
        for i in range(len(eigenvalues)):
            k = partner[i]
            rise, other = load[row + 1, i] - load[row, i], load[row + 1, k] - load[row, k]
            result[row + 1, i] = (
                _part(factors[0, i], result[row, i], result[row, k])
                + _part(factors[1, i], load[row, i], load[row, k])
                + _part(factors[2, i], rise, other)
            )


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _part(factor, own, partner):
    """A function of L times w; the eigenvalue alpha + j beta of w_i couples it to its partner."""
    return factor.real * own + factor.imag * partner


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _set_factors(eigenvalues, h, factors):
    """exp(z), h (exp(z) - 1) / z and h (exp(z) - 1 - z) / z^2 with z = L h, for each mode."""
    for i in range(len(eigenvalues)):
        z = eigenvalues[i] * h
        factors[0, i] = np.exp(z)
        if abs(z) < _SERIES:
            factors[1, i] = h * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))
            factors[2, i] = h / 2 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5)))
        else:
            factors[1, i] = h * (factors[0, i] - 1) / z
            factors[2, i] = h * (factors[0, i] - 1 - z) / (z * z)
