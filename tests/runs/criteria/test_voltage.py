"""Voltages whose dips and recoveries are known."""

import numpy as np
import pytest

from gridfold.grid.criteria import VoltageDip, VoltageRecovery
from gridfold.runs.criteria import Verdict
from gridfold.runs.criteria.course import Course
from gridfold.runs.criteria.voltage import VoltageWatch

STEP, CLEARED = 0.01, 0.1
TIMES = STEP * np.arange(301)
#: Buses 5 and 7 recover with a time constant of 0.3 and 0.1 s; bus 9 is not disturbed.
AFTER = TIMES - CLEARED
VOLTAGES = np.stack(
    [
        np.where(AFTER < -1e-9, 0.0, 1 - 0.4 * np.exp(-AFTER / 0.3)),
        np.where(AFTER < -1e-9, 0.0, 1 - 0.4 * np.exp(-AFTER / 0.1)),
        np.full(len(TIMES), 0.97),
    ],
    axis=1,
)
BUSES = (5, 7, 9)


def finding(criterion, voltages=VOLTAGES, cleared=CLEARED, early=None, rows=7):
    """The finding for voltages that come in blocks."""
    course = Course(None, cleared, TIMES[len(voltages) - 1], early)
    levels = np.full(voltages.shape[1], criterion.level)
    watch = VoltageWatch(criterion, BUSES[: voltages.shape[1]], levels, course)
    for first in range(0, len(voltages), rows):
        watch.take(
            TIMES[first : first + rows][: len(voltages) - first], voltages[first : first + rows]
        )
    return watch.finding()


def test_recovery_takes_until_the_first_sample_that_is_back():
    """1 - 0.4 exp(-t/0.3) is 0.9 at t = 0.3 ln 4 = 0.416 s: the sample after that is 0.42 s."""
    found = finding(VoltageRecovery(0.9, within=1.0))
    assert found.verdict is Verdict.KEPT
    assert found.value == pytest.approx(np.ceil(0.3 * np.log(4) / STEP) * STEP)
    assert found.margin == pytest.approx(1.0 - 0.42)
    assert (found.where, found.signal, found.unit) == ("bus 5", "voltage_pu:5", "s")
    assert found.at == pytest.approx(CLEARED + 0.42)


@pytest.mark.parametrize("within", [0.41, 0.42, 0.43])
def test_recovery_is_judged_to_the_sample(within):
    found = finding(VoltageRecovery(0.9, within))
    assert (found.verdict is Verdict.KEPT) == (within >= 0.42)


@pytest.mark.parametrize("rows", [1, 64, 301])
def test_blocks_do_not_matter(rows):
    assert finding(VoltageRecovery(0.9, 1.0), rows=rows) == finding(VoltageRecovery(0.9, 1.0))


def test_several_buses_that_are_late_are_counted():
    found = finding(VoltageRecovery(0.9, 0.1))
    assert found.verdict is Verdict.VIOLATED
    assert found.told == "bus 5 is back after 0.42 s, and 1 more bus too"


def test_a_second_fall_makes_a_recovery_late():
    falling = VOLTAGES.copy()
    falling[200:205, 1] = 0.85
    found = finding(VoltageRecovery(0.9, 1.0), falling)
    assert (found.verdict, found.where) == (Verdict.VIOLATED, "bus 7")
    assert found.value == pytest.approx(2.05 - CLEARED)


def test_a_voltage_that_is_not_back_by_the_end_has_at_least_that_time():
    low = VOLTAGES.copy()
    low[:, 2] = 0.85
    found = finding(VoltageRecovery(0.9, 1.0), low)
    assert (found.verdict, found.where) == (Verdict.VIOLATED, "bus 9")
    assert found.value == pytest.approx(3.0 - CLEARED)
    assert found.told == "bus 9 is below at the end of the run"


def test_a_run_that_ends_before_the_time_is_over_leaves_a_recovery_open():
    found = finding(VoltageRecovery(0.9, 1.0), VOLTAGES[:60])
    assert found.verdict is Verdict.OPEN
    assert found.told == "the run ends 0.49 s after the fault"


def test_the_dip_begins_with_the_clearing_not_with_the_fault():
    found = finding(VoltageDip(0.7))
    assert found.verdict is Verdict.VIOLATED
    assert found.value == pytest.approx(0.6)  # 0 during the fault does not count
    assert found.margin == pytest.approx(-0.1)
    assert found.share == pytest.approx(-0.1 / 0.7)
    assert found.at == pytest.approx(CLEARED)
    assert finding(VoltageDip(0.59)).verdict is Verdict.KEPT


def test_a_dip_may_last_as_long_as_it_is_allowed_to():
    """1 - 0.4 exp(-t/0.3) is 0.8 at t = 0.3 ln 2 = 0.208 s: 0.21 s to the sample."""
    kept, violated = finding(VoltageDip(0.8, longest=0.21)), finding(VoltageDip(0.8, longest=0.2))
    assert (kept.verdict, violated.verdict) == (Verdict.KEPT, Verdict.VIOLATED)
    assert violated.value == pytest.approx(0.21)
    assert violated.told == "bus 5 is below for 0.21 s from 0.1 s on"


def test_the_longest_of_several_dips_counts_not_their_sum():
    twice = np.full((len(TIMES), 1), 1.0)
    twice[20:30] = twice[50:65] = 0.75
    found = finding(VoltageDip(0.8, longest=0.2), twice)
    assert found.verdict is Verdict.KEPT
    assert found.value == pytest.approx(0.15)
    assert found.at == pytest.approx(0.5)


def test_a_dip_at_the_end_that_is_not_yet_too_long_is_open():
    late = np.full((len(TIMES), 1), 1.0)
    late[-11:] = 0.75
    assert finding(VoltageDip(0.8, longest=0.2), late).verdict is Verdict.OPEN
    assert finding(VoltageDip(0.8, longest=0.05), late).verdict is Verdict.VIOLATED


def test_buses_without_a_voltage_do_not_count():
    dark = VOLTAGES.copy()
    dark[50:, 0] = np.nan
    assert finding(VoltageDip(0.65), dark).where == "bus 5"
    dark[:, :] = np.nan
    found = finding(VoltageDip(0.65), dark)
    assert (found.verdict, found.value) == (Verdict.OPEN, None)
    assert "energized" in found.told


def test_a_run_that_ended_early_violates_but_never_fulfils():
    early = "the run ended at 3 s: lost synchronism"
    kept = finding(VoltageDip(0.5), early=early)
    assert (kept.verdict, kept.told) == (Verdict.OPEN, early)
    assert finding(VoltageDip(0.7), early=early).verdict is Verdict.VIOLATED


def test_a_fault_that_is_never_cleared_leaves_voltages_open():
    assert finding(VoltageDip(0.5), cleared=None).verdict is Verdict.OPEN
