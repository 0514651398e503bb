"""Buses and branches of events by the names of the case."""

from dataclasses import replace

import pytest
from plants import two_plants

import gridfold as gf
from gridfold.io.event_places import any_name, numbering
from gridfold.io.event_records import events_of, parse_event, relays_of
from gridfold.io.kind_records import words_of


@pytest.fixture(scope="module")
def number():
    """Numbers of a case with a bus "NEW TOWN" (103), and two of one name."""
    case = two_plants()
    new = replace(case.buses[2], name="NEW TOWN")
    twin = gf.Bus(105, "PORT", 230.0)
    return numbering(replace(case, buses=(*case.buses[:2], new, case.buses[3], twin)))


@pytest.mark.parametrize(
    ("text", "event"),
    [
        ("bus-fault bus=NORTH duration=0.2", gf.BusFault(101, duration=0.2)),
        ("bus-fault bus=north", gf.BusFault(101)),
        ("bus-fault bus='NEW TOWN' duration=0.2", gf.BusFault(103, duration=0.2)),
        ('bus-fault duration=0.2 bus="NEW*"', gf.BusFault(103, duration=0.2)),
        ("bus-fault bus=104", gf.BusFault(104)),
        ("machine-trip bus=SOUTH id=2 time=1", gf.MachineTrip(102, "2", 1.0)),
        ("branch-trip branch='NEW TOWN'-104:2 time=1", gf.BranchTrip("103-104:2", 1.0)),
        ("branch-trip branch=NORTH-'NEW TOWN' time=1", gf.BranchTrip("101-103", 1.0)),
        ("branch-trip branch=103-104:2 time=1", gf.BranchTrip("103-104:2", 1.0)),
    ],
)
def test_a_bus_and_a_branch_may_be_given_by_names(number, text, event):
    assert parse_event(text, number) == event
    parse_event(text, any_name)  # without a case its form alone is looked at


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bus-fault bus=NORT", "bus: there is no bus 'NORT' in case plants; did you mean 'NORTH'"),
        ("bus-fault bus=PORT", "bus: 2 buses have the name 'PORT', say which: 104, 105"),
        ("branch-trip branch=NORTH-NOWHERE time=1", "branch: there is no bus 'NOWHERE'"),
        ("bus-fault bus=1.5", "bus: '1.5' is not a whole number"),
    ],
)
def test_a_name_of_no_bus_or_of_several_is_told_with_the_event(number, text, said):
    with pytest.raises(gf.EventError) as caught:
        parse_event(text, number)
    assert f"event {text!r}: {said}" in str(caught.value)


def test_tables_of_events_and_relays_take_names_too(number):
    (event,) = events_of([{"kind": "bus-fault", "bus": "NEW TOWN"}], number=number)
    assert event.bus == 103
    record = {"kind": "distance", "branch": "'NEW TOWN'-104:1", "bus": "NEW TOWN"}
    (relay,) = relays_of([record], number=number)
    assert (relay.branch, relay.bus) == ("103-104:1", 103)


def test_primes_of_parameters_are_no_quotes():
    text = "set bus=3 parameter=T'd0 other=T''d0 buses='A B' x"
    assert words_of(text) == ["set", "bus=3", "parameter=T'd0", "other=T''d0", "buses='A B'", "x"]
