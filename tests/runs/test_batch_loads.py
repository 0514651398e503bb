"""Runs side by side with loads that are no impedances are the runs that each has by itself."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest
from device_alone import named
from limited_cases import npcc_with_sexs
from side_by_side import agree, cut_off, every_kind

import gridfold as gf
from gridfold.grid.dc_lines import LineControl, ThyristorEnd, ThyristorLine
from gridfold.runs.members import Plans

ROOT = Path(__file__).parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
STEPPER = gf.RungeKutta4(0.01)
SHARES = gf.LoadModel((0.2, 0.3, 0.5))
LINE = ThyristorLine(
    "D", LineControl.POWER, 60.0, 5.0, 200.0,
    ThyristorEnd(12, 2, 20.0, 5.0, 0.0, 6.0, 230.0, 0.45, 1.02),
    ThyristorEnd(40, 2, 22.0, 15.0, 0.0, 5.0, 115.0, 0.9, 1.01),
)  # fmt: skip
IEEL = (0.4, 0.1, 0.5, 0.3, 0.1, 0.6, 2.0, -1.8, 2.0, 1.3, 0.0, 2.0, 1.0, 0.4)


@pytest.fixture(scope="module")
def mixed(npcc: gf.DetailedModel) -> gf.DetailedModel:
    """NPCC with a share of each kind of load."""
    return gf.build_model(npcc.case, loads=SHARES)


@pytest.fixture
def by_themselves(monkeypatch: pytest.MonkeyPatch) -> list[tuple[gf.Event, ...]]:
    """Disturbances that had to run by themselves, as they come."""
    found: list[tuple[gf.Event, ...]] = []
    alone = Plans.alone

    def noted(self: Plans, events: tuple[gf.Event, ...]) -> object:
        found.append(events)
        return alone(self, events)

    monkeypatch.setattr(Plans, "alone", noted)
    return found


def test_all_kinds_of_events_give_the_runs_they_have_alone(
    mixed: gf.DetailedModel, by_themselves: list[tuple[gf.Event, ...]]
) -> None:
    runs = agree(mixed, every_kind(mixed.case), stepper=STEPPER)
    assert {run.status.value for run in runs} >= {"completed", "lost synchronism"}
    assert not by_themselves


def test_loads_of_constant_power_alone_do_with_the_adams_rule(npcc: gf.DetailedModel) -> None:
    model = gf.build_model(npcc.case, loads=gf.LoadModel((1.0, 0.0, 0.0)))
    agree(model, every_kind(model.case), stepper=gf.AdamsBashforthMoulton4(0.01))


def test_what_the_shared_factors_do_not_solve_runs_by_itself(
    npcc: gf.DetailedModel, by_themselves: list[tuple[gf.Event, ...]]
) -> None:
    model = gf.build_model(npcc.case, loads=gf.LoadModel((1.0, 0.0, 0.0)))
    hard, easy = [gf.BusFault(37, 0.1, 0.07)], [gf.BusFault(61, 0.1, 0.07)]
    agree(model, [hard, easy], 0.4, STEPPER)
    assert by_themselves == [tuple(hard)]


def test_loads_without_a_solution_end_a_run_as_it_ends_alone(
    by_themselves: list[tuple[gf.Event, ...]],
) -> None:
    raw, dyr = (CASES / "kundur" / name for name in ("kundur.raw", "kundur_full.dyr"))
    if not raw.exists():
        pytest.skip(f"{raw} is absent; GRIDFOLD_CASES names the folder of public cases")
    case = gf.load_case(raw, dyr, unsupported="drop")
    model = gf.build_model(case, on_limit="adjust", loads=gf.LoadModel((1.0, 0.0, 0.0)))
    bus = case.buses[7].number
    disturbances = [[gf.BusFault(bus, 0.1, duration)] for duration in (0.05, 0.4)]
    runs = agree(model, disturbances, 2.0, gf.RungeKutta4(0.005))
    assert [run.status.value for run in runs] == ["completed", "not finite"]
    assert tuple(disturbances[1]) in by_themselves


def test_what_is_shed_is_shed_of_every_part_of_a_load(
    mixed: gf.DetailedModel, by_themselves: list[tuple[gf.Event, ...]]
) -> None:
    fault = gf.BusFault(mixed.case.buses[8].number, 0.1, 0.08)
    agree(
        mixed,
        [
            [fault, gf.LoadShed(0.4, buses="3-7", time=0.3)],
            [fault, gf.ShuntStep(12, 80.0, time=0.2)],
            [fault],
            [gf.LoadShed(1.0, buses="3-4", time=0.1), gf.LoadStep(3, 0.2, 50.0, 10.0)],
        ],
        stepper=STEPPER,
    )
    assert not by_themselves


def test_islands_and_dark_parts_are_those_of_runs_alone(
    mixed: gf.DetailedModel, by_themselves: list[tuple[gf.Event, ...]]
) -> None:
    case = mixed.case
    machine = case.generators[4].bus
    neighbours = {b.from_bus for b in case.branches if b.to_bus == machine}
    neighbours |= {b.to_bus for b in case.branches if b.from_bus == machine}
    machines = {unit.bus for unit in mixed.machines}
    with_load = next(load.bus for load in case.loads if load.bus not in machines)
    agree(
        mixed,
        [
            cut_off(case, {machine, *neighbours}, 0.1),
            cut_off(case, {with_load}, 0.1),
            [*cut_off(case, {machine}, 0.1), gf.MachineTrip(machine, "1", 0.2)],
            [*cut_off(case, {with_load}, 0.3), gf.BusFault(machine, 0.4, 0.05)],
        ],
        stepper=STEPPER,
    )
    assert not by_themselves


def test_limits_that_act_act_alike(npcc: gf.DetailedModel) -> None:
    model = gf.build_model(npcc_with_sexs(npcc, 0.05), loads=SHARES)
    bus = model.case.buses[8].number
    agree(model, [[gf.BusFault(bus, 0.1, 0.05 + 0.02 * k)] for k in range(4)], stepper=STEPPER)


def test_ends_of_a_dc_line_and_other_powers_of_the_voltage(
    npcc: gf.DetailedModel, by_themselves: list[tuple[gf.Event, ...]]
) -> None:
    load = next(load for load in npcc.case.loads if load.bus == 3)
    record = gf.DeviceRecord("ieel", 3, f"load-{load.id}", named("ieel", IEEL))
    case = replace(npcc.case, dc_lines=(LINE,), devices=(*npcc.case.devices, record))
    model = gf.build_model(case)
    agree(
        model,
        [
            [gf.BusFault(LINE.buses[0], 0.1, 0.08)],
            [gf.BusFault(LINE.buses[1], 0.1, 0.05, 0.0, 0.05)],
            cut_off(case, {LINE.buses[1]}, 0.2),
            [gf.BusFault(3, 0.1, 0.1)],
        ],
        stepper=STEPPER,
    )
    assert not by_themselves
