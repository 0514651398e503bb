"""A run is a list of segments: one smooth system each, until an event ends it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.watch import SpreadWatch
from gridfold.systems.protocol import System


@dataclass(frozen=True)
class Segment:
    """One smooth piece of a run.

    Parameters
    ----------
    system : System
        What is integrated.
    until : float
        Time at which the segment ends, in seconds.
    label : str
        What characterizes it, for reports ("fault at bus 3").
    watch : SpreadWatch
        Condition that ends the run early.
    """

    system: System
    until: float
    label: str = ""
    watch: SpreadWatch = field(default_factory=SpreadWatch.nothing)


@dataclass(frozen=True)
class Piece:
    """A segment that has been integrated: times (n,) and states (n, n_states), both ends included."""

    segment: Segment
    times: NDArray[np.float64]
    states: NDArray[np.float64]
