from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.grid.event_checks import find_branch
from gridfold.grid.events import EVENTS
from gridfold.grid.network_state import BranchFaultPoint, NetworkState
from gridfold.grid.timeline import initial_state

AT_2_3 = 2  # position of branch 2-3 in the ring


def through(case, event):
    """States after each change of an event, from the case's own."""
    state, states = initial_state(case), []
    for change in event.changes(case):
        state = change.apply(state)
        states.append(state)
    return states


def times(case, event):
    return [change.time for change in event.changes(case)]


def test_every_kind_of_event_has_a_name():
    assert set(EVENTS.values()) == {
        gf.BusFault,
        gf.BranchFault,
        gf.BranchTrip,
        gf.BranchOpenEnd,
        gf.BranchReclose,
        gf.MachineTrip,
        gf.LoadStep,
        gf.LoadShed,
        gf.ShuntTrip,
        gf.ShuntClose,
        gf.ShuntStep,
        gf.SetParameter,
        gf.Redispatch,
    }


def test_bus_fault_is_on_for_its_duration_and_leaves_nothing(ring):
    event = gf.BusFault(2, start=1.0, duration=0.25, resistance=0.01, reactance=0.02)
    on, off = through(ring, event)
    assert on == replace(initial_state(ring), bus_faults=frozenset({(2, 0.01 + 0.02j)}))
    assert on.faulted
    assert off == initial_state(ring)
    assert not off.faulted
    assert times(ring, event) == [1.0, 1.25]


def test_trip_bus_opens_every_branch_at_the_bus(ring):
    _, off = through(ring, gf.BusFault(2, trip_bus=True))
    assert off == NetworkState(branches_out=frozenset({0, 1, 2, 4}))


def test_branch_fault_is_cleared_by_tripping_the_branch(ring):
    event = gf.BranchFault("2-3", start=0.5, duration=0.1, fraction=0.25, reactance=0.01)
    on, off = through(ring, event)
    point = BranchFaultPoint(AT_2_3, 0.25, 0.01j)
    assert on == replace(initial_state(ring), branch_faults=frozenset({point}))
    assert on.faulted
    assert off == NetworkState(branches_out=frozenset({AT_2_3, 4}))
    assert times(ring, event) == [0.5, 0.6]


def test_branch_fault_without_trip_leaves_nothing(ring):
    _, off = through(ring, gf.BranchFault("2-3", fraction=0.5, trip=False))
    assert off == initial_state(ring)


def test_fraction_counts_from_the_bus_named_first(ring):
    on, _ = through(ring, gf.BranchFault("3-2", fraction=0.25))
    assert [point.fraction for point in on.branch_faults] == [0.75]


@pytest.mark.parametrize(
    ("name", "fraction", "bus"),
    [("2-3", 0.0, 2), ("2-3", 1.0, 3), ("3-2", 0.0, 3), ("3-2", 1.0, 2), ("4-3", 0.0, 4)],
)
@pytest.mark.parametrize("off_by", [0.0, 1e-12])
def test_branch_fault_at_an_end_is_a_fault_at_that_bus(ring, name, fraction, bus, off_by):
    event = gf.BranchFault(name, fraction=abs(fraction - off_by), resistance=0.1)
    on, off = through(ring, event)
    assert list(on.bus_shorts(ring)) == [(bus, 0.1 + 0j)]
    assert not off.faulted
    assert len(off.branches_out) == 2


def test_clearing_one_fault_keeps_the_others(ring):
    first, second = gf.BusFault(1), gf.BusFault(3, reactance=0.1)
    state = initial_state(ring)
    for change in (first.changes(ring)[0], second.changes(ring)[0], first.changes(ring)[1]):
        state = change.apply(state)
    assert state.bus_faults == {(3, 0.1j)}


@pytest.mark.parametrize(
    "opening", [gf.BranchTrip("2-3"), gf.BusFault(3, trip_bus=True), gf.BusFault(2, trip_bus=True)]
)
def test_opening_a_branch_takes_the_fault_inside_it_along(ring, opening):
    state, _ = through(ring, gf.BranchFault("2-3", fraction=0.5, trip=False))
    for change in opening.changes(ring):
        state = change.apply(state)
    assert AT_2_3 in state.branches_out
    assert not state.faulted


def test_trip_and_reclosing_are_each_other_undone(ring):
    (tripped,) = through(ring, gf.BranchTrip("3-2", time=2.0))
    assert tripped.branches_out == {AT_2_3, 4}
    (change,) = gf.BranchReclose("2-3", time=3.0).changes(ring)
    assert change.time == 3.0
    assert change.apply(tripped) == initial_state(ring)


def test_a_branch_that_the_case_has_open_can_be_closed(ring):
    (closed,) = through(ring, gf.BranchReclose("1-4"))
    assert closed.branches_out == frozenset()


def test_a_branch_that_the_case_has_open_cannot_trip_before_it_is_closed(ring):
    (change,) = gf.BranchTrip("1-4", time=2.0).changes(ring)
    with pytest.raises(gf.EventError, match="trip of branch 1-4: it is open at 2 s"):
        change.apply(initial_state(ring))
    (closed,) = through(ring, gf.BranchReclose("1-4"))
    assert change.apply(closed) == initial_state(ring)


def test_machine_trip_takes_the_unit_out(ring):
    (state,) = through(ring, gf.MachineTrip(1, "2", time=4.0))
    assert state.units_out == {gf.UnitKey(1, "2")}


def test_machine_that_is_out_of_service_cannot_trip(ring):
    with pytest.raises(gf.EventError, match="no such machine in service"):
        gf.MachineTrip(3, "9").changes(ring)


def test_load_steps_at_a_bus_add_up(ring):
    state = initial_state(ring)
    steps = (gf.LoadStep(2, 1.0, 10.0, 5.0), gf.LoadStep(3, 1.0, 1.0), gf.LoadStep(2, 2.0, -10.0))
    for step in steps:
        (change,) = step.changes(ring)
        state = change.apply(state)
    assert state.load_steps == ((2, 5j), (3, 1 + 0j))


def test_load_that_comes_and_goes_leaves_the_state_as_it_was(ring):
    state = initial_state(ring)
    for power in (10.0, -10.0):
        (change,) = gf.LoadStep(2, 1.0, power, power / 2).changes(ring)
        state = change.apply(state)
    assert state == initial_state(ring)


@pytest.mark.parametrize(
    ("name", "position", "turned"),
    [
        ("2-3", 2, False),
        ("3-2", 2, True),
        ("1-2:2", 1, False),
        ("2-1:2", 1, True),
        (" 4 - 3 : 1 ", 3, False),
    ],
)
def test_branch_is_found_from_either_end(ring, name, position, turned):
    assert find_branch(ring, name, "here") == (position, turned)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "-",
        "1",
        "1-",
        "1-2-3",
        "1-2:",
        "a-b",
        "1-2:1 2",
        pytest.param("9" * 5000 + "-1", id="long"),
    ],
)
def test_malformed_branch_name_is_refused(ring, name):
    with pytest.raises(gf.EventError, match="FROM-TO"):
        find_branch(ring, name, "here")


def test_one_of_several_circuits_must_be_named(ring):
    with pytest.raises(gf.EventError, match=r"which circuit \(2-1:CIRCUIT\), one of 1, 2"):
        find_branch(ring, "2-1", "here")


def test_network_states_serve_as_keys(ring):
    on, _ = through(ring, gf.BusFault(2))
    again, _ = through(ring, gf.BusFault(2, duration=0.7))
    assert {on: "first"}[again] == "first"
