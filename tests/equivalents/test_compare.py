from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import lossless_classical_system

import gridfold as gf
from gridfold.equivalents.compare import compare
from gridfold.errors import OptionError
from gridfold.simulation import Piece, Run


@pytest.fixture(scope="module")
def model() -> gf.DetailedModel:
    return gf.build_model(lossless_classical_system())


@pytest.fixture(scope="module")
def still(model) -> gf.Trajectory:
    """Four samples at the equilibrium."""
    return gf.simulate(model, t_end=0.3, stepper=gf.ScipyReference(0.1))


def moved(run: gf.Trajectory, changes: dict[str, list[float]]) -> gf.Trajectory:
    """The same run with values added to some states."""
    (piece,) = run.run.pieces
    states = piece.states.copy()
    for name, values in changes.items():
        states[:, run.model.state_names.index(name)] += values
    altered = Piece(piece.segment, piece.times, states)
    return replace(run, run=Run((altered,), run.run.status))


def test_a_run_has_no_error_against_itself(still):
    result = compare(still, still)
    assert {(u.rms_deg, u.largest_deg, u.relative_rms_deg) for u in result.units} == {(0, 0, 0)}
    assert set(result.state_rms.values()) == {0.0}


def test_root_mean_square_and_largest_error_are_those_computed_by_hand(still):
    # 0, 3, 0 and -4 degrees: (9 + 16) / 4 = 6.25, the root of which is 2.5.
    other = moved(still, {"rotor_angle:2:1": list(np.deg2rad([0, 3, 0, -4]))})
    result = compare(still, other)
    errors = {str(u.unit): u for u in result.units}
    assert errors["2:1"].rms_deg == pytest.approx(2.5, rel=1e-12)
    assert errors["2:1"].largest_deg == pytest.approx(4.0, rel=1e-12)
    assert errors["1:1"].rms_deg == errors["3:1"].rms_deg == 0.0
    assert result.worst is errors["2:1"]
    # Inertias 4, 6 and 2.5: the centre of inertia moves by 6 / 12.5 of it.
    assert errors["2:1"].relative_rms_deg == pytest.approx(2.5 * (1 - 6 / 12.5), rel=1e-9)
    assert errors["1:1"].relative_rms_deg == pytest.approx(2.5 * 6 / 12.5, rel=1e-9)


def test_a_common_shift_is_an_absolute_error_but_no_relative_one(still):
    shift = list(np.deg2rad([0, 0, 1, 1]))
    other = moved(still, {f"rotor_angle:{bus}:1": shift for bus in (1, 2, 3)})
    for unit in compare(still, other).units:
        assert unit.rms_deg == pytest.approx(np.sqrt(0.5), rel=1e-9)
        assert unit.relative_rms_deg == pytest.approx(0.0, abs=1e-9)


def test_every_state_of_the_machines_asked_for_has_an_error_angles_in_degrees(still):
    changes = {"speed:3:1": [0.0, 0.0, 0.02, 0.0], "rotor_angle:3:1": [0.1, 0.1, 0.1, 0.1]}
    result = compare(still, moved(still, changes), [gf.UnitKey(3, "1")])
    assert set(result.state_rms) == {"speed:3:1", "rotor_angle:3:1"}
    assert result.state_rms["speed:3:1"] == pytest.approx(0.01, rel=1e-9)
    assert result.state_rms["rotor_angle:3:1"] == pytest.approx(np.rad2deg(0.1), rel=1e-9)
    assert [str(u.unit) for u in result.units] == ["3:1"]


def test_runs_with_other_sampling_times_are_not_compared(model, still):
    longer = gf.simulate(model, t_end=0.4, stepper=gf.ScipyReference(0.1))
    with pytest.raises(OptionError, match=r"4 samples until 0\.3 s .* 5 until 0\.4 s"):
        compare(still, longer)
    later = gf.simulate(model, t_end=0.6, stepper=gf.ScipyReference(0.2))
    with pytest.raises(OptionError, match="cannot be compared"):
        compare(still, later)
