"""What rounding alone may leave of a balance of currents or of power."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

_MARGIN = 100


def rounding_current(admittance: csc_array, voltage: NDArray[np.complex128]) -> NDArray[np.float64]:
    """``100 eps (|Y| |V|)_i``: currents that no voltages in double precision undercut.

    Parameters
    ----------
    admittance : csc_array, shape (n_buses, n_buses)
        Bus admittances in per unit.
    voltage : ndarray of complex, shape (n_buses,)
        Bus voltages in per unit.

    Returns
    -------
    ndarray, shape (n_buses,)
        Currents in per unit.
    """
    return np.asarray(_MARGIN * np.finfo(float).eps * (abs(admittance) @ np.abs(voltage)))


def rounding_power(admittance: csc_array, voltage: NDArray[np.complex128]) -> NDArray[np.float64]:
    """The power of :func:`rounding_current` at each bus, (n_buses,), per unit on the system base."""
    return np.asarray(rounding_current(admittance, voltage) * np.abs(voltage))
