"""A time limit that reaches into compiled loops.

A timer sets a flag; a watch that looks at it goes along with every integration. Compiled loops do not
hold Python's interpreter lock, so the timer runs beside them, and a loop ends within one step.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from threading import Timer
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError, TimeLimitError
from gridfold.numerics.compiled import compile_callback, peek
from gridfold.numerics.watch import WATCH_SIGNATURE, CompiledWatch, Reach, Watch


@dataclass(frozen=True)
class Deadline:
    """Holds once its time is over, whatever the state.

    Parameters
    ----------
    seconds : float
        What was allowed, on the clock of the machine.
    """

    seconds: float
    _over: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    def expire(self) -> None:
        """From now on the time is over."""
        self._over[0] = 1

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return bool(self._over[0])

    def distances(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Nothing is watched of the state."""
        return np.zeros(0)

    def holds(self, x: NDArray[np.float64]) -> bool:
        """Whether the time is over."""
        return self.over

    def first(self, states: NDArray[np.float64]) -> int | None:
        """The first row once the time is over, else None."""
        return 0 if self.over and len(states) else None

    def never(self, reach: Reach) -> bool:
        """It may hold at any time."""
        return False

    def compile(self) -> CompiledWatch:
        """The condition for compiled loops: valid as long as this object is there."""
        address = np.array([self._over.ctypes.data], dtype=np.int64)
        return CompiledWatch(_compiled().address, address, np.zeros(0), n_states=0)


_current: ContextVar[Deadline | None] = ContextVar("deadline", default=None)


def check_limit(seconds: float | None) -> None:
    """Raise an OptionError unless this is no limit, or a positive number of seconds."""
    if seconds is not None and not 0 < seconds < float("inf"):
        raise OptionError(f"the time limit must be a positive number of seconds, not {seconds!r}")


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Runs of this thread within the block end with a TimeLimitError `seconds` after its beginning.

    What lies between integrations ends at the next one. None: no limit.

    Raises
    ------
    OptionError
        The limit is no positive number.
    """
    if seconds is None:
        yield
        return
    check_limit(seconds)
    deadline = Deadline(seconds)
    timer = Timer(seconds, deadline.expire)
    timer.daemon = True
    timer.start()
    before = _current.set(deadline)
    try:
        yield
    finally:
        _current.reset(before)
        timer.cancel()


def check_time() -> None:
    """Raise a TimeLimitError if the time of this thread is over."""
    deadline = _current.get()
    if deadline is not None and deadline.over:
        raise TimeLimitError(f"not done within the time limit of {deadline.seconds:g} s")


def time_watches() -> tuple[Watch, ...]:
    """What integrations of this thread have to watch besides: the time, if it is limited."""
    deadline = _current.get()
    return () if deadline is None else (deadline,)


def _deadline(integers, reals, x, verdict):
    verdict[0] = 1.0 if peek(integers[0]) != 0 else 0.0


@cache
def _compiled() -> Any:
    return compile_callback(_deadline, WATCH_SIGNATURE)
