from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from gridfold.errors import OptionError
from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs
from gridfold.numerics.steppers import RungeKutta4
from gridfold.simulation import Segment, run_segments
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
