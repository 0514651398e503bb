import json
from dataclasses import fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.grid.events import EVENTS
from gridfold.io.event_records import event_from_record, event_record, parse_event

NUMBERS = st.floats(allow_nan=False)
BRANCHES = st.sampled_from(["2-3", "3-2:1", "17-4:north"])
BUSES = st.integers(1, 10**9)
ANY_EVENT = st.one_of(
    st.builds(gf.BusFault, BUSES, NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.booleans()),
    st.builds(gf.BranchFault, BRANCHES, NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.booleans()),
    st.builds(gf.BranchTrip, BRANCHES, NUMBERS),
    st.builds(gf.BranchReclose, BRANCHES, NUMBERS),
    st.builds(gf.MachineTrip, BUSES, st.sampled_from(["1", "2", "G1"]), NUMBERS),
    st.builds(gf.LoadStep, BUSES, NUMBERS, NUMBERS, NUMBERS),
)


def literal(value):
    """A value as TOML writes it."""
    return str(value).lower() if isinstance(value, bool) else json.dumps(value)


@settings(max_examples=80, deadline=None)
@given(ANY_EVENT)
def test_record_of_an_event_reads_back_as_the_event(event):
    assert event_from_record(event_record(event)) == event


@settings(max_examples=60, deadline=None)
@given(ANY_EVENT)
def test_record_of_an_event_survives_json(event):
    assert event_from_record(json.loads(json.dumps(event_record(event)))) == event


@settings(max_examples=60, deadline=None)
@given(ANY_EVENT)
def test_event_written_as_words_reads_back_as_the_event(event):
    record = event_record(event)
    kind = record.pop("kind")
    assert parse_event(" ".join([kind, *(f"{k}={v}" for k, v in record.items())])) == event


@pytest.mark.parametrize("kind", EVENTS)
def test_record_has_the_kind_and_every_field(kind):
    event = EVENTS[kind](7) if kind.startswith(("bus", "mach", "load")) else EVENTS[kind]("7-8")
    record = event_record(event)
    assert record["kind"] == kind
    assert set(record) == {"kind", *(item.name for item in fields(event))}
    assert event_from_record(record) == event


@pytest.mark.parametrize(
    ("text", "event"),
    [
        ("bus-fault bus=3", gf.BusFault(3)),
        ("  bus-fault   bus=3  trip_bus=Yes ", gf.BusFault(3, trip_bus=True)),
        (
            "branch-fault branch=2-33 fraction=.5 trip=0",
            gf.BranchFault("2-33", fraction=0.5, trip=False),
        ),
        ("branch-trip branch=43-50:2 time=1e-1", gf.BranchTrip("43-50:2", 0.1)),
        ("branch-reclose branch=2-33", gf.BranchReclose("2-33")),
        ("machine-trip bus=23 id=2", gf.MachineTrip(23, "2")),
        ("load-step bus=3 active_mw=-9", gf.LoadStep(3, active_mw=-9.0)),
    ],
)
def test_events_are_written_as_words(text, event):
    assert parse_event(text) == event


def test_events_are_read_from_toml_in_order(tmp_path):
    events = [
        gf.BusFault(3, 0.5, 0.125, trip_bus=True),
        gf.BranchFault("2-33", 1.0, fraction=0.25, trip=False),
        gf.MachineTrip(23, "2", 4.0),
        gf.LoadStep(3, 2.0, 10.0),
    ]
    tables = [
        "[[event]]\n" + "".join(f"{k} = {literal(v)}\n" for k, v in event_record(event).items())
        for event in events
    ]
    path = tmp_path / "events.toml"
    path.write_text("\n".join(tables), encoding="utf-8")
    assert gf.load_events(path) == events
    assert gf.load_events(str(path)) == events


def test_whole_numbers_in_toml_serve_for_times_and_ids(tmp_path):
    path = tmp_path / "events.toml"
    path.write_text('[[event]]\nkind = "machine-trip"\nbus = 23\nid = 2\ntime = 4\n')
    assert gf.load_events(path) == [gf.MachineTrip(23, "2", 4.0)]
