"""From events to the network states that follow one another."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

from gridfold.errors import EventError
from gridfold.grid.case import Case
from gridfold.grid.events import Change, Event
from gridfold.grid.network_state import NetworkState


class Action(NamedTuple):
    """What brought a stage about: its name, the buses where it acts, whether the state changed."""

    label: str
    buses: tuple[int, ...]
    changed: bool


class Stage(NamedTuple):
    """A network state from `start` (s) on, and what brought it about."""

    start: float
    label: str
    state: NetworkState
    actions: tuple[Action, ...] = ()


def initial_state(case: Case) -> NetworkState:
    """The network as the case describes it."""
    return NetworkState(branches_out=case.branches_out)


def build_timeline(case: Case, events: Sequence[Event], t_end: float) -> list[Stage]:
    """Network states in order of time, the first from t = 0.

    Every event is checked before anything is simulated; actions at the same instant (within a
    nanosecond) form one stage, in the order in which the events are given.
    """
    changes = [change for event in events for change in event.changes(case)]
    for change in changes:
        if max(change.time, _instant(change)) >= t_end:
            raise EventError(
                f"{change.label}: it happens at {change.time:g} s, but the run ends at {t_end:g} s"
            )
    changes.sort(key=_instant)
    state = initial_state(case)
    stages = [Stage(0.0, "start", state)]
    for time, together in groupby(changes, key=_instant):
        actions = []
        for change in together:
            before, state = state, change.apply(state)
            actions.append(Action(change.label, change.buses, state != before))
        label = ", ".join(action.label for action in actions)
        stage = Stage(time, label, state, tuple(actions))
        if time == 0.0:
            stages[0] = stage
        else:
            stages.append(stage)
    return stages


def _instant(change: Change) -> float:
    return round(change.time, 9)
