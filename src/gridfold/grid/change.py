"""What an event is: switching actions in order of time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from gridfold.grid.case import Case
from gridfold.grid.network_state import NetworkState


class Change(NamedTuple):
    """One switching action: when, what it is called, and what it does to the network state.

    `buses` are those where it acts; if all of them are de-energized it has no effect. What only ends
    another action names none.
    """

    time: float
    label: str
    apply: Callable[[NetworkState], NetworkState]
    buses: tuple[int, ...] = ()


class Event(Protocol):
    """A disturbance of the grid."""

    def changes(self, case: Case) -> list[Change]:
        """The switching actions; raises :class:`EventError` if something is not in the case."""
