"""A time limit reaches into compiled loops, and changes nothing where it is not reached."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest

from gridfold.errors import OptionError, TimeLimitError
from gridfold.numerics.compiled import compile_callback
from gridfold.numerics.deadline import Deadline, check_time, time_limit, time_watches
from gridfold.numerics.rhs import RHS_SIGNATURE, CompiledRhs
from gridfold.numerics.steppers import AdamsBashforthMoulton4, RungeKutta4, Stepper
from gridfold.simulation import Segment, run_segments

STEPPERS = (RungeKutta4(1e-3), AdamsBashforthMoulton4(1e-3))


def _slow_decay(integers, reals, work, x, dx):
    total = 0.0
    for k in range(integers[0]):
        total += 1.0 / (1.0 + k)
    dx[0] = -x[0] + 1e-300 * total


@dataclass(frozen=True)
class SlowDecay:
    """x' = -x, with as much work as one likes."""

    work: int
    state_names: tuple[str, ...] = ("x",)

    @property
    def compiled(self) -> CompiledRhs:
        address = compile_callback(_slow_decay, RHS_SIGNATURE).address
        return CompiledRhs(address, np.array([self.work]), np.zeros(0), 0, 1)


def run(work: int, stepper: Stepper, t_end: float = 1.0) -> np.ndarray:
    segments = [Segment(SlowDecay(work), t_end)]
    return run_segments(segments, np.ones(1), stepper).pieces[0].states


@pytest.mark.parametrize("stepper", STEPPERS, ids=lambda item: item.name)
def test_a_compiled_loop_ends_within_a_step_of_its_time(stepper):
    run(1, stepper)
    began = time.monotonic()
    with pytest.raises(TimeLimitError, match=r"time limit of 0\.2 s"), time_limit(0.2):
        run(1_000_000, stepper, 100.0)
    assert 0.15 < time.monotonic() - began < 5.0


@pytest.mark.parametrize("stepper", STEPPERS, ids=lambda item: item.name)
def test_a_limit_that_is_not_reached_changes_no_digit(stepper):
    free = run(1, stepper)
    with time_limit(60.0):
        np.testing.assert_array_equal(run(1, stepper), free)


def test_a_limit_is_that_of_its_thread_and_its_block():
    with time_limit(1e-3), ThreadPoolExecutor(1) as pool:
        time.sleep(0.1)
        pool.submit(check_time).result()
        with pytest.raises(TimeLimitError):
            check_time()
    check_time()
    assert time_watches() == ()
    with time_limit(None):
        assert time_watches() == ()


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_a_limit_that_is_no_time_is_refused(seconds):
    with pytest.raises(OptionError, match="positive number of seconds"), time_limit(seconds):
        pass


def test_a_deadline_that_has_passed_holds_at_every_state():
    deadline = Deadline(1.0)
    assert (deadline.holds(np.ones(3)), deadline.first(np.ones((2, 3)))) == (False, None)
    deadline.expire()
    assert (deadline.holds(np.ones(3)), deadline.first(np.ones((2, 3)))) == (True, 0)
