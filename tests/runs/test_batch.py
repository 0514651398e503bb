"""Runs side by side are the runs that each disturbance has by itself."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import one_machine_infinite_bus
from limited_cases import npcc_with_ieeet1, npcc_with_sexs
from side_by_side import agree, cut_off, every_kind, together

import gridfold as gf
from gridfold.errors import EventError, OptionError
from gridfold.grid.operating_point import at_operating_point
from gridfold.runs.batch import simulate_batch
from gridfold.runs.members import Member, Plans
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import simulate
from gridfold.runs.summary import summarize
from gridfold.runs.trajectory import Trajectory

ROOT = Path(__file__).parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))


def public(name: str, dyr: str | None = None, **options: object) -> gf.DetailedModel:
    path = CASES / name
    if not path.exists():
        pytest.skip(f"{path} is absent; GRIDFOLD_CASES names the folder of public cases")
    case = gf.load_case(path, None if dyr is None else CASES / dyr, **options)
    return gf.build_model(case, on_limit="adjust")


def test_all_kinds_of_events_give_the_runs_they_have_alone(npcc: gf.DetailedModel) -> None:
    runs = agree(npcc, every_kind(npcc.case))
    assert {run.status.value for run in runs} >= {"completed", "lost synchronism"}


def test_the_adams_rule_takes_runge_kutta_steps_where_it_does_alone(npcc: gf.DetailedModel) -> None:
    agree(npcc, every_kind(npcc.case), stepper=gf.AdamsBashforthMoulton4(0.02))


def test_events_of_planners_and_relays_give_the_runs_they_have_alone(
    npcc: gf.DetailedModel,
) -> None:
    case = npcc.case
    branch = case.branches[3]
    name = f"{branch.from_bus}-{branch.to_bus}"
    fault = gf.BusFault(case.buses[8].number, 0.1, 0.08)
    unit = next(g for g in case.generators if g.in_service)
    agree(
        npcc,
        [
            [fault, gf.ShuntStep(12, 80.0, time=0.2), gf.LoadShed(0.4, buses="3-7", time=0.3)],
            [gf.BranchFault(name, 0.1, 0.06), gf.BranchOpenEnd("3-2", 2, 0.25)],
            [fault, gf.LoadShed(0.1, areas="1", time=0.3)],
            [gf.Redispatch(100.0, areas="1"), fault],
            [gf.SetParameter(unit.bus, "voltage_reference", change=0.02, time=0.1)],
            [fault, gf.DistanceRelay("9-8", 8)],
            [fault],
        ],
    )


def moved(
    model: gf.DetailedModel, load: float, power_mw: float = 0.0, **factors: float
) -> gf.DetailedModel:
    """The model with other loads, power moved between two units, and parameters times factors."""
    case = model.case
    first, second = [k for k, unit in enumerate(case.generators) if unit.active_mw > 300][:2]
    shift = {first: power_mw, second: -power_mw}
    loads = [
        replace(item, active_mw=item.active_mw * load, reactive_mvar=item.reactive_mvar * load)
        for item in case.loads
    ]
    units = [
        replace(unit, active_mw=unit.active_mw + shift.get(k, 0.0))
        for k, unit in enumerate(case.generators)
    ]
    records = [
        replace(
            record,
            parameters={
                name: value * factors.get(name, 1.0) for name, value in record.parameters.items()
            },
        )
        for record in case.devices
    ]
    return model.at(gf.solve_power_flow(at_operating_point(case, loads, units, records)))


def test_each_run_may_have_an_operating_point_and_parameters_of_its_own(
    npcc: gf.DetailedModel,
) -> None:
    disturbances = every_kind(npcc.case)
    models = [
        moved(npcc, 0.94 + 0.01 * k, 20.0 * k, inertia=1.0 - 0.02 * k, damping=1.0 + 0.1 * k)
        for k in range(len(disturbances))
    ]
    models[3] = npcc
    models[5] = moved(npcc, 1.0, d_reactance=1.2, q_reactance=1.1)
    models[7] = models[6]
    runs = agree(npcc, disturbances, models=models)
    assert len({run.rotor_angle_deg()[0].tobytes() for run in runs}) == len(models) - 1
    agree(npcc, disturbances[:9], stepper=gf.AdamsBashforthMoulton4(0.02), models=models[:9])


def test_parameters_alone_leave_the_network_to_all(npcc: gf.DetailedModel) -> None:
    flow = npcc.power_flow
    models = []
    for k in range(9):
        records = [
            replace(
                r, parameters=r.parameters | {"inertia": r.parameters["inertia"] * (1 - 0.05 * k)}
            )
            if "inertia" in r.parameters
            else r
            for r in npcc.case.devices
        ]
        models.append(npcc.at(replace(flow, case=at_operating_point(npcc.case, devices=records))))
    fault = gf.BusFault(npcc.case.buses[8].number, 0.1, 0.12)
    runs = agree(npcc, [[fault]] * 9, models=models)
    swings = [np.ptp(run.rotor_angle_deg(), axis=0).max() for run in runs]
    assert np.ptp(swings) > 1.0


def test_a_model_with_other_devices_or_another_network_runs_by_itself(
    npcc: gf.DetailedModel,
) -> None:
    case, fault = npcc.case, gf.BusFault(npcc.case.buses[8].number, 0.1, 0.1)
    without = gf.build_model(replace(case, branches=(*case.branches[:3], *case.branches[4:])))
    governed = next(r for r in case.devices if r.model == "first_order_governor")
    fewer = [r for r in case.devices if r.key != governed.key or r.model != "ieee_type1"]
    other = gf.build_model(replace(case, devices=tuple(fewer)))
    models = [npcc, without, other, gf.build_model(case), npcc]
    agree(npcc, [[fault]] * 5, 0.5, models=models)


def test_limits_act_alike_at_every_operating_point(npcc: gf.DetailedModel) -> None:
    bus = npcc.case.buses[8].number
    base = gf.build_model(npcc_with_sexs(npcc, 0.2))
    models = [moved(base, 1.0 + 0.005 * k) for k in range(4)]
    disturbances = [[gf.BusFault(bus, 0.1, 0.05 + 0.02 * k)] for k in range(4)]
    agree(base, disturbances, models=models)
    runs = together(base, disturbances, models=models, every_state=True)
    for model, run in zip(models, runs, strict=True):
        block = next(block for block in model.layout.blocks if block.device.model == "sexs")
        highest = block.parameters[block.device.parameter_rows.index("field_voltage_maximum")]
        voltage = run.signal("field_voltage", block.units)
        assert (voltage.max(axis=0) > highest - 1e-6).any()


def test_a_redispatch_and_set_parameters_go_side_by_side(npcc: gf.DetailedModel) -> None:
    case, unit = npcc.case, next(g for g in npcc.case.generators if g.in_service)
    fault = gf.BusFault(case.buses[8].number, 0.1, 0.08)
    disturbances = [
        [gf.Redispatch(100.0, areas="1"), fault],
        [gf.SetParameter(unit.bus, "voltage_reference", change=0.02, time=0.1), fault],
        [gf.SetParameter(unit.bus, "inertia", change=5.0, time=0.2), fault],
        [fault],
    ]
    ready = Plans(npcc, 1.0, fit_stepper(npcc, None), None, {npcc.state: npcc}, npcc)
    assert all(isinstance(ready.ready(k, tuple(e)), Member) for k, e in enumerate(disturbances))
    agree(npcc, disturbances)


def test_members_that_end_make_room_for_the_others(npcc: gf.DetailedModel) -> None:
    buses = [bus.number for bus in npcc.case.buses[:19]]
    disturbances = [[gf.BusFault(bus, 0.05, 0.03 + 0.2 * (bus % 3))] for bus in buses]
    runs = agree(npcc, disturbances, 0.8)
    assert 3 < sum(run.status.value == "completed" for run in runs) < len(runs) - 3


def test_islands_and_dark_parts_are_those_of_runs_alone(npcc: gf.DetailedModel) -> None:
    case = npcc.case
    machine = case.generators[4].bus
    neighbours = {b.from_bus for b in case.branches if b.to_bus == machine}
    neighbours |= {b.to_bus for b in case.branches if b.from_bus == machine}
    island = cut_off(case, {machine, *neighbours}, 0.1)
    with_load = next(load.bus for load in case.loads if load.bus not in npcc.layout.terminals)
    runs = agree(
        npcc,
        [
            island,
            cut_off(case, {with_load}, 0.1),
            [*cut_off(case, {machine}, 0.1), gf.MachineTrip(machine, "1", 0.2)],
            [*island, *cut_off(case, {with_load}, 0.3), gf.BusFault(machine, 0.4, 0.05)],
        ],
    )
    assert summarize(runs[0]).cut_off.islands == 2
    assert summarize(runs[1]).cut_off.lost_load_mw > 0


def test_limits_that_act_act_alike(npcc: gf.DetailedModel) -> None:
    bus = npcc.case.buses[8].number
    for case in (npcc_with_sexs(npcc, 0.05), npcc_with_ieeet1(npcc, 0.05, "48:1")):
        model = gf.build_model(case)
        agree(model, [[gf.BusFault(bus, 0.1, 0.05 + 0.02 * k)] for k in range(4)])


def test_an_infinite_bus_is_the_reference_of_its_island() -> None:
    model = gf.build_model(one_machine_infinite_bus())
    runs = agree(model, [[gf.BusFault(1, 0.1, 0.1 + 0.15 * k)] for k in range(5)], 3.0)
    assert {run.status.value for run in runs} == {"completed", "lost synchronism"}


def test_without_a_criterion_a_lost_machine_goes_on(npcc: gf.DetailedModel) -> None:
    events = [gf.BusFault(npcc.case.buses[22].number, 0.0, 0.6)]
    (run,) = together(npcc, [events], 1.0, criterion=None)
    assert run.times[-1] == 1.0
    assert run.status is gf.Status.COMPLETED


def test_every_state_and_signal_is_there_if_asked_for(npcc: gf.DetailedModel) -> None:
    events = [gf.BusFault(npcc.case.buses[8].number, 0.1, 0.1)]
    (run,) = together(npcc, [events], 0.5, every_state=True)
    alone = simulate(npcc, events, 0.5)
    assert np.abs(run.states - alone.states).max() < 1e-12
    assert np.abs(run.bus_voltage() - alone.bus_voltage()).max() < 1e-12
    (short,) = together(npcc, [events], 0.5)
    with pytest.raises(OptionError, match="ask for every state"):
        _ = short.states


def test_what_is_wrong_with_one_is_told_and_stops_no_other(npcc: gf.DetailedModel) -> None:
    bus = npcc.case.buses[8].number
    found = dict(simulate_batch(npcc, [[gf.BusFault(999)], [gf.BusFault(bus, 0.1, 0.1)]], 0.3))
    assert isinstance(found[0], EventError)
    assert isinstance(found[1], Trajectory)


def test_a_line_that_the_case_has_open_is_closed(npcc: gf.DetailedModel) -> None:
    case = npcc.case
    first = case.branches[3]
    name = f"{first.from_bus}-{first.to_bus}:{first.circuit}"
    opened = (*case.branches[:3], replace(first, in_service=False), *case.branches[4:])
    model = gf.build_model(replace(case, branches=opened))
    agree(model, [[gf.BranchReclose(name, 0.1)], [gf.BusFault(first.from_bus, 0.1, 0.1)], []], 0.4)


def test_runs_that_cannot_go_side_by_side_say_why(npcc: gf.DetailedModel) -> None:
    with pytest.raises(OptionError, match="trapezoidal"):
        list(simulate_batch(npcc, [[]], stepper=gf.ImplicitTrapezoidal(0.01)))
    with pytest.raises(OptionError, match="2 disturbances have 1 models"):
        list(simulate_batch(npcc, [[], []], models=[npcc]))


@pytest.mark.parametrize(
    ("name", "dyr", "options"),
    [
        ("kundur/kundur.raw", "kundur/kundur_full.dyr", {"unsupported": "drop"}),
        ("npcc/npcc_curent.raw", "npcc/npcc_curent.dyr", {}),
        ("polish/Data_POLISH.mat", None, {}),
    ],
)
def test_public_cases_agree_on_every_kind_of_event(
    name: str, dyr: str | None, options: dict[str, str]
) -> None:
    model = public(name, dyr, **options)
    small = len(model.case.branches) < 20
    agree(model, every_kind_of_small(model.case) if small else every_kind(model.case))


def every_kind_of_small(case: gf.Case) -> list[list[gf.Event]]:
    """The same on a grid of ten buses."""
    bus, far = case.buses[4].number, case.buses[-1].number
    branch = case.branches[2]
    name = f"{branch.from_bus}-{branch.to_bus}:{branch.circuit}"
    unit = case.generators[1]
    return [
        [gf.BusFault(bus, 0.1, 0.0833)],
        [gf.BusFault(far, 0.1, 0.05, 0.0, 0.01)],
        [gf.BranchFault(name, 0.1, 0.05, fraction=0.4)],
        [gf.BranchTrip(name, 0.1)],
        [gf.MachineTrip(unit.bus, unit.id, 0.2)],
        [gf.LoadStep(bus, 0.1, 50.0, 5.0)],
    ]
