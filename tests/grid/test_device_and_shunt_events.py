"""Shunts, shares of load, parameters and dispatch: what each event does to the network state."""

from __future__ import annotations

from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.grid.network_state import Setting
from gridfold.grid.timeline import build_timeline, initial_state


@pytest.fixture(scope="module")
def zoned(ring) -> gf.Case:
    """The ring with two areas and two zones: bus 4 is area 2 and zone 5."""
    buses = tuple(replace(bus, area=2, zone=5) if bus.number == 4 else bus for bus in ring.buses)
    return replace(ring, buses=buses)


def last(case: gf.Case, *events: gf.grid.change.Event) -> gf.grid.network_state.NetworkState:
    return build_timeline(case, events, 10.0)[-1].state


@pytest.mark.parametrize(
    ("where", "shed"),
    [
        ({"buses": "2"}, {2}),
        ({"buses": "1-4"}, {2, 4}),
        ({"areas": "2"}, {4}),
        ({"zones": "5", "buses": "2"}, {2, 4}),
    ],
)
def test_a_share_is_shed_wherever_one_of_the_texts_names_load(zoned, where, shed):
    state = last(zoned, gf.LoadShed(0.25, **where))
    assert state.load_shed == tuple((bus, 0.25) for bus in sorted(shed))


def test_shares_add_up_and_are_told_in_megawatts(zoned):
    events = [gf.LoadShed(0.1, areas="1-2", time=1.0), gf.LoadShed(0.2, buses="2", time=2.0)]
    stages = build_timeline(zoned, events, 10.0)
    assert dict(stages[-1].state.load_shed) == pytest.approx({2: 0.3, 4: 0.1})
    # 10 % of 40 and 60 MW; 20 % of 40 MW.
    assert [stage.label for stage in stages[1:]] == [
        "10 % of the load at areas 1-2 shed, 10.0 MW",
        "20 % of the load at buses 2 shed, 8.0 MW",
    ]


@pytest.mark.parametrize(
    ("events", "message"),
    [
        ([gf.LoadShed(0.5)], "say where, by buses, areas or zones"),
        ([gf.LoadShed(1.5, buses="2")], "share must be more than 0 and at most 1"),
        ([gf.LoadShed(0.5, buses="1")], "there is no load in service"),
        ([gf.LoadShed(0.5, areas="9")], "there is no area 9"),
        (
            [gf.LoadShed(0.6, buses="2"), gf.LoadShed(0.6, buses="2", time=1.0)],
            "at bus 2 0.6 of the load is shed already at 1 s",
        ),
        ([gf.ShuntTrip(4)], "there is no such shunt .at bus 4: none."),
        ([gf.ShuntStep(2, float("inf"))], "susceptance_mvar must be finite"),
        ([gf.BranchOpenEnd("2-3", 4)], "its ends are buses 2 and 3"),
        ([gf.BranchOpenEnd("4-1", 1)], "it is open at 0 s"),
        ([gf.BranchFault("2-3", far_duration=0.2, trip=False)], "far_duration is of a branch"),
        ([gf.BranchFault("2-3", far_duration=-0.2)], "far_duration must be a positive number"),
        ([gf.SetParameter(3, "inertia")], "give value or change"),
        ([gf.SetParameter(3, "inertia", 1.0, 2.0)], "give value or change"),
        ([gf.SetParameter(3, "inertia", change=0.0)], "change is 0"),
        (
            [gf.MachineTrip(3), gf.SetParameter(3, "inertia", 1.0, time=1.0)],
            "the unit is out of service at 1 s",
        ),
        ([gf.SetParameter(3, "inertia", 1.0, id="9")], "no such unit in service"),
        ([gf.SetParameter(3, "inertia", 1.0, model="sexs")], "no device 'sexs'; it has: classical"),
        ([gf.Redispatch(10.0, areas="1", zones="77")], "there is no zone 77"),
        ([gf.Redispatch(10.0, buses="1")], "no unit in service with positive power"),
        ([gf.Redispatch(-40.0, buses="3")], "would give -10 MW"),
    ],
)
def test_what_does_not_fit_is_an_error_that_says_why(ring, events, message):
    with pytest.raises(gf.EventError, match=message):
        build_timeline(ring, events, 10.0)


