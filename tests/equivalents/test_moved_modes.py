"""Swing modes of the study area, in the whole system and in reduced models of it."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.moved_modes import ComparedMode, compared_modes
from gridfold.reduction.unreduced import Unreduced


@pytest.fixture(scope="module")
def eigenvalues(npcc):
    return gf.small_signal(npcc).eigenvalues


def test_whole_modes_are_eigenvalues_of_the_jacobian(npcc_linear, eigenvalues):
    found = compared_modes(npcc_linear)
    assert len(found) >= 8
    for mode in found:
        assert np.abs(eigenvalues - mode.whole).min() < 1e-9 * abs(mode.whole)
        assert 0.1 <= mode.reduced.imag / (2 * np.pi) <= 3.0


def test_nothing_moves_where_nothing_is_truncated(npcc_parts):
    found = compared_modes(gf.fold(npcc_parts, reducer=Unreduced()))
    assert found
    for mode in found:
        assert abs(mode.reduced - mode.whole) < 1e-6 * abs(mode.whole)
        assert not mode.moved


def test_a_coarse_reduction_moves_modes_and_a_fine_one_less(npcc_parts):
    def moved(bound: float) -> list[ComparedMode]:
        area = gf.fold(npcc_parts, reducer=gf.BalancedTruncation(tolerance=bound))
        return [mode for mode in compared_modes(area) if mode.moved]

    assert len(moved(0.1)) >= 2
    assert moved(1e-5) == []


def test_a_mode_says_frequency_and_damping():
    mode = ComparedMode(complex(-1.0, 2 * np.pi), complex(-0.5, 4 * np.pi))
    assert str(mode) == "1 Hz, damping 16 % is at 2 Hz, damping 4 %"
    assert mode.moved
