"""New England, whose governors IEEEG1 any swing takes to their rate limits, with a folded area."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.prime_movers import limited_by_any_swing, mover_limits, prime_movers
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import FoldedArea, fold
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.limit_scan import limited_units
from gridfold.equivalents.swings import sample_swings
from gridfold.runs.loading import load_psse
from gridfold.runs.method import choose_stepper

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
#: The north east: four machines, joined to the other six by buses 15 and 16.
STUDY = (15, 16, 19, 20, 21, 22, 23, 24, 33, 34, 35, 36)
T_END, LARGEST_DEG = 10.0, 0.5
EVERYWHERE_LINEAR = gf.SwitchingRule(float("inf"))
Change = tuple[tuple[str, float], ...]


def new_england(change: Change = ()) -> gf.Case:
    for name in ("ieee39/IEEE39.raw", "ieee39/IEEE39.dyr"):
        if not (CASES / name).is_file():
            pytest.skip(
                f"{CASES / name} is absent; GRIDFOLD_CASES names the folder of public cases"
            )
    raw, dyr = CASES / "ieee39/IEEE39.raw", CASES / "ieee39/IEEE39.dyr"
    case = load_psse(raw, dyr, unsupported="drop", allow_unsupported_network=True).case
    devices = tuple(
        replace(record, parameters={**record.parameters, **dict(change)})
        if record.model == "ieeeg1"
        else record
        for record in case.devices
    )
    return replace(case, devices=devices)


@cache
def parts_of(change: Change = ()) -> gf.Partition:
    return gf.partition(gf.build_model(new_england(change)), STUDY)


@cache
def folded(n_retained: int, change: Change = ()) -> gf.SmallModels:
    parts = parts_of(change)
    return gf.SmallModels(fold(parts, parts.external_units[:n_retained]))


def largest_deg(parts: gf.Partition, run: gf.Trajectory, other: gf.Trajectory) -> float:
    """Largest difference of a study machine's angle against the centre of inertia, in degrees."""
    model = parts.model
    inertia, slots = model.inertia(model.machines), model.slots("rotor_angle", model.machines)
    own = [unit in parts.study_units for unit in model.machines]
    n = min(len(run.times), len(other.times))
    np.testing.assert_allclose(run.times[:n], other.times[:n], atol=1e-9)
    change = run.states[:n, slots] - other.states[:n, slots]
    relative = change - (change @ inertia / inertia.sum())[:, None]
    return float(np.rad2deg(np.abs(relative[:, own]).max()))


def errors_and_run(bus: int, n_retained: int, change: Change = ()):
    parts, events = parts_of(change), [gf.BusFault(bus, duration=0.1)]
    stepper = choose_stepper(parts.model).stepper
    detailed = gf.simulate(parts.model, events, T_END, stepper)
    small = folded(n_retained, change)
    run = gf.simulate_adaptive(
        parts.model, small, EVERYWHERE_LINEAR, events, T_END, stepper=stepper
    )
    assert detailed.status is run.trajectory.status is gf.Status.COMPLETED
    return largest_deg(parts, detailed, run.trajectory), run


def test_no_limit_acts_at_the_operating_point_and_any_swing_reaches_those_of_all_governors():
    model = parts_of().model
    assert gf.SmallModels(fold(parts_of())).family.held_at_limits(Mode.LINEAR) == ()
    assert limited_by_any_swing(model, model.x0, model.machines) == model.machines
    slow = parts_of((("opening_rate", 10.0), ("closing_rate", -10.0))).model
    assert limited_by_any_swing(slow, slow.x0, slow.machines) == ()


