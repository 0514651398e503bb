"""What every stepper offers, and the grid of times on which it works."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.checked_arrays import checked_state
from gridfold.numerics.rhs import CompiledRhs
from gridfold.numerics.watch import Watch, pack_watches


@dataclass(frozen=True)
class Integration:
    """States on the time grid, shape (n_done, n_states).

    `fired` is the number, counted from 1, of the watch that ended the integration early, else 0.
    """

    states: NDArray[np.float64]
    fired: int


class Stepper(Protocol):
    """A rule that carries x' = f(x) along a grid of times."""

    @property
    def name(self) -> str:
        """Short name, as on the command line."""

    @property
    def step(self) -> float:
        """Time step in seconds."""

    @property
    def fixed_step(self) -> bool:
        """Whether it takes this step; if not, it is the distance of samples, and steps are chosen."""

    def growth(self, z: complex) -> float:
        """Factor by which a step h changes the size of y in y' = lambda y, where z = h lambda."""

    def integrate(
        self,
        rhs: CompiledRhs,
        times: NDArray[np.float64],
        x0: NDArray[np.float64],
        watches: Sequence[Watch] = (),
    ) -> Integration:
        """Integrate from ``x0`` at ``times[0]`` until a watch fires; the result includes the start."""


def run_loop(
    loop: Callable[..., Any],
    step: float,
    rhs: CompiledRhs,
    times: NDArray[np.float64],
    x0: NDArray[np.float64],
    watches: Sequence[Watch],
) -> Integration:
    """Run the compiled loop of a stepper, which fills the states and returns (steps, watch fired)."""
    states = np.empty((len(times), rhs.n_states))
    states[0] = checked_state(x0, rhs.n_states).reshape(rhs.n_states)
    done, fired = loop(
        rhs.address, rhs.after_step, rhs.integers, rhs.reals, np.zeros(rhs.work_size), times, step,
        states, *pack_watches(watches, rhs.n_states),
    )  # fmt: skip
    return Integration(states[: done + 1], fired)


def check_step(step: float) -> None:
    """Raise :class:`OptionError` unless `step` is a positive, finite number of seconds."""
    number = isinstance(step, int | float | np.integer | np.floating) and step is not True
    if not (number and np.isfinite(step) and step > 0):
        raise OptionError(f"the time step must be a positive number of seconds, not {step!r}")


def time_grid(start: float, end: float, step: float) -> NDArray[np.float64]:
    """Both ends of an interval and every multiple of `step` between them.

    All runs with the same step share their sampling times, whatever the events between; a step that
    an event cuts short is shorter, never longer. Points closer than 1e-6 of a step to an end are
    dropped.
    """
    first = int(np.floor(start / step + 1e-6)) + 1
    last = int(np.ceil(end / step - 1e-6)) - 1
    inner = np.round(np.arange(first, last + 1) * step, 12)
    return np.concatenate(([start], inner, [end]))
