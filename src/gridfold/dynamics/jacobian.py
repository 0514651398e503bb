"""The Jacobian of the detailed model: exact slopes of the units, and the network that joins them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from gridfold.dynamics.unit_partials import UnitPlaces, UnitSlopes


@dataclass(frozen=True)
class Partials:
    """Partial derivatives of the devices at one state; the network is left open.

    Parameters
    ----------
    states : sparse array, shape (n_states, n_states)
        d(derivatives)/d(states) at constant terminal voltages.
    voltages : sparse array, shape (n_states, 2 n_terminals)
        d(derivatives)/d(terminal voltages), real parts before imaginary parts.
    currents : sparse array, shape (2 n_terminals, n_states)
        d(Norton currents into the terminals)/d(states).
    """

    states: csr_array
    voltages: csr_array
    currents: csr_array

    def close(self, network: NDArray[np.float64]) -> NDArray[np.float64]:
        """Jacobian with the voltages that `network`, (2 n_terminals, 2 n_terminals), gives."""
        coupling = self.voltages @ (network @ self.currents.toarray())
        return np.asarray(self.states.toarray() + coupling)


def joined_partials(places: UnitPlaces, slopes: UnitSlopes, n_terminals: int) -> Partials:
    """The slopes of all units at their places in the whole system."""
    unit, row = places.unit, places.row
    n, each, both = len(unit), np.arange(len(unit))[:, None], np.arange(2)
    column = np.zeros((len(places.sizes), places.largest), dtype=np.int64)
    column[unit, row] = each[:, 0]
    terminal = places.terminal[unit][:, None] + n_terminals * both
    return Partials(
        _sparse(slopes.states[unit, row], each, column[unit], (n, n)),
        _sparse(slopes.voltages[unit, row], each, terminal, (n, 2 * n_terminals)),
        _sparse(slopes.currents[unit, :, row], terminal, each, (2 * n_terminals, n)),
    )


def _sparse(
    values: NDArray[np.float64],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    shape: tuple[int, int],
) -> csr_array:
    """Values at rows and columns, all of one shape or stretched to it; zeros are left out."""
    there = values != 0.0
    places = (np.broadcast_to(at, values.shape)[there] for at in (rows, columns))
    return coo_array((values[there], tuple(places)), shape=shape).tocsr()
