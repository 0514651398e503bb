"""Polar outputs of the linear machines: what they cause at the boundary, in logarithm and angle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from area_cases import Unreduced

from gridfold.dynamics.area_model import Outputs
from gridfold.dynamics.area_rhs import N_FORMED
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.families import ReducedExternal, reduce_external
from gridfold.partition import partition


@pytest.fixture(scope="module")
def polar(npcc) -> ReducedExternal:
    return reduce_external(partition(npcc, range(1, 37)), Unreduced(), outputs=Outputs.POLAR)


@pytest.fixture(scope="module")
def states(polar) -> ReducedExternal:
    return replace(polar, outputs=Outputs.STATES)


def both_kinds(family: ReducedExternal, model: DetailedModel):
    return family.linear(model), family.hybrid(model)


def test_derivative_is_zero_at_the_equilibrium(npcc, polar):
    for small in both_kinds(polar, npcc):
        v = small.coordinates.restrict(npcc.x0)
        assert np.abs(small.system.compiled(v)).max() < 1e-9


def test_a_common_turn_of_all_angles_changes_nothing(npcc, polar):
    turned = npcc.x0.copy()
    turned[npcc.slots("rotor_angle", npcc.machines)] += 1.2
    for small in both_kinds(polar, npcc):
        v = small.coordinates.restrict(turned)
        assert np.abs(small.system.compiled(v)).max() < 1e-8


def test_they_agree_with_formed_states_to_first_order(npcc, polar, states):
    direction = np.random.default_rng(4).standard_normal(npcc.n_states)
    for one, other in zip(both_kinds(polar, npcc), both_kinds(states, npcc), strict=True):
        gaps = []
        for size in (1e-3, 1e-4):
            v = one.coordinates.restrict(npcc.x0 + size * direction)
            gaps.append(np.abs(one.system.compiled(v) - other.system.compiled(v)).max())
        assert gaps[0] > 50 * gaps[1] > 0  # quadratic: a tenth of the step, a hundredth of the gap


def test_no_state_of_a_linear_machine_is_formed_however_many_there_are(npcc, polar, states):
    linear, hybrid = both_kinds(polar, npcc)
    assert linear.system.compiled.integers[N_FORMED] == 0
    assert hybrid.system.compiled.integers[N_FORMED] == 9 * len(polar.kept)
    assert states.linear(npcc).system.compiled.integers[N_FORMED] == 3 * 39
