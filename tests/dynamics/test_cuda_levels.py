"""Factors in levels solve the network, and no row of a level waits for another one of it."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.cuda.levels import LevelFactors, level_factors


def solved(factors: LevelFactors, currents: np.ndarray) -> np.ndarray:
    """Voltages of the rows, level by level, each row from those of other levels alone."""
    v = currents.astype(complex)
    first, levels = factors.starts[-1], list(zip(factors.starts, factors.starts[1:], strict=False))
    for begin, end in levels:
        v[begin:end] -= (factors.lower @ v[:first])[begin:end]
    v[first:] = factors.tail_inverse @ (v[first:] - (factors.lower @ v[:first])[first:])
    for begin, end in reversed(levels):
        v[begin:end] = factors.inverse_diagonal[begin:end] * (
            v[begin:end] - (factors.upper @ v)[begin:end]
        )
    return v


@pytest.mark.parametrize("tail", [0, 1, 64, 999])
def test_levels_and_tail_solve_the_network(npcc: gf.DetailedModel, tail: int) -> None:
    equations = npcc.equations
    factors = level_factors(equations, tail)
    assert len(factors.tail_inverse) <= tail
    assert factors.vector_size == 2 * (len(equations.live) + len(factors.tail_inverse))
    rng = np.random.default_rng(1)
    currents = rng.standard_normal(len(equations.live)) + 1j * rng.standard_normal(
        len(equations.live)
    )
    rows = factors.rows[equations.live]
    injected = np.empty_like(currents)
    injected[rows] = currents
    right = equations.factors.solve(currents)
    np.testing.assert_allclose(solved(factors, injected)[rows], right, rtol=1e-11)
    np.testing.assert_array_equal(
        factors.terminal_rows, factors.rows[equations.live[equations.terminals]]
    )


def test_no_row_needs_another_one_of_its_level(npcc: gf.DetailedModel) -> None:
    factors = level_factors(npcc.equations, tail=4)
    level = np.searchsorted(factors.starts, np.arange(len(npcc.equations.live)), side="right")
    low, up = factors.lower.tocoo(), factors.upper.tocoo()
    assert len(factors.starts) > 10
    assert (level[low.coords[1]] < level[low.coords[0]]).all()
    assert (level[up.coords[1]] > level[up.coords[0]]).all()
