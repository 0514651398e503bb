"""Grids whose modes coincide: turbines that have two lags of one time constant in a row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from row_of_areas import row_of_areas
from scipy.linalg import expm

import gridfold as gf
from gridfold.equivalents.error_estimate import ErrorEstimator
from gridfold.equivalents.families import Mode
from gridfold.equivalents.fitted import FINEST, fit_ladder
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.tolerant import TolerantModel
from gridfold.numerics.modal_form import modal_form
from gridfold.systems.modal import ModalSystem

#: Crossover and outlet give no power of their own: nothing comes back from the two lags.
TURBINE = {
    "governor_gain": 20.0, "governor_lag_time": 0.1, "governor_lead_time": 0.0, "gate_time": 0.5,
    "opening_rate": 1.0, "closing_rate": -1.0, "highest_gate": 1.2, "lowest_gate": 0.0,
    "chest_time": 0.3, "chest_fraction": 0.3, "reheater_time": 7.0, "reheater_fraction": 0.7,
    "crossover_time": 0.4, "crossover_fraction": 0.0, "outlet_time": 0.4, "outlet_fraction": 0.0,
}  # fmt: skip
T_END = 5.0


@pytest.fixture(scope="module")
def parts() -> gf.Partition:
    case = row_of_areas()
    devices = [
        replace(device, model="ieeeg1", parameters=TURBINE) if device.model == "tgov1" else device
        for device in case.devices
    ]
    case = replace(case, devices=tuple(devices))
    return gf.partition(gf.build_model(case), [b.number for b in case.buses if b.area == 1])


@pytest.fixture(scope="module")
def area(parts) -> FoldedArea:
    return gf.fold(parts, reducer=gf.BalancedTruncation(tolerance=1e-5))


def test_the_system_that_is_linear_throughout_is_a_formula(parts, area) -> None:
    model = parts.model
    matrix = model.jacobian(model.x0)
    assert modal_form(matrix) is None
    small = gf.whole_system(parts).linear(model)
    assert isinstance(small.system, ModalSystem)
    assert small.system.form.links.gains.size == 6
    shift = 0.02 * np.random.default_rng(2).standard_normal(model.n_states)
    start = small.coordinates.restrict(model.x0 + shift)
    found = small.coordinates.lift(small.system.states_after(start, np.array([0.2, 1.0])))
    expected = [model.x0 + expm(matrix * t) @ shift for t in (0.2, 1.0)]
    np.testing.assert_allclose(found, expected, atol=1e-7)
    folded = area.whole(model).system
    assert isinstance(folded, ModalSystem)
    assert folded.form.links.gains.size == 2


def test_errors_are_estimated(parts, area) -> None:
    events = [gf.BusFault(15, duration=0.02)]
    coarse = gf.fold(parts, reducer=gf.BalancedTruncation(order=14))
    run = gf.simulate_adaptive(parts.model, coarse, gf.SwitchingRule(0.0), events, T_END)
    detailed = gf.simulate(parts.model, events, T_END)
    true = max(
        item.relative_rms_deg
        for item in gf.compare(detailed, run.trajectory, parts.study_units).units
    )
    found = ErrorEstimator(parts, area=area).estimate(run)
    assert found is not None
    assert found.worst_deg == pytest.approx(true, rel=0.1)


def test_a_tolerance_is_kept_by_reduced_models(parts) -> None:
    model = TolerantModel(fit_ladder(parts, 0.5), 0.5)
    assert "cannot" not in (model.told or "")
    events = [gf.BusFault(15, duration=0.02)]
    found = model.run(parts.model, events, T_END)
    detailed = gf.simulate(parts.model, events, T_END)
    true = [
        item.relative_rms_deg
        for item in gf.compare(detailed, found.trajectory, parts.study_units).units
    ]
    assert found.attempts[-1].mode is not Mode.DETAILED
    assert max(true) <= 0.5


def test_where_no_error_can_be_estimated_nothing_else_is_fitted(parts, monkeypatch) -> None:
    monkeypatch.setattr("gridfold.equivalents.folded.chained_form", lambda matrix: None)
    folded: list[gf.Reducer] = []

    def spied(parts, retained, reducer, *rest):
        folded.append(reducer)
        return gf.fold(parts, retained, reducer, *rest)

    monkeypatch.setattr("gridfold.equivalents.fitted.fold", spied)
    ladder = fit_ladder(parts, 0.5)
    model = TolerantModel(ladder, 0.5)
    assert folded == [gf.BalancedTruncation(tolerance=FINEST)]
    assert model.rules == ()
    assert model.told == (
        "errors of reduced models cannot be estimated, since modes of the linear system coincide: all "
        "runs are detailed"
    )
    found = model.run(parts.model, [gf.BusFault(15, duration=0.02)], 1.0)
    assert [attempt.mode for attempt in found.attempts] == [Mode.DETAILED]


def test_an_error_that_cannot_be_followed_is_told_at_once(parts, area, monkeypatch) -> None:
    monkeypatch.setattr("gridfold.equivalents.error_estimate.MOST", 1e-9)
    ladder = gf.Ladder((area,), whole=True, fine=area)
    model = TolerantModel(ladder, 0.5)
    assert model.rules == ()
    assert model.told == (
        "estimated errors of reduced models grow without bound after the sample faults: all runs are "
        "detailed"
    )
    events = [gf.BusFault(15, duration=0.02)]
    run = gf.simulate_adaptive(parts.model, ladder, gf.SwitchingRule(0.0), events, 2.0)
    trail = model.estimator.trail(run)
    assert trail.lost
    assert trail.estimate() is None
