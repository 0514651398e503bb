"""What solves the contingencies of a study, whatever it consists of."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass

from gridfold.study.solve import Batch, Solved

Solving = Future[tuple[Solved, ...]]
Submit = Callable[[Batch], Solving]


@dataclass(frozen=True)
class Team:
    """Workers at the ready: how many, what they are, and how to give them tasks."""

    count: int
    description: str
    submit: Submit