@pytest.mark.parametrize("bus", [15, 21, 24, 33])
@pytest.mark.parametrize("n_retained", [0, 2])
def test_runs_at_the_rate_limits_follow_the_detailed_one_and_do_not_fall_back(bus, n_retained):
    error, run = errors_and_run(bus, n_retained)
    mode = Mode.RETAINED if n_retained else Mode.LINEAR
    assert [(s.time, s.after) for s in run.switches] == [(0.0, Mode.DETAILED), (0.1, mode)]
    assert error < LARGEST_DEG
    assert not any("no limit here" in notice.text for notice in run.trajectory.notices)


def test_governors_that_are_blocked_are_followed_too():
    """Linearized with their gates free, they were 5.4 degrees off; swings are larger than above."""
    error, run = errors_and_run(21, 0, (("opening_rate", 0.0), ("closing_rate", 0.0)))
    assert [s.after for s in run.switches] == [Mode.DETAILED, Mode.LINEAR]
    assert error < 0.7


def test_the_folded_model_and_its_exact_prime_movers_stand_still_at_the_operating_point():
    family, model = folded(0).family, parts_of().model
    assert isinstance(family, FoldedArea)
    assert family.governed == tuple(u for u in parts_of().external_units if u in model.machines)
    small = family.build(Mode.LINEAR, model)
    start = small.coordinates.restrict(model.x0)
    assert np.abs(small.system.compiled(start)).max() < 1e-8
    assert small.followed == mover_limits(model, family.governed)


def test_slopes_in_the_power_and_the_speed_are_those_of_the_whole_jacobian():
    """Behind the power of IEEEG1 stands its gate: T4 is zero, and K1 passes the gate on at once."""
    model = parts_of().model
    unit = model.machines[0]
    movers = prime_movers(model, model.x0, [unit])
    assert not movers.direct.any()
    gate = model.slots("gate", (unit,))[0]
    at = model.slots("speed", (unit,))[0]
    power = model.slots("mechanical_power", (unit,))
    moved = np.stack([model.x0, model.x0])
    moved[1, gate] += 1e-3
    per_gate = float(np.diff(model.signals(moved, power)[:, 0])[0] / 1e-3)
    assert model.jacobian(model.x0)[at, gate] == pytest.approx(movers.slopes[at, 0] * per_gate)


def test_the_scan_finds_external_machines_whose_exciters_reach_limits():
    parts = parts_of()
    samples = [[gf.BusFault(bus, duration=0.1)] for bus in (38, 21, 32)]
    found = limited_units(parts, sample_swings(parts, samples, t_end=2.0))
    assert [unit.bus for unit, _ in found] == [32, 38]
    assert [limits[0] for _, limits in found] == ["VRMAX of ieeet1 32:1", "VRMAX of ieeet1 38:1"]
    assert limited_units(parts, sample_swings(parts, t_end=2.0)) == ()


def test_a_ladder_is_climbed_where_a_rung_that_is_linear_throughout_is_at_a_limit():
    parts, events = parts_of(), [gf.BusFault(21, duration=0.1)]
    ladder = gf.SmallModels(
        Ladder((fold(parts, parts.external_units[:2]), fold(parts)), whole=True)
    )
    rule = gf.SwitchingRule(10.0, whole_deg=3.0, dwell=0.5)
    run = gf.simulate_adaptive(parts.model, ladder, rule, events, T_END)
    climbed = [switch for switch in run.switches if "reached" in switch.reason]
    assert climbed
    assert {switch.after for switch in climbed} == {Mode.LINEAR}
    assert largest_deg(parts, gf.simulate(parts.model, events, T_END), run.trajectory) < LARGEST_DEG


def test_about_another_operating_point_the_prime_movers_stay_exact():
    parts = parts_of()
    events = [gf.BranchTrip("21-22", time=0.1)]
    detailed = gf.simulate(parts.model, events, T_END)
    run = gf.simulate_adaptive(parts.model, folded(0), EVERYWHERE_LINEAR, events, T_END)
    assert {switch.after for switch in run.switches} == {Mode.LINEAR}
    assert largest_deg(parts, detailed, run.trajectory) < LARGEST_DEG
