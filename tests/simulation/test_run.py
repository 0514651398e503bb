from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from gridfold.errors import OptionError
from gridfold.numerics.band_watch import BandWatch
from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs
from gridfold.numerics.steppers import RungeKutta4
from gridfold.simulation import Segment, run_plan, run_segments
from gridfold.simulation.segment import Stop
from gridfold.systems import System
from gridfold.systems.status import Status


def _power_law(integers, reals, work, x, dx):
    dx[0] = reals[0] * x[0] ** reals[1]


@dataclass(frozen=True)
class PowerLaw:
    """x' = rate * x^power."""

    rate: float
    power: float
    state_names: tuple[str, ...] = ("x",)

    @property
    def compiled(self) -> CompiledRhs:
        address = compile_callback(_power_law, RHS_SIGNATURE).address
        data = np.array([self.rate, self.power])
        return CompiledRhs(address, np.zeros(0, dtype=np.int64), data, 0, 1)


def test_each_segment_starts_where_the_last_one_ended():
    growth, decay = PowerLaw(1.0, 1.0), PowerLaw(-2.0, 1.0)
    system: System = growth
    run = run_segments(
        [Segment(system, 1.0), Segment(decay, 1.505), Segment(growth, 3.0)],
        np.array([1.0]),
        RungeKutta4(0.005),
    )
    assert run.status is Status.COMPLETED
    assert [piece.times[0] for piece in run.pieces] == [0.0, 1.0, 1.505]
    assert [piece.times[-1] for piece in run.pieces] == [1.0, 1.505, 3.0]
    assert run.pieces[-1].states[-1, 0] == pytest.approx(np.exp(1 - 2 * 0.505 + 1.495), rel=1e-9)
    assert run.step_count == 600


def test_states_that_become_infinite_end_the_run_with_a_status_and_the_culprit():
    run = run_segments([Segment(PowerLaw(1.0, 2.0), 5.0)], np.array([1.0]), RungeKutta4(0.01))
    assert run.status is Status.NOT_FINITE
    assert run.culprit == 0
    assert np.isfinite(run.pieces[-1].states).all()
    assert run.pieces[-1].times[-1] < 1.2


def test_a_segment_that_ends_before_it_starts_is_refused():
    segments = [Segment(PowerLaw(1.0, 1.0), 1.0), Segment(PowerLaw(1.0, 1.0), 0.5, "late")]
    with pytest.raises(OptionError, match="late"):
        run_segments(segments, np.array([1.0]), RungeKutta4())


def test_every_status_carries_advice():
    assert all(status.advice for status in Status)


@dataclass(frozen=True)
class Doubled:
    """z = 2 x: coordinates with another scale."""

    def lift(self, z):
        return z / 2

    def restrict(self, x):
        return 2 * x


@dataclass(frozen=True)
class Cut:
    """x = (z, 0.5): the second state is lost and comes back as a constant."""

    def lift(self, z):
        return np.concatenate([z, np.full_like(z, 0.5)], axis=-1)

    def restrict(self, x):
        return x[:1]


def above(limit: float, inside: bool = False) -> BandWatch:
    return BandWatch(np.eye(1), np.zeros(1), limit, inside)


def test_a_segment_in_its_own_coordinates_starts_from_and_ends_in_whole_states():
    decay = PowerLaw(-1.0, 1.0)
    run = run_segments(
        [Segment(decay, 1.0), Segment(decay, 2.0, coordinates=Doubled()), Segment(decay, 3.0)],
        np.array([1.0]),
        RungeKutta4(0.01),
    )
    first, middle, last = run.pieces
    assert middle.states[0, 0] == 2 * first.states[-1, 0]
    np.testing.assert_array_equal(middle.full_states, middle.states / 2)
    assert last.states[0, 0] == middle.full_states[-1, 0]
    assert last.states[-1, 0] == pytest.approx(np.exp(-3.0), rel=1e-9)


