"""Figures of a contingency on cases whose answers are known."""

import json

import numpy as np
import pytest
from cases import lossless_classical_system, one_machine_infinite_bus

import gridfold as gf
from gridfold.equivalents.families import Mode
from gridfold.study.summary import (
    Figures,
    column_types,
    time_per_model,
    trajectory_figures,
)


@pytest.fixture(scope="module")
def smib():
    return gf.build_model(one_machine_infinite_bus(damping=4.0))


def test_damping_and_frequency_are_those_of_the_linearized_machine(smib):
    """After a disturbance of some degrees the swing is that of the eigenvalue."""
    run = gf.simulate(smib, [gf.BusFault(1, duration=0.01)], t_end=12.0)
    figures = trajectory_figures(run)
    mode = next(value for value in gf.small_signal(smib).eigenvalues if value.imag > 0)
    assert figures["swing_hz"] == pytest.approx(mode.imag / (2 * np.pi), rel=5e-3)
    assert figures["damping_ratio"] == pytest.approx(-mode.real / abs(mode), rel=2e-2)
    assert figures["critical_machine"] == "1:1"


def test_without_a_disturbance_nothing_moves(smib):
    figures = trajectory_figures(gf.simulate(smib, [], t_end=1.0))
    assert figures["largest_angle_change_deg"] == pytest.approx(0.0, abs=1e-9)
    assert "damping_ratio" not in figures
    assert figures["nadir_hz"] == pytest.approx(60.0, abs=1e-9)


def test_a_lost_machine_is_named_with_its_time(smib):
    figures = trajectory_figures(gf.simulate(smib, [gf.BusFault(1, duration=1.0)], t_end=3.0))
    assert (figures["status"], figures["stable"]) == ("lost synchronism", False)
    assert figures["critical_machine"] == "1:1"
    assert figures["reason"] == f"lost synchronism: rotor_angle:1:1 at {figures['ended_at']:g} s"


def test_islands_are_not_compared_with_each_other():
    """Two machines that have been separated drift apart without end; that is no separation."""
    model = gf.build_model(lossless_classical_system())
    together = gf.simulate(model, [], t_end=5.0)
    apart = gf.simulate(
        model,
        [gf.BranchTrip("1-2", 0.0), gf.BranchTrip("2-3", 0.0)],
        t_end=5.0,
        criterion=None,
    )
    assert np.ptp(apart.rotor_angle_deg()[-1]) > 500
    largest = trajectory_figures(apart)["largest_separation_deg"]
    assert largest < 180
    first = trajectory_figures(together)["largest_separation_deg"]
    assert first == pytest.approx(np.ptp(together.rotor_angle_deg()[0]), abs=1e-6)


def test_seconds_of_each_model_add_up_to_the_run(smib):
    run = gf.simulate(smib, [], t_end=2.0)
    found = time_per_model(run)
    assert (found["detailed_s"], found["hybrid_s"], found["linear_s"]) == (2.0, 0.0, 0.0)
    assert 0 < found["wall_detailed_s"] <= run.simulation_seconds
    events = [gf.LoadStep(1, 0.5, 1.0), gf.LoadStep(1, 1.75, 1.0)]
    run = gf.simulate(smib, events, t_end=2.0)
    found = time_per_model(run, (Mode.DETAILED, Mode.HYBRID, Mode.LINEAR))
    assert (found["detailed_s"], found["hybrid_s"], found["linear_s"]) == pytest.approx(
        (0.5, 1.25, 0.25)
    )
    found = time_per_model(run, (Mode.WHOLE, Mode.RETAINED, Mode.WHOLE))
    assert (found["retained_s"], found["linear_whole_s"]) == pytest.approx((1.25, 0.75))
    assert found["detailed_s"] == found["wall_detailed_s"] == 0.0
    assert set(found) < set(column_types())


def test_every_figure_has_a_column_of_its_type(smib):
    run = gf.simulate(smib, [gf.BusFault(1, duration=0.01)], t_end=5.0)
    figures = trajectory_figures(run)
    kinds = column_types()
    assert list(kinds) == list(Figures.__dataclass_fields__)
    for name, value in figures.items():
        assert value is None or isinstance(value, kinds[name]), name
    texts = [text for _, text in json.loads(figures["notices"])]
    assert texts == ["fault at bus 1", "fault at bus 1 cleared"]