def test_a_shunt_is_switched_out_and_in_again(ring):
    events = [gf.ShuntTrip(2, time=1.0), gf.ShuntTrip(2, time=2.0), gf.ShuntClose(2, time=3.0)]
    stages = build_timeline(ring, events, 10.0)
    assert [stage.state.shunts_switched for stage in stages] == [set(), {0}, {0}, set()]
    assert [stage.actions[0].changed for stage in stages[1:]] == [True, False, True]


def test_steps_of_shunts_at_a_bus_add_up_and_cancel(ring):
    up, down = gf.ShuntStep(2, 30.0, 1.0), gf.ShuntStep(2, -30.0, -1.0, time=1.0)
    assert last(ring, up).shunt_steps == ((2, 1 + 30j),)
    assert last(ring, up, down) == initial_state(ring)


def test_one_end_then_the_other_is_a_trip_and_reclosing_closes_both(ring):
    first, second = gf.BranchOpenEnd("2-3", 3, 1.0), gf.BranchOpenEnd("3-2", 2, 2.0)
    assert last(ring, first).open_ends == {(2, 1)}
    assert last(ring, first).severed == {2, 4}
    assert last(ring, first, second) == last(ring, gf.BranchTrip("2-3"))
    for opened in ([first], [first, second]):
        assert last(ring, *opened, gf.BranchReclose("2-3", 3.0)) == initial_state(ring)


@pytest.mark.parametrize("name", ["2-3", "3-2"])
def test_the_end_named_first_opens_after_duration_and_the_other_after_far_duration(ring, name):
    near = int(name[0])
    fault = gf.BranchFault(name, 1.0, 0.1, fraction=0.25, far_duration=0.4)
    stages = build_timeline(ring, [fault], 10.0)
    assert [stage.start for stage in stages] == [0.0, 1.0, 1.1, 1.4]
    assert stages[2].label == f"branch {name} opened at bus {near}"
    assert stages[2].state.open_ends == {(2, 0 if near == 2 else 1)}
    assert stages[2].state.faulted
    assert stages[3].state == last(ring, gf.BranchTrip("2-3"))
    swapped = build_timeline(ring, [replace(fault, duration=0.4, far_duration=0.1)], 10.0)
    assert swapped[2].label == f"branch {name} opened at bus {5 - near}"


def test_a_fault_at_a_breaker_leaves_the_bus_with_it(ring):
    fault = gf.BranchFault("2-3", 1.0, 0.1, fraction=0.0, far_duration=0.4)
    _, on, half, off = build_timeline(ring, [fault], 10.0)
    assert list(on.state.bus_shorts(ring)) == [(2, 0j)]
    assert list(half.state.bus_shorts(ring)) == []
    assert half.state.faulted
    assert not off.state.faulted


def test_settings_keep_the_last_value_and_add_up_changes(ring):
    events = [
        gf.SetParameter(3, "inertia", change=1.0, time=1.0),
        gf.SetParameter(3, "inertia", value=5.0, time=2.0),
        gf.SetParameter(3, "inertia", change=-0.5, time=3.0),
        gf.SetParameter(3, "inertia", change=-0.25, time=4.0),
    ]
    unit = gf.UnitKey(3, "1")
    assert last(ring, events[0]).settings == (Setting(unit, "", "inertia", None, 1.0),)
    assert last(ring, *events).settings == (Setting(unit, "", "inertia", 5.0, -0.75),)


def test_redispatch_is_shared_in_proportion_and_leaves_slack_buses_alone(ring):
    more = replace(
        ring,
        generators=(
            *ring.generators,
            gf.Generator(4, active_mw=10.0),
            gf.Generator(2, active_mw=-5.0),
        ),
    )
    state = last(more, gf.Redispatch(8.0, areas="1"))
    # 30 MW at bus 3 and 10 MW at bus 4; bus 1 is the slack's, the unit at bus 2 takes power.
    assert dict(state.dispatch) == pytest.approx({gf.UnitKey(3, "1"): 6.0, gf.UnitKey(4, "1"): 2.0})
    back = last(more, gf.Redispatch(8.0, areas="1"), gf.Redispatch(-8.0, buses="3-4"))
    assert back == initial_state(more)