def test_coordinates_may_have_fewer_states_than_the_whole():
    decay = PowerLaw(-1.0, 1.0)
    run = run_segments(
        [Segment(decay, 1.0, coordinates=Cut())], np.array([1.0, 7.0]), RungeKutta4(0.01)
    )
    assert run.pieces[0].states.shape == (101, 1)
    assert run.pieces[0].full_states.shape == (101, 2)
    np.testing.assert_array_equal(run.pieces[0].full_states[:, 1], 0.5)


@dataclass
class Thermostat:
    """Grows until 2, decays until 1, to and fro until the end; remembers what it was asked."""

    t_end: float
    asked: list[tuple[float, float]] = field(default_factory=list)

    def next(self, time, x):
        self.asked.append((time, float(x[0])))
        if time >= self.t_end:
            return None
        if len(self.asked) % 2:
            return Segment(PowerLaw(1.0, 1.0), self.t_end, "grow", switches=(above(2.0),))
        return Segment(PowerLaw(-1.0, 1.0), self.t_end, "decay", switches=(above(1.0, True),))


def test_a_plan_is_asked_with_time_and_state_at_every_switch():
    plan, step = Thermostat(3.0), 0.001
    run = run_plan(plan, np.array([1.0]), RungeKutta4(step))
    assert run.status is Status.COMPLETED
    labels = [piece.segment.label for piece in run.pieces]
    assert labels == ["grow", "decay", "grow", "decay", "grow"]
    assert len(plan.asked) == 6
    for (time, x), piece in zip(plan.asked[1:], run.pieces, strict=True):
        assert (time, x) == (piece.times[-1], piece.states[-1, 0])
    # Each swing takes ln 2, and is ended at the first step beyond the limit.
    for k, (time, x) in enumerate(plan.asked[1:-1], start=1):
        assert k * np.log(2) <= time <= k * (np.log(2) + 2 * step)
        assert x == pytest.approx(2.0 if k % 2 else 1.0, rel=3 * step)
    assert plan.asked[-1][0] == 3.0


def test_a_switch_ends_the_segment_and_a_stop_the_run():
    growth = PowerLaw(1.0, 1.0)
    segments = [
        Segment(
            growth, 5.0, stops=(Stop(above(4.0), Status.LOST_SYNCHRONISM),), switches=(above(2.0),)
        ),
        Segment(growth, 5.0, stops=(Stop(above(4.0), Status.LOST_SYNCHRONISM),)),
        Segment(growth, 9.0),
    ]
    run = run_segments(segments, np.array([1.0]), RungeKutta4(0.01))
    assert run.status is Status.LOST_SYNCHRONISM
    assert run.culprit == 0
    ends = [piece.times[-1] for piece in run.pieces]
    assert ends == [pytest.approx(0.70), pytest.approx(1.39)]


def test_where_stop_and_switch_hold_at_the_same_step_the_run_ends():
    segment = Segment(
        PowerLaw(1.0, 1.0), 5.0, stops=(Stop(above(2.0), Status.OFF_SPEED),), switches=(above(2.0),)
    )
    run = run_segments([segment, segment], np.array([1.0]), RungeKutta4(0.01))
    assert run.status is Status.OFF_SPEED
    assert len(run.pieces) == 1


@pytest.mark.parametrize("inside", [False, True])
def test_a_band_tells_whether_all_are_within_or_one_is_not(inside):
    watch = BandWatch(np.array([[1.0, -1.0], [0.0, 2.0]]), np.array([0.5, 0.0]), 1.0, inside)
    np.testing.assert_allclose(watch.distances(np.array([0.1, 0.2])), [0.4, 0.4])
    assert watch.holds(np.array([0.1, 0.2])) is inside
    assert watch.holds(np.array([0.1, 0.9])) is not inside
    assert watch.holds(np.array([2.0, 0.2])) is not inside


def test_a_band_that_holds_states_that_are_not_finite_is_left():
    watch = BandWatch(np.eye(1), np.zeros(1), 1.0)
    assert watch.holds(np.array([np.nan]))
    assert not BandWatch(np.eye(1), np.zeros(1), 1.0, inside=True).holds(np.array([np.nan]))
