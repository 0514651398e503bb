from __future__ import annotations

import numpy as np
import pytest

from gridfold.errors import OptionError
from gridfold.systems import StateMap


@pytest.fixture
def state_map():
    rng = np.random.default_rng(0)
    lift = rng.normal(size=(5, 2))
    return StateMap(rng.normal(size=5), lift, np.linalg.pinv(lift))


def test_restrict_undoes_lift(state_map):
    z = np.array([[1.0, -2.0], [0.5, 3.0]])
    np.testing.assert_allclose(state_map.restrict(state_map.lift(z)), z, atol=1e-14)
    np.testing.assert_allclose(state_map.restrict(state_map.lift(z[0])), z[0], atol=1e-14)


def test_origin_is_the_reference(state_map):
    np.testing.assert_array_equal(state_map.lift(np.zeros(2)), state_map.reference)
    np.testing.assert_array_equal(state_map.restrict(state_map.reference), np.zeros(2))


def test_identity_only_shifts():
    identity = StateMap.identity(np.array([1.0, 2.0, 3.0]))
    assert identity.order == 3
    np.testing.assert_array_equal(identity.lift(np.ones(3)), [2, 3, 4])


def test_matrices_that_are_not_inverse_are_an_error():
    lift = np.eye(3)[:, :2]
    StateMap(np.zeros(3), lift, (1 + 0.9e-8) * lift.T)
    with pytest.raises(OptionError, match=r"T T~ is off I by 1\.1e-08"):
        StateMap(np.zeros(3), lift, (1 + 1.1e-8) * lift.T)
    with pytest.raises(OptionError, match="off I by nan"):
        StateMap(np.zeros(3), lift, np.full((2, 3), np.nan))


@pytest.mark.parametrize(
    ("reference", "lift", "restrict", "message"),
    [
        (np.zeros(2), np.eye(3), np.eye(3), "lift_matrix of a state map has shape"),
        (np.zeros(3), np.eye(3), np.eye(3)[:2], "restrict_matrix of a state map has shape"),
        (np.zeros((3, 1)), np.eye(3), np.eye(3), "reference vector"),
    ],
)
def test_shapes_that_do_not_fit_are_an_error(reference, lift, restrict, message):
    with pytest.raises(OptionError, match=message):
        StateMap(reference, lift, restrict)
