"""From events to the network states that follow one another."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

from gridfold.errors import EventError, require_list
from gridfold.grid.case import Case
from gridfold.grid.change import Change, Event
from gridfold.grid.network_state import NetworkState


class Action(NamedTuple):
    """What brought a stage about: its name, the buses where it acts, whether the state changed.

    `obstacle` tells why it could not.
    """

    label: str
    buses: tuple[int, ...]
    changed: bool
    obstacle: str = ""


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
    return compose(case, collect_changes(case, events, t_end))


def collect_changes(case: Case, events: Sequence[Event], t_end: float) -> list[Change]:
    """What the events do, each of which is checked against the case."""
    require_list(events, lambda item: hasattr(item, "changes"), "events", "[gridfold.BusFault(3)]")
    changes = [change for event in events for change in event.changes(case)]
    for change in changes:
        if max(change.time, instant(change.time)) >= t_end:
            raise EventError(
                f"{change.label}: it happens at {change.time:g} s, but the run ends at {t_end:g} s"
            )
    return changes


def compose(case: Case, changes: Sequence[Change], unforeseen: bool = False) -> list[Stage]:
    """Network states that changes lead through.

    With `unforeseen` ones among them, such as those of relays, an event that does not fit any more has
    no effect; it is an error without.
    """
    state = initial_state(case)
    stages = [Stage(0.0, "start", state)]
    in_order = sorted(changes, key=lambda change: instant(change.time))
    for time, together in groupby(in_order, key=lambda change: instant(change.time)):
        actions = []
        for change in together:
            before, obstacle = state, ""
            try:
                state = change.apply(state)
            except EventError as error:
                if not unforeseen:
                    raise
                obstacle = str(error)
            actions.append(Action(change.label, change.buses, state != before, obstacle))
        label = ", ".join(action.label for action in actions)
        stage = Stage(time, label, state, tuple(actions))
        if time == 0.0:
            stages[0] = stage
        else:
            stages.append(stage)
    return stages


def instant(time: float) -> float:
    """A time in s, rounded to what counts as one instant."""
    return round(time, 9)
