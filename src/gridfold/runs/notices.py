"""What each stage of a run does to the network, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.dc_ends import dead_lines
from gridfold.grid.islands import Islands
from gridfold.grid.timeline import Stage

_LISTED = 8


class Notice(NamedTuple):
    """Something the user should know: when (s), and what."""

    time: float
    text: str


def stage_notices(stages: Sequence[Stage], models: Sequence[DetailedModel]) -> tuple[Notice, ...]:
    """Events, those that had no effect, de-energized parts with their lost load, and new islands.

    They are in order of time. `models` are those of the stages; further ones are not looked at.
    """
    notices: list[Notice] = []
    before: DetailedModel | None = None
    for stage, model in zip(stages, models, strict=False):
        if stage.label != "start":
            notices.append(Notice(stage.start, stage.label))
        texts = (
            *_idle_texts(stage, before, model),
            *_island_texts(before, model),
            *_dc_texts(before, model),
        )
        notices += [Notice(stage.start, text) for text in texts]
        before = model
    return tuple(notices)


def in_order(*notices: Notice) -> tuple[Notice, ...]:
    """Notices in order of time; those of one time as they come."""
    return tuple(sorted(notices, key=lambda notice: notice.time))


def _idle_texts(stage: Stage, before: DetailedModel | None, model: DetailedModel) -> Iterator[str]:
    """Actions without effect: on buses without voltage before and after, or on what is so already."""
    index, on = model.case.bus_index, model.equations.islands.energized
    if before is not None:
        on = on | before.equations.islands.energized
    for action in stage.actions:
        if action.obstacle:
            yield f"{action.label}: no effect, {action.obstacle}"
        elif not action.changed:
            yield f"{action.label}: no effect, it was so already"
        elif action.buses and not on[[index[bus] for bus in action.buses]].any():
            yield f"{action.label}: no effect, {_name(action.buses)} de-energized"


def _island_texts(before: DetailedModel | None, model: DetailedModel) -> Iterator[str]:
    now = model.equations.islands
    whole = before is None and now.energized.all() and not now.labels.any()
    if whole or (before is not None and _same(before.equations.islands, now)):
        return
    known: set[frozenset[int]] = set()
    dead_before: set[int] = set()
    case = model.case
    if before is not None:
        old = before.equations.islands
        known = {frozenset(buses) for buses in old.members(case).values()}
        dead_before = {
            bus.number for bus, on in zip(case.buses, old.energized, strict=True) if not on
        }
    islands = now.members(case)
    load = model.power_flow.load_power.real * case.base_mva
    machines = [unit for unit in model.layout.source_units if unit not in model.state.units_out]
    for label, buses in islands.items():
        energized = bool(now.energized[case.bus_index[buses[0]]])
        if not energized:
            lost = [bus for bus in buses if bus not in dead_before]
            if lost:
                mw = float(np.sum(load[[case.bus_index[bus] for bus in lost]]))
                yield f"{_name(lost)} de-energized, {mw:.1f} MW of load lost"
        elif frozenset(buses) not in known and label != now.main:
            units = ", ".join(str(unit) for unit in machines if unit.bus in set(buses))
            how = "runs on as an island of its own" if len(buses) == 1 else "run on as an island"
            yield f"{_name(buses)} {how} with machines {units}"
    dead_now = {bus.number for bus, on in zip(case.buses, now.energized, strict=True) if not on}
    back = sorted(dead_before - dead_now)
    if back:
        yield f"{_name(back)} energized again"


def _dc_texts(before: DetailedModel | None, model: DetailedModel) -> Iterator[str]:
    """Dc lines that stop, or carry power again, as an end is de-energized or energized."""
    was, now = (
        set() if one is None else set(dead_lines(one.power_flow, one.equations.islands))
        for one in (before, model)
    )
    for line in model.case.dc_lines:
        if line in now - was:
            yield f"{line} carries nothing: an end is de-energized"
        elif line in was - now:
            yield f"{line} carries its power again"


def _same(before: Islands, now: Islands) -> bool:
    same = np.array_equal(before.labels, now.labels)
    return same and np.array_equal(before.energized, now.energized)


def _name(buses: Sequence[int]) -> str:
    shown = ", ".join(str(bus) for bus in buses[:_LISTED])
    more = f" and {len(buses) - _LISTED} more" if len(buses) > _LISTED else ""
    return f"{'bus' if len(buses) == 1 else 'buses'} {shown}{more}"
