from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.families import WholeSystem, whole_system
from gridfold.equivalents.switching import SwitchingRule
from gridfold.numerics.band_watch import BandWatch
from gridfold.numerics.modal_form import modal_form
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.steppers import RungeKutta4
from gridfold.partition import partition
from gridfold.simulation import Segment, run_segments
from gridfold.simulation.run import BLOCK
from gridfold.simulation.segment import Stop
from gridfold.systems import System
from gridfold.systems.modal import ModalSystem
from gridfold.systems.status import Status


@dataclass(frozen=True)
class Stepped:
    """A system whose closed form is hidden."""

    system: System

    @property
    def state_names(self):
        return self.system.state_names

    @property
    def compiled(self) -> CompiledRhs:
        return self.system.compiled


@dataclass(frozen=True)
class SteppedFamily(WholeSystem):
    """The whole-system version with its linear model stepped."""

    def linear(self, model):
        small = super().linear(model)
        return replace(small, system=Stepped(small.system))


@pytest.fixture(scope="module")
def spiral() -> ModalSystem:
    """A growing oscillation, and a decay to 0.5."""
    form = modal_form(np.array([[0.3, 2.0, 0.0], [-2.0, 0.3, 0.0], [0.0, 0.0, -1.0]]))
    return ModalSystem(form, np.array([0.0, 0.0, 0.5]))


START, STEP = np.array([0.1, 0.0, 3.0]), 0.002


def beyond(state: int, limit: float, inside: bool = False) -> BandWatch:
    return BandWatch(np.eye(3)[[state]], np.zeros(1), limit, inside)


def lost(watches: Iterable[BandWatch]) -> tuple[Stop, ...]:
    return tuple(Stop(watch, Status.LOST_SYNCHRONISM) for watch in watches)


@pytest.mark.parametrize(
    ("stops", "switches"),
    [
        ((), ()),
        ((beyond(0, 0.3),), ()),
        ((), (beyond(2, 1.0, inside=True),)),
        ((beyond(0, 0.3),), (beyond(2, 1.0, inside=True),)),
        ((beyond(0, 0.1),), (beyond(0, 0.1),)),
        ((beyond(0, 0.3),), (beyond(0, 0.0),)),
    ],
    ids=["none", "stop", "switch", "switch first", "same row", "at once"],
)
def test_watches_fire_at_the_step_at_which_they_do_for_the_stepper(spiral, stops, switches):
    def run(system):
        segments = [Segment(system, 9.9995, "", lost(stops), switches), Segment(system, 10.5)]
        return run_segments(segments, START, RungeKutta4(STEP), start=0.0007)

    known, stepped = run(spiral), run(Stepped(spiral))
    assert known.status is stepped.status
    assert known.culprit == stepped.culprit
    assert known.step_count == stepped.step_count
    assert len(known.pieces) == len(stepped.pieces)
    for one, other in zip(known.pieces, stepped.pieces, strict=True):
        np.testing.assert_array_equal(one.times, other.times)
        np.testing.assert_allclose(one.states, other.states, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("row", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 2 * BLOCK + 1])
def test_a_watch_fires_anywhere_in_a_block(row):
    clock = ModalSystem(modal_form(np.zeros((1, 1))), np.ones(1))
    segment = Segment(
        clock, 10.0, stops=lost([BandWatch(np.eye(1), np.zeros(1), (row - 0.5) * 0.01)])
    )
    run = run_segments([segment], np.zeros(1), RungeKutta4(0.01))
    assert run.status is Status.LOST_SYNCHRONISM
    assert run.step_count == row
    assert run.pieces[0].states[-1, 0] == pytest.approx(row * 0.01)


def test_the_state_at_the_start_is_not_watched(spiral):
    run = run_segments(
        [Segment(spiral, 5.0, stops=lost([beyond(2, 2.9999)]))], START, RungeKutta4(STEP)
    )
    assert run.status is Status.COMPLETED


def test_a_mode_that_overflows_ends_the_run_where_it_does():
    form = modal_form(np.diag([100.0, -1.0]))
    run = run_segments(
        [Segment(ModalSystem(form, np.zeros(2)), 20.0)], np.ones(2), RungeKutta4(0.01)
    )
    assert run.status is Status.NOT_FINITE
    assert run.culprit == int(np.argmax(form.diagonal))
    assert run.pieces[0].times[-1] == pytest.approx(np.log(np.finfo(float).max) / 100, abs=0.011)


def test_the_linear_run_of_the_whole_system_is_the_one_that_small_steps_converge_to(npcc):
    known = whole_system(partition(npcc, range(1, 37)))
    stepped = SteppedFamily(known.parts, known.coupling, known.kept, known.origin)
    fault, rule = [gf.BusFault(3, duration=0.2)], SwitchingRule(float("inf"))

    def last_piece(family, step):
        # Both start the linear phase from the same state: only it is compared.
        run = simulate_adaptive(npcc, family, rule, fault, 2.0, RungeKutta4(step)).trajectory
        assert run.run.step_count == len(run.times) - 1 == round(2.0 / step)
        return run.run.pieces[-1]

    errors = []
    for step in (0.01, 0.005):
        one, other = last_piece(known, step), last_piece(stepped, step)
        errors.append(np.abs(one.full_states - other.full_states).max())
    assert errors[0] < 1e-4
    assert 12 < errors[0] / errors[1] < 20


def test_rotor_angles_of_a_linear_run_are_lifted_without_the_other_states(npcc):
    family = whole_system(partition(npcc, range(1, 37)))
    fault = [gf.BusFault(3, start=0.1, duration=0.1)]
    run = simulate_adaptive(npcc, family, SwitchingRule(float("inf")), fault, 1.0).trajectory
    angles = run.signal("rotor_angle")
    linear = [p for p in run.run.pieces if p.segment.coordinates is not None]
    assert len(linear) == 2
    assert not any("full_states" in vars(piece) for piece in linear)
    np.testing.assert_allclose(
        angles, run.states[:, npcc.slots("rotor_angle", npcc.machines)], atol=1e-12
    )
