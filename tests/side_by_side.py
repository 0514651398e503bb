"""Runs side by side, compared with those that each disturbance has by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import gridfold as gf
from gridfold.runs.batch import simulate_batch
from gridfold.runs.simulate import simulate
from gridfold.runs.summary import summarize
from gridfold.runs.trajectory import Trajectory

DEGREE = 1e-9
#: Longer than any step, shorter than a swing: enough for every event to have acted.
T_END = 1.2


def every_kind(case: gf.Case) -> list[list[gf.Event]]:
    """Every kind of event, at times on and off the grid of steps."""
    branch = case.branches[3]
    name = f"{branch.from_bus}-{branch.to_bus}"
    other = case.branches[10]
    second = f"{other.from_bus}-{other.to_bus}"
    unit = next(g for g in case.generators if g.in_service)
    bus = case.buses[8].number
    return [
        [],
        [gf.BusFault(bus, 0.1, 0.1)],
        [gf.BusFault(bus, 0.1033, 0.0871, 0.001, 0.02)],
        [gf.BusFault(case.buses[20].number, 0.0, 0.05, trip_bus=True)],
        [gf.BranchFault(name, 0.1, 0.0777)],
        [gf.BranchFault(name, 0.1, 0.08, fraction=0.37)],
        [gf.BranchFault(second, 0.1, 0.08, fraction=0.6, reactance=0.03, trip=False)],
        [gf.BranchTrip(name, 0.2), gf.BranchReclose(name, 0.4567)],
        [gf.MachineTrip(unit.bus, unit.id, 0.15)],
        [gf.LoadStep(bus, 0.1, 120.0, -40.0), gf.LoadStep(bus, 0.5, -200.0, 10.0)],
        [
            gf.BusFault(bus, 0.1, 0.1),
            gf.BranchTrip(second, 0.2),
            gf.MachineTrip(unit.bus, unit.id, 0.3),
        ],
        [gf.BusFault(case.buses[22].number, 0.1, 1.0)],
    ]  # fmt: skip


def cut_off(case: gf.Case, buses: set[int], time: float) -> list[gf.Event]:
    """Trips of all branches between some buses and the rest."""
    counts: dict[tuple[int, int], int] = {}
    events: list[gf.Event] = []
    for branch in case.branches:
        if branch.in_service and (branch.from_bus in buses) != (branch.to_bus in buses):
            pair = branch.from_bus, branch.to_bus
            counts[pair] = counts.get(pair, 0) + 1
            events.append(gf.BranchTrip(f"{pair[0]}-{pair[1]}:{branch.circuit}", time))
    return events


def together(
    model: gf.DetailedModel,
    disturbances: Sequence[Sequence[gf.Event]],
    t_end: float = T_END,
    stepper: gf.Stepper | None = None,
    **options: object,
) -> list[Trajectory]:
    found = dict(simulate_batch(model, disturbances, t_end, stepper, **options))
    runs = [found[number] for number in range(len(disturbances))]
    for run in runs:
        assert isinstance(run, Trajectory), run
    return runs


def agree(
    model: gf.DetailedModel,
    disturbances: Sequence[Sequence[gf.Event]],
    t_end: float = T_END,
    stepper: gf.Stepper | None = None,
    models: Sequence[gf.DetailedModel] | None = None,
) -> list[Trajectory]:
    """Runs side by side, of which all that is kept is compared with the runs one by one."""
    runs = together(model, disturbances, t_end, stepper, models=models)
    each = [model] * len(runs) if models is None else models
    for events, own, run in zip(disturbances, each, runs, strict=True):
        alone = simulate(own, events, t_end, stepper)
        assert run.model is own
        assert np.array_equal(run.times, alone.times), events
        assert (run.status, run.culprit) == (alone.status, alone.culprit), events
        assert run.notices == alone.notices
        assert run.run.step_count == alone.run.step_count
        apart = np.abs(run.rotor_angle_deg() - alone.rotor_angle_deg())
        assert np.nanmax(apart, initial=0.0) < DEGREE, events
        assert np.nanmax(np.abs(run.signal("speed") - alone.signal("speed")), initial=0.0) < 1e-12
        here, there = summarize(run), summarize(alone)
        for found, known in (
            (here.lowest_voltage, there.lowest_voltage),
            (here.highest_voltage, there.highest_voltage),
        ):
            assert (found is None) == (known is None), events
            if found is not None and known is not None:
                assert found.value == pytest.approx(known.value, abs=1e-11), events
        assert here.cut_off == there.cut_off
    return runs
