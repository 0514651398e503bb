from __future__ import annotations

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


def test_many_are_found_side_by_side_as_they_are_alone(npcc, monkeypatch):
    faults = [gf.BusFault(bus) for bus in (22, 3, 7, 25)]
    faults += [gf.BranchFault("3-4", fraction=0.3), gf.BusFault(3, reactance=5.0)]
    options = {"resolution": 0.02, "longest": 0.6, "t_end": 3.0}
    alone = [gf.critical_clearing_time(npcc, fault, **options) for fault in faults]
    monkeypatch.delattr("gridfold.runs.clearing_time.simulate")
    assert gf.critical_clearing_times(npcc, faults, workers=1, **options) == alone


def test_what_is_wrong_with_one_of_many_is_told(npcc):
    faults = [gf.BusFault(bus) for bus in (22, 3, 7)] + [gf.BusFault(8, resistance=-1.0)]
    with pytest.raises(gf.GridfoldError, match="bus 8"):
        gf.critical_clearing_times(npcc, faults, workers=1)
