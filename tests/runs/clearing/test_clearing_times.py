from __future__ import annotations

from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

import gridfold as gf


def test_the_time_found_is_stable_and_one_step_of_the_grid_more_is_not(npcc):
    found = gf.critical_clearing_time(npcc, gf.BusFault(25))
    for extra, status in ((0.0, gf.Status.COMPLETED), (0.01, gf.Status.LOST_SYNCHRONISM)):
        fault = gf.BusFault(25, duration=found.seconds + extra)
        assert gf.simulate(npcc, [fault]).status is status


def test_the_grid_is_as_fine_as_asked_for(npcc):
    coarse = gf.critical_clearing_time(npcc, gf.BusFault(25), resolution=0.05)
    fine = gf.critical_clearing_time(npcc, gf.BusFault(25), resolution=0.002)
    assert coarse.seconds <= fine.seconds < coarse.seconds + 0.05
    assert coarse.seconds == pytest.approx(0.2)


def test_a_fault_that_never_loses_synchronism_is_reported_as_unbounded(npcc):
    mild = gf.BusFault(3, reactance=5.0)
    found = gf.critical_clearing_time(npcc, mild, longest=0.5)
    assert not found.bounded
    assert found.seconds == 0.5
    assert found.fault.reactance == 5.0


def test_a_line_fault_has_a_clearing_time_too(npcc):
    found = gf.critical_clearing_time(npcc, gf.BranchFault("3-4"))
    assert 0.2 < found.seconds < 0.6
    assert found.fault.branch == "3-4"


def test_threads_give_the_same_result_as_one_and_in_the_order_asked_for(npcc):
    faults = [gf.BusFault(bus) for bus in (22, 3, 7)]
    seen = []
    one = gf.critical_clearing_times(npcc, faults, workers=1)
    many = gf.critical_clearing_times(npcc, faults, workers=3, on_done=seen.append)
    assert [item.fault.bus for item in many] == [22, 3, 7]
    assert one == many
    assert len(seen) == 3


def test_a_bus_that_is_not_there_is_an_error_before_anything_runs(npcc):
    with pytest.raises(gf.EventError, match="no bus 999"):
        gf.critical_clearing_times(npcc, [gf.BusFault(3), gf.BusFault(999)])


@pytest.mark.parametrize(
    "options", [{"resolution": 0}, {"longest": np.nan}, {"t_end": 1.0}, {"longest": 0.001}]
)
def test_ranges_that_make_no_sense_are_refused(npcc, options):
    with pytest.raises(gf.OptionError):
        gf.critical_clearing_time(npcc, gf.BusFault(3), **options)


@pytest.mark.parametrize("count", [4, 9])
def test_many_are_found_side_by_side_as_they_are_alone(npcc, monkeypatch, count):
    faults = [gf.BusFault(22), gf.BranchFault("3-4", fraction=0.3), gf.BusFault(3, reactance=5.0)]
    faults += [gf.BusFault(bus) for bus in (25, 7, 3, 36, 78, 23)][: count - 3]
    options = {"resolution": 0.02, "longest": 0.6, "t_end": 3.0}
    alone = [gf.critical_clearing_time(npcc, fault, **options) for fault in faults]
    monkeypatch.delattr("gridfold.runs.clearing.many._Work.alone")
    found = gf.critical_clearing_times(npcc, faults, workers=1, **options)
    assert list(found) == alone
    few = "several clearing times of a place" if count < 8 else "one clearing time of each place"
    assert few in found.together
    runs = sum(item.runs for item in found), sum(item.runs for item in alone)
    assert runs[0] > runs[1]  # lanes without a trial that is due try what may be asked for


def test_the_machine_that_is_named_loses_synchronism_first_one_step_later(npcc):
    (found,) = gf.critical_clearing_times(npcc, [gf.BusFault(25)])
    assert found.lost_at == pytest.approx(found.seconds + 0.01)
    run = gf.simulate(npcc, [gf.BusFault(25, duration=found.lost_at)])
    assert run.culprit == f"rotor_angle:{found.machine}"
    assert found.status is run.status


class Scripted:
    """A simulator without simulations: stable up to a clearing time for each bus, or an error."""

    def __init__(self, limits, per_run=None):
        self.limits, self.per_run, self.runs = limits, per_run, 0

    def __call__(self, model, events, t_end, stepper, criterion, store):
        self.runs += 1
        if self.per_run is not None:
            self.per_run(self.runs)
        (fault,) = events
        limit = self.limits[fault.bus]
        if limit is None:
            raise gf.NetworkError("bus 5: the network is singular")
        stable = fault.duration <= limit + 1e-9
        status = gf.Status.COMPLETED if stable else gf.Status.LOST_SYNCHRONISM
        return SimpleNamespace(status=status, culprit=None if stable else "rotor_angle:26:1")


