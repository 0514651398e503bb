import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.grid.timeline import Stage, build_timeline, initial_state


def test_without_events_there_is_one_stage(ring):
    assert build_timeline(ring, [], 1.0) == [Stage(0.0, "start", initial_state(ring))]


def test_initial_state_has_the_branches_out_that_the_case_has(ring):
    assert initial_state(ring).branches_out == {4}


def test_each_change_starts_a_stage(ring):
    stages = build_timeline(ring, [gf.BusFault(2, start=1.0, duration=0.25)], 5.0)
    assert [stage.start for stage in stages] == [0.0, 1.0, 1.25]
    assert [stage.label for stage in stages] == [
        "start",
        "fault at bus 2",
        "fault at bus 2 cleared",
    ]
    assert [stage.state.faulted for stage in stages] == [False, True, False]


def test_event_at_the_start_takes_the_place_of_the_first_stage(ring):
    stages = build_timeline(ring, [gf.BusFault(2, duration=0.25)], 5.0)
    assert [stage.start for stage in stages] == [0.0, 0.25]
    assert stages[0].state.faulted


@pytest.mark.parametrize(
    ("event", "labels"),
    [
        (gf.BusFault(2, 1.0, trip_bus=True), ["fault at bus 2", "bus 2 tripped"]),
        (gf.BranchFault("2-3", 1.0), ["fault on branch 2-3", "branch 2-3 tripped"]),
        (gf.BranchFault("2-3", 1.0, trip=False), ["fault on branch 2-3"] * 2),
        (gf.BranchTrip("1-2:2", 1.0), ["branch 1-2:2 tripped"]),
        (gf.BranchReclose("4-1", 1.0), ["branch 4-1 reclosed"]),
        (gf.MachineTrip(1, "2", 1.0), ["machine 1:2 tripped"]),
        (gf.LoadStep(2, 1.0, 10.0, -5.0), ["load at bus 2 +10 MW -5 Mvar"]),
    ],
)
def test_stages_say_what_brought_them_about(ring, event, labels):
    first, *stages = build_timeline(ring, [event], 5.0)
    assert first.state == initial_state(ring)
    assert len(stages) == len(labels)
    for stage, label in zip(stages, labels, strict=True):
        assert stage.label.startswith(label)
    assert stages[0].state != first.state


def test_events_are_put_into_order_of_time(ring):
    events = [gf.BranchTrip("2-3", 3.0), gf.LoadStep(2, 1.0, 5.0), gf.MachineTrip(1, "2", 2.0)]
    stages = build_timeline(ring, events, 5.0)
    assert [stage.start for stage in stages] == [0.0, 1.0, 2.0, 3.0]
    assert [len(stage.state.units_out) for stage in stages] == [0, 0, 1, 1]
    assert [len(stage.state.branches_out) for stage in stages] == [1, 1, 1, 2]
    assert [len(stage.state.load_steps) for stage in stages] == [0, 1, 1, 1]


def test_events_at_one_instant_form_one_stage(ring):
    events = [gf.BusFault(2, 0.1, 0.2), gf.BranchTrip("2-3", 0.3), gf.LoadStep(4, 0.3, 1.0)]
    stages = build_timeline(ring, events, 5.0)  # 0.1 + 0.2 is not 0.3 in binary
    assert [stage.start for stage in stages] == [0.0, 0.1, 0.3]
    assert stages[-1].label == (
        "fault at bus 2 cleared, branch 2-3 tripped, load at bus 4 +1 MW +0 Mvar"
    )
    assert stages[-1].state.branches_out == {2, 4}


def test_events_at_one_instant_act_in_the_order_given(ring):
    trip, reclose = gf.BranchTrip("2-3", 1.0), gf.BranchReclose("2-3", 1.0)
    stages = build_timeline(ring, [trip, reclose], 5.0)
    assert stages[-1].state == initial_state(ring)
    with pytest.raises(gf.EventError, match="not open"):
        build_timeline(ring, [reclose, trip], 5.0)


@pytest.mark.parametrize("time", [5.0, 7.0, 5.0 - 1e-10])
def test_event_that_the_run_does_not_reach_is_refused(ring, time):
    with pytest.raises(gf.EventError, match="branch 2-3 tripped: it happens at"):
        build_timeline(ring, [gf.BranchTrip("2-3", time)], 5.0)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.0, 4.0), st.floats(0.001, 0.9), st.sampled_from([1, 2, 3, 4])),
        max_size=4,
        unique_by=lambda fault: fault[2],
    )
)
def test_stages_rise_in_time_and_end_without_faults(ring, faults):
    events = [gf.BusFault(bus, start, duration) for start, duration, bus in faults]
    stages = build_timeline(ring, events, 5.0)
    starts = [stage.start for stage in stages]
    assert starts[0] == 0.0
    assert starts == sorted(set(starts))
    assert stages[-1].state == initial_state(ring)
    for start, duration, bus in faults:
        middle = start + duration / 2
        on = [s for s in stages if s.start <= middle][-1].state
        assert (bus, 0j) in on.bus_faults
