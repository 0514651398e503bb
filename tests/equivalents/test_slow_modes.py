"""A reduced area that can be in a mode of the whole grid leaves the mode as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.equivalents.families import Mode
from gridfold.errors import OptionError
from gridfold.numerics.implicit import numerical_jacobian

ORDER, DECAY = 20, 0.246


@pytest.fixture(scope="module")
def parts(npcc):
    return gf.partition(npcc, range(1, 37))


def reduced(parts, slow_modes):
    return gf.reduce(parts, gf.BalancedTruncation(order=ORDER, slow_modes=slow_modes))


def folded(parts, slow_modes):
    return gf.fold(parts, (), gf.BalancedTruncation(order=ORDER, slow_modes=slow_modes))


def poles(small, x):
    start = small.coordinates.restrict(x)
    return np.linalg.eigvals(numerical_jacobian(small.system.compiled, start))


@pytest.mark.parametrize(("form", "usual"), [(reduced, 1e-2), (folded, 1e-4)])
def test_slow_modes_of_the_whole_are_modes_of_the_reduced_model(npcc, parts, form, usual):
    exact = gf.small_signal(npcc).eigenvalues
    slow = exact[exact.real > -DECAY]
    assert len(slow) == 3
    without, found = (
        poles(form(parts, decay).build(Mode.LINEAR, npcc), npcc.x0) for decay in (None, DECAY)
    )
    apart, before = (np.abs(slow[:, None] - some).min(axis=1) for some in (found, without))
    assert apart.max() < 1e-8
    assert before.max() > usual


def test_if_all_angles_turn_alike_what_keeps_that_mode_stays_at_rest(npcc, parts):
    turned = npcc.x0.copy()
    turned[npcc.slots("rotor_angle", npcc.machines)] += 0.5
    residual = []
    for form, decay in ((reduced, None), (reduced, 1e-3), (folded, None)):
        small = form(parts, decay).build(Mode.LINEAR, npcc)
        moved = small.system.compiled(small.coordinates.restrict(turned))
        residual.append(np.abs(moved).max())
    assert residual[0] > 1e-3
    assert max(residual[1:]) < 1e-8


def test_the_modes_of_another_network_are_found_anew(npcc, parts):
    """With 500 MW more at a bus of the study area, at the operating point that follows."""
    model = npcc.for_state(replace(npcc.state, load_steps=((3, 500 + 0j),)))
    point = find_equilibrium(model, npcc.x0)
    exact = np.linalg.eigvals(model.jacobian(point.x))
    slow = exact[exact.real > -DECAY]
    family = reduced(parts, DECAY)
    apart = [
        np.abs(slow[:, None] - poles(some.linear(model), point.x)).min(axis=1).max()
        for some in (family.moved(model, point), family)
    ]
    assert apart[0] < 1e-8
    assert apart[1] > 1e-6


def test_a_decay_that_is_no_positive_number_is_refused():
    with pytest.raises(OptionError, match="decay of slow modes"):
        gf.BalancedTruncation(order=3, slow_modes=0.0)
