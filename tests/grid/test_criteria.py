"""Criteria as records: what they may hold, and how they call themselves."""

from dataclasses import replace

import pytest
from cases import lossless_classical_system, one_machine_infinite_bus

import gridfold as gf
from gridfold.grid.criteria import CRITERIA, PRESETS
from gridfold.grid.criterion_checks import check_criteria, judged_buses


def test_a_preset_is_named_for_what_it_is():
    assert PRESETS["voltage back to 0.9 within 1 s"] == gf.VoltageRecovery(0.9, within=1.0)
    assert PRESETS["frequency from 59 to 61 Hz"] == gf.FrequencyBand(59.0, 61.0)
    assert all(str(criterion) == name for name, criterion in PRESETS.items())
    assert {type(criterion) for criterion in PRESETS.values()} == set(CRITERIA.values())


@pytest.mark.parametrize(
    ("criterion", "words"),
    [
        (gf.VoltageDip(0.7), "voltage never below 0.7 after the fault"),
        (
            gf.VoltageDip(0.8, 0.5, buses="kv>=345"),
            "voltage never below 0.8 for more than 0.5 s after the fault (kv>=345)",
        ),
        (
            gf.VoltageRecovery(0.95, 2, of_initial=True),
            "voltage back to 95 % of the initial within 2 s",
        ),
        (gf.FrequencyBand(59.5), "frequency from 59.5 Hz"),
        (
            gf.FrequencyBand(highest_hz=61, longest=3),
            "frequency up to 61 Hz, outside for at most 3 s",
        ),
        (gf.LeastDamping(3), "damping at least 3 %"),
        (gf.AngleSeparation(120, name="mine"), "mine"),
    ],
)
def test_a_criterion_says_what_it_asks(criterion, words):
    assert str(criterion) == words


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: gf.VoltageDip(0.0), "level must be a positive number, not 0.0"),
        (lambda: gf.VoltageDip(80), "level is a part of 1, such as 0.9, not 80"),
        (lambda: gf.VoltageRecovery(90, 1.0), "level is a part of 1, such as 0.9, not 90"),
        (lambda: gf.VoltageDip(0.8, -1.0), "longest must be a number of seconds"),
        (lambda: gf.VoltageRecovery(0.9, 0.0), "within must be a positive number"),
        (lambda: gf.VoltageRecovery(float("nan"), 1.0), "level must be a positive number"),
        (lambda: gf.VoltageDip(0.9, buses="kv>>3"), "the choice"),
        (lambda: gf.FrequencyBand(), "lowest_hz or highest_hz is needed"),
        (lambda: gf.FrequencyBand(61, 59), "lowest_hz, 61, must be below highest_hz, 59"),
        (lambda: gf.LeastDamping(101), "percent must lie from 0 to 100"),
        (lambda: gf.AngleSeparation(-3), "limit_deg must be a positive number"),
    ],
)
def test_senseless_criteria_are_refused(make, message):
    with pytest.raises(gf.OptionError, match=message.replace("(", r"\(")):
        make()


def test_all_criteria_that_do_not_fit_a_case_are_named_at_once():
    wrong = [
        gf.VoltageDip(0.8, buses="77"),
        gf.FrequencyBand(49, 51),
        gf.FrequencyBand(0.98),
        gf.FrequencyBand(highest_hz=1020),
        gf.AngleSeparation(120, machines="1:1"),
        gf.LeastDamping(3),
        gf.LeastDamping(3),
    ]
    with pytest.raises(gf.OptionError) as caught:
        check_criteria(wrong, lossless_classical_system())
    lines = str(caught.value).splitlines()
    assert len(lines) == 6
    for line, text in zip(
        lines,
        (
            "no bus 77",
            "does not hold the 60 Hz",
            "lowest_hz is 0.98, far from the 60 Hz",
            "highest_hz is 1020, far from the 60 Hz",
            "fewer than two machines",
            "is given twice",
        ),
        strict=True,
    ):
        assert text in line
    check_criteria([gf.FrequencyBand(49, 51)], replace(one_machine_infinite_bus(), frequency_hz=50))


def test_voltages_are_those_of_the_study_area_where_there_is_one():
    case = lossless_classical_system()
    assert judged_buses(gf.VoltageDip(0.8), case, None) == (1, 2, 3)
    assert judged_buses(gf.VoltageDip(0.8), case, {2, 3}) == (2, 3)
    assert judged_buses(gf.VoltageDip(0.8, buses="all"), case, {2, 3}) == (1, 2, 3)