LIMITS = {3: 0.2, 5: None, 7: 9.0, 8: 0.0}
FAULTS = [gf.BusFault(bus) for bus in LIMITS]


def test_a_place_whose_runs_go_wrong_has_a_reason_and_ends_nothing(npcc):
    found = gf.critical_clearing_times(npcc, FAULTS, 2, simulator=Scripted(LIMITS))
    assert [item.fault.bus for item in found.failed] == [5]
    assert found[1].reason == "bus 5: the network is singular"
    assert [(item.seconds, item.bounded) for item in found if not item.failed] == [
        (0.2, True),
        (2.0, False),
        (0.0, True),
    ]
    assert "detailed model" in found.together


def test_the_table_has_a_row_of_each_place_and_misses_what_does_not_apply(npcc):
    times = gf.critical_clearing_times(npcc, FAULTS, 1, simulator=Scripted(LIMITS))
    frame = times.frame()
    assert frame["bus"].tolist() == [3, 5, 7, 8]
    assert frame["cct_s"].isna().tolist() == [False, True, False, False]
    assert frame["lost_at_s"].isna().tolist() == [False, True, True, False]
    assert frame.loc[0, ["place", "name", "base_kv", "machine"]].tolist() == [
        "bus 3", npcc.case.buses[2].name.strip(), npcc.case.buses[2].base_kv, "26:1",
    ]  # fmt: skip
    assert repr(times) == (
        "<ClearingTimes npcc: places 4 of 4, shortest 0 s, never lost 1, failed 1>"
    )


def test_a_line_is_named_by_the_bus_at_which_its_fault_is(npcc):
    lines = [gf.BranchFault("4-3", fraction=end) for end in (0.0, 1.0, 0.3)]
    times = gf.critical_clearing_times(
        npcc, lines, 1, simulator=lambda *_: SimpleNamespace(status=gf.Status.COMPLETED)
    )
    frame = times.frame()
    names = {bus.number: bus.name.strip() for bus in npcc.case.buses}
    assert frame["place"].tolist() == ["line 4-3 at 4", "line 4-3 at 3", "line 4-3 at 30 %"]
    assert frame["name"].tolist() == [names[4], names[3], names[4]]


def test_work_that_is_stopped_goes_on_from_its_folder_and_does_nothing_twice(npcc, tmp_path):
    stop = Event()
    first = Scripted(LIMITS, lambda runs: stop.set() if runs == 7 else None)
    folder = tmp_path / "map"
    broken = gf.critical_clearing_times(npcc, FAULTS, 1, simulator=first, out=folder, stop=stop)
    assert 0 < len(broken) < 4
    assert len(broken) + len(broken.waiting) == 4
    with pytest.raises(gf.OptionError, match="resume"):
        gf.critical_clearing_times(npcc, FAULTS, 1, simulator=first, out=folder)
    second = Scripted(LIMITS)
    found = gf.critical_clearing_times(npcc, FAULTS, 1, simulator=second, out=folder, resume=True)
    whole = Scripted(LIMITS)
    again = gf.critical_clearing_times(npcc, FAULTS, 1, simulator=whole)
    assert found.rows == again.rows
    assert second.runs < whole.runs
    third = Scripted(LIMITS)
    gf.critical_clearing_times(npcc, FAULTS, 1, simulator=third, out=folder, resume=True)
    assert third.runs == 1  # the place that failed is tried again


def test_a_folder_of_other_clearing_times_is_refused_with_what_differs(npcc, tmp_path):
    options = {"simulator": Scripted(LIMITS), "out": tmp_path / "map"}
    gf.critical_clearing_times(npcc, FAULTS[:1], 1, **options)
    with pytest.raises(gf.OptionError, match=r"longest \(was 2.0, is 1.0\)"):
        gf.critical_clearing_times(npcc, FAULTS[:1], 1, resume=True, longest=1.0, **options)
    with pytest.raises(gf.OptionError, match="places"):
        gf.critical_clearing_times(npcc, FAULTS[2:], 1, resume=True, **options)
    with pytest.raises(gf.OptionError, match="holds no clearing times"):
        gf.critical_clearing_times(npcc, FAULTS, 1, resume=True, out=tmp_path)


def test_what_is_wrong_with_one_of_many_is_told(npcc):
    faults = [gf.BusFault(bus) for bus in (22, 3, 7)] + [gf.BusFault(8, resistance=-1.0)]
    with pytest.raises(gf.GridfoldError, match="bus 8"):
        gf.critical_clearing_times(npcc, faults, workers=1)
