"""What is no list of events, faults, criteria or edits is told, not stumbled over."""

import pytest
from cases import lossless_classical_system

import gridfold as gf


@pytest.fixture(scope="module")
def model():
    return gf.build_model(lossless_classical_system())


@pytest.fixture(scope="module")
def run(model):
    return gf.simulate(model, t_end=0.05)


@pytest.mark.parametrize(
    "given", ["bus-fault bus=3", gf.BusFault(3), [3], ["bus-fault bus=3"], None]
)
def test_events_are_a_list_of_events(model, given):
    with pytest.raises(
        gf.OptionError, match=r"events are a list such as \[gridfold.BusFault\(3\)\]"
    ):
        gf.simulate(model, given, t_end=0.05)


def test_places_of_clearing_times_are_faults(model):
    for ask in (
        lambda: gf.critical_clearing_times(model, "1-3"),
        lambda: gf.critical_clearing_times(model, [1, 2, 3]),
        lambda: gf.critical_clearing_time(model, 3),
    ):
        with pytest.raises(gf.OptionError, match="faults are a list such as"):
            ask()


@pytest.mark.parametrize(
    "given", ["damping at least 3 %", ["damping at least 3 %"], gf.VoltageDip(1)]
)
def test_criteria_are_a_list_of_criteria(run, given):
    with pytest.raises(gf.OptionError, match="criteria are a list such as"):
        gf.judge(run, given)


@pytest.mark.parametrize("given", ["edits.toml", ["GENROU 1:1 H=4"]])
def test_edits_are_those_of_a_file_or_records(given):
    with pytest.raises(gf.OptionError, match=r"edits are a list such as gridfold.load_edits\("):
        gf.load_case("npcc", edits=given)


@pytest.mark.parametrize("given", [5, ["voltage 1", "flow 1-2"], None])
def test_a_monitor_is_a_text(run, given):
    for watch in (run.frame, run.plot):
        with pytest.raises(gf.OptionError, match="monitor: it is a text such as 'flow 101-103"):
            watch(given)
