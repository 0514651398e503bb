from __future__ import annotations

import numpy as np
import pytest
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.equivalents.ranking import _power_defects, rank_retained
from gridfold.equivalents.swings import sample_swings
from gridfold.errors import OptionError
from gridfold.partition import couple, partition


@pytest.fixture(scope="module")
def parts(npcc_parts):
    return npcc_parts


@pytest.fixture(scope="module")
def ranking(parts, npcc_swings):
    return rank_retained(parts, npcc_swings)


def test_all_external_machines_are_ranked_by_falling_score(parts, ranking):
    assert sorted(ranking.units) == sorted(parts.external_units)
    assert (np.diff(ranking.scores) <= 0).all()
    assert (ranking.scores > 0).all()
    np.testing.assert_array_equal(ranking.scores, ranking.power_defects * ranking.norms)
    norms = dict(zip(parts.external_units, couple(parts).norms, strict=True))
    assert [norms[unit] for unit in ranking.units] == ranking.norms.tolist()


def test_large_machines_move_up_against_the_order_of_column_norms(ranking):
    assert [unit.bus for unit in ranking.first(5)] == [78, 133, 134, 50, 42]
    assert not (np.diff(ranking.norms) <= 0).all()


def test_as_many_as_there_are_can_be_taken(ranking):
    assert ranking.first(0) == ()
    assert ranking.first(39) == ranking.units
    for n in (-1, 40):
        with pytest.raises(OptionError, match=f"39 external machines {n}"):
            ranking.first(n)


def test_the_defect_is_the_accelerating_power_that_the_dense_jacobian_misses(npcc, parts):
    x = npcc.x0 + 0.1 * np.random.default_rng(2).standard_normal((3, npcc.n_states))
    units = parts.external_units
    rows = npcc.slots("speed", units)
    exact = np.array([npcc.compiled(state)[rows] for state in x])
    missed = exact - (x - npcc.x0) @ npcc.jacobian(npcc.x0)[rows].T
    expected = 2 * npcc.inertia(units) * np.sqrt((missed**2).mean(axis=0))
    found = _power_defects(npcc, [x[:1], x[1:]], units)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_a_common_turn_of_all_angles_is_no_defect(npcc, parts):
    x = npcc.x0 + 0.05 * np.random.default_rng(2).standard_normal((2, npcc.n_states))
    turned = x.copy()
    turned[:, npcc.slots("rotor_angle", npcc.machines)] += 2.0
    before, after = (_power_defects(npcc, [s], parts.external_units) for s in (x, turned))
    np.testing.assert_allclose(after, before, rtol=1e-7, atol=1e-9)


def test_the_score_grows_with_the_square_of_a_small_swing(parts):
    def swing(reactance):
        fault = gf.BusFault(23, duration=0.1, reactance=reactance)
        return rank_retained(parts, sample_swings(parts, [[fault]], 1.0))

    small, large = swing(20.0), swing(10.0)
    scores = dict(zip(small.units, small.scores, strict=True))
    ratios = [large.scores[k] / scores[unit] for k, unit in enumerate(large.first(10))]
    np.testing.assert_allclose(ratios, 4.0, rtol=0.1)


def test_machines_with_other_models_are_ranked_too():
    model = gf.build_model(row_of_areas())
    parts = partition(model, range(11, 16))
    ranking = rank_retained(parts)
    assert {unit.bus // 10 for unit in ranking.first(2)} == {2}
