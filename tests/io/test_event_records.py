import json
from dataclasses import fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.grid.events import EVENTS
from gridfold.grid.relays import RELAYS
from gridfold.io.event_records import event_from_record, event_record, parse_event, relays_of

NUMBERS = st.floats(allow_nan=False)
BRANCHES = st.sampled_from(["2-3", "3-2:1", "17-4:north"])
BUSES = st.integers(1, 10**9)
PLACES = st.sampled_from(["", "1-36,78", "2"])
ANY_EVENT = st.one_of(
    st.builds(gf.BusFault, BUSES, NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.booleans()),
    st.builds(gf.BranchFault, BRANCHES, NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.booleans()),
    st.builds(gf.BranchTrip, BRANCHES, NUMBERS),
    st.builds(gf.BranchReclose, BRANCHES, NUMBERS),
    st.builds(gf.MachineTrip, BUSES, st.sampled_from(["1", "2", "G1"]), NUMBERS),
    st.builds(gf.LoadStep, BUSES, NUMBERS, NUMBERS, NUMBERS),
    st.builds(gf.BranchFault, BRANCHES, far_duration=st.none() | NUMBERS),
    st.builds(gf.BranchOpenEnd, BRANCHES, BUSES, NUMBERS),
    st.builds(gf.LoadShed, NUMBERS, PLACES, PLACES, PLACES, NUMBERS),
    st.builds(gf.ShuntTrip, BUSES, st.sampled_from(["1", "S1"]), NUMBERS),
    st.builds(gf.ShuntClose, BUSES, st.sampled_from(["1", "S1"]), NUMBERS),
    st.builds(gf.ShuntStep, BUSES, NUMBERS, NUMBERS, NUMBERS),
    st.builds(gf.SetParameter, BUSES, st.just("inertia"), st.none() | NUMBERS, st.none() | NUMBERS),
    st.builds(gf.Redispatch, NUMBERS, PLACES, PLACES, units=PLACES),
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
def test_record_has_the_kind_and_every_field_that_is_given(kind):
    samples = {
        "branch": "7-8", "id": "2", "buses": "7", "areas": "1", "zones": "1", "model": "sexs",
        "units": "7:1", "parameter": "inertia", "bus": 1, "trip": False, "trip_bus": True,
    }  # fmt: skip
    names = [item.name for item in fields(EVENTS[kind])]
    event = EVENTS[kind](**{name: samples.get(name, 0.5) for name in names})
    record = event_record(event)
    assert record["kind"] == kind
    assert set(record) == {"kind", *names}
    assert event_from_record(record) == event


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("line-trip", "branch-trip"),
        ("trip-line", "branch-trip"),
        ("transformer-trip", "branch-trip"),
        ("branch-open", "branch-trip"),
        ("line_fault", "branch-fault"),
        ("line-reclose", "branch-reclose"),
        ("gen-trip", "machine-trip"),
        ("unit-outage", "machine-trip"),
        ("load-shedding", "load-shed"),
        ("open-end", "branch-open-end"),
        ("reference-step", "set"),
        ("capacitor-trip", "shunt-trip"),
        ("dispatch", "redispatch"),
        ("bus-falt", "bus-fault"),
    ],
)
def test_a_kind_in_other_words_is_told_by_its_name(written, meant):
    with pytest.raises(gf.EventError, match=f"did you mean '{meant}'"):
        parse_event(f"{written} branch=1-2")


def test_relays_read_back_from_their_records():
    relays = [
        gf.UnderFrequencyShedding((gf.SheddingStage(59.3, 0.1, 0.05),), areas="1", measured_at=3),
        gf.UnderVoltageShedding((gf.SheddingStage(0.9, 5.0, 0.1),) * 2, zones="2"),
        gf.GeneratorVoltageTrip(7, 0.2, below=0.8), gf.GeneratorFrequencyTrip(7, 1.0, 57.0, 62.0, "2"),
        gf.DistanceRelay("1-2", 1, transfer_trip=True), gf.OutOfStepRelay("1-2:2", 2, outer=3.0),
    ]  # fmt: skip
    assert {type(relay) for relay in relays} == set(RELAYS.values())
    records = json.loads(json.dumps([event_record(relay) for relay in relays]))
    assert relays_of(records) == relays


def test_a_file_of_relays_names_every_one_that_is_wrong(tmp_path):
    path = tmp_path / "relays.toml"
    path.write_text(
        """
        [[relays]]
        kind = "distance"
        branch = "1-2"
        bus = 1
        [[relays]]
        kind = "under-frequency"
        [[relays]]
        kind = "under-frequency-shedding"
        stages = [{ pickup = 59.3, share = 0.05 }]
        [[relays]]
        kind = "under-voltage-shedding"
        stages = 0.9
        """
    )
    with pytest.raises(gf.EventError) as raised:
        gf.load_relays(path)
    lines = str(raised.value).splitlines()
    assert [line.partition("relays.toml: ")[2] for line in lines] == [
        "relay 2: unknown kind 'under-frequency'; did you mean 'under-frequency-shedding'?",
        "relay 3: stages 1: a stage needs delay",
        "relay 4: stages: it is a list of tables, each { pickup = ..., delay = ..., share = ... }",
    ]


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
