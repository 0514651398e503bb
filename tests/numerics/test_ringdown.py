"""The matrix pencil method on signals whose modes are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gridfold.numerics.ringdown import ringdown

STEP = 0.01


def swing(hertz, damping, amplitude=10.0, phase=0.3, t_end=16.0):
    times = np.arange(0, t_end, STEP)
    natural = 2 * np.pi * hertz / np.sqrt(1 - damping**2)
    return (
        amplitude * np.exp(-damping * natural * times) * np.cos(2 * np.pi * hertz * times + phase)
    )


@settings(max_examples=40, deadline=None)
@given(st.floats(0.1, 2.5), st.floats(-0.01, 0.3), st.floats(0, 6.28), st.floats(-50, 50))
def test_a_single_swing_is_found_whatever_its_phase_and_offset(hertz, damping, phase, offset):
    found = ringdown(swing(hertz, damping, phase=phase) + offset, STEP)
    assert found.frequency_hz == pytest.approx(hertz, rel=1e-3)
    assert found.damping_ratio == pytest.approx(damping, abs=1e-3)


def test_of_two_swings_that_with_more_energy_counts():
    found = ringdown(swing(0.4, 0.05) + swing(1.2, 0.02, amplitude=2.0), STEP)
    assert found.frequency_hz == pytest.approx(0.4, rel=1e-3)
    assert found.damping_ratio == pytest.approx(0.05, abs=1e-3)
    assert 0.5 < found.share < 1.0


def test_decays_do_not_count_as_swings():
    times = np.arange(0, 16.0, STEP)
    found = ringdown(20 * np.exp(-0.4 * times) + swing(1.0, 0.1, amplitude=1.0), STEP)
    assert found.frequency_hz == pytest.approx(1.0, rel=1e-3)
    assert ringdown(np.exp(-0.4 * times), STEP) is None


def test_noise_moves_the_answer_by_its_own_size_only():
    noise = np.random.default_rng(1).normal(0, 0.02, 1600)
    found = ringdown(swing(0.7, 0.05) + noise, STEP)
    assert found.frequency_hz == pytest.approx(0.7, rel=0.01)
    assert found.damping_ratio == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize("signal", [np.zeros(100), np.arange(5.0), np.full(100, np.nan)])
def test_nothing_is_found_where_nothing_swings(signal):
    assert ringdown(signal, STEP) is None
