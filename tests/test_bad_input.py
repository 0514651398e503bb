from dataclasses import replace

import pytest
from bad_input_samples import (
    CASE_FOLDERS,
    DEVICE_FOLDERS,
    EVENT_FILES,
    EVENTS,
    SMALL_CASE,
    write_small_case,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.grid.timeline import build_timeline
from gridfold.io.event_records import event_from_record, event_record, parse_event

NAN, INF = float("nan"), float("inf")


def by_id(samples):
    return [pytest.param(sample, id=sample.id) for sample in samples]


def assert_says(error, words):
    for word in words:
        assert word in str(error.value)


@pytest.fixture(scope="module")
def npcc_case():
    return gf.load_case("npcc")


@pytest.fixture(scope="module")
def small_model(tmp_path_factory):
    return gf.build_model(gf.load_case(write_small_case(tmp_path_factory.mktemp("small"))))


def test_the_samples_are_many_and_have_names_of_their_own():
    for samples in (CASE_FOLDERS, DEVICE_FOLDERS, EVENTS, EVENT_FILES):
        assert len({sample.id for sample in samples}) == len(samples)
    assert len(CASE_FOLDERS) + len(DEVICE_FOLDERS) + len(EVENTS) + len(EVENT_FILES) >= 100


def test_the_case_that_the_samples_spoil_is_sound(small_model):
    run = gf.simulate(small_model, [gf.BusFault(3, start=0.1, duration=0.05)], t_end=1.0)
    assert run.status is gf.Status.COMPLETED


@pytest.mark.parametrize("sample", by_id(CASE_FOLDERS))
def test_malformed_case_folder_is_refused(sample, tmp_path):
    folder = sample.write(tmp_path)
    with pytest.raises(gf.GridfoldError) as error:
        gf.load_case(folder)
    assert type(error.value) is sample.error
    assert_says(error, sample.words)


@pytest.mark.parametrize(
    "source",
    ["nowhere", "", "~", "~no-such-user/case", "a\0b", pytest.param("n" * 5000, id="long")],
)
def test_case_that_is_not_there_is_refused(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(gf.CaseFileError):
        gf.load_case(source)


@pytest.mark.parametrize("sample", by_id(DEVICE_FOLDERS))
def test_device_records_that_make_no_model_are_refused(sample, tmp_path):
    case = gf.load_case(sample.write(tmp_path))
    with pytest.raises(gf.GridfoldError) as error:
        gf.build_model(case)
    assert type(error.value) is sample.error
    assert_says(error, sample.words)


def test_every_fault_of_the_device_records_is_reported(tmp_path):
    folder = write_small_case(tmp_path)
    for sample in DEVICE_FOLDERS[:3]:
        sample.edit(folder)
    with pytest.raises(gf.CaseError) as error:
        gf.build_model(gf.load_case(folder))
    assert len(error.value.faults) == 2
    assert_says(error, (*DEVICE_FOLDERS[0].words, *DEVICE_FOLDERS[2].words))


@pytest.mark.parametrize("sample", by_id(EVENTS))
def test_wrong_event_is_refused(sample, npcc_case):
    with pytest.raises(gf.EventError) as error:
        build_timeline(npcc_case, [parse_event(text) for text in sample.texts], sample.t_end)
    assert_says(error, sample.words)


@pytest.mark.parametrize("sample", by_id(EVENT_FILES))
def test_malformed_event_file_is_refused(sample, tmp_path):
    path = tmp_path / "events.toml"
    path.write_text(sample.text, encoding="utf-8")
    with pytest.raises(gf.EventError) as error:
        gf.load_events(path)
    assert_says(error, (str(path), *sample.words))


@pytest.mark.parametrize("name", ["missing.toml", ".", "a\0b"])
def test_event_file_that_cannot_be_read_is_refused(name, tmp_path):
    with pytest.raises(gf.EventError, match="cannot be read"):
        gf.load_events(tmp_path / name)


def test_a_simulation_refuses_a_wrong_event_before_it_runs(small_model):
    with pytest.raises(gf.EventError, match="no bus 99"):
        gf.simulate(small_model, [gf.BusFault(1), gf.BusFault(99, start=0.5)], t_end=1.0)


@pytest.mark.parametrize("stepper", [gf.RungeKutta4, gf.AdamsBashforthMoulton4, gf.ScipyReference])
@pytest.mark.parametrize("step", [0, 0.0, -0.01, NAN, INF])
def test_time_step_that_is_not_positive_is_refused(stepper, step):
    with pytest.raises(gf.OptionError, match="time step") as error:
        stepper(step)
    assert repr(step) in str(error.value)


@pytest.mark.parametrize("t_end", [0.0, -1.0, NAN, INF])
def test_end_of_run_that_is_not_positive_is_refused(t_end, small_model):
    with pytest.raises(gf.OptionError, match="end time") as error:
        gf.simulate(small_model, t_end=t_end)
    assert repr(t_end) in str(error.value)


@pytest.mark.parametrize("limit", [0.0, -180.0, NAN, INF])
def test_angle_limit_that_is_not_positive_is_refused(limit):
    with pytest.raises(gf.OptionError, match="angle limit") as error:
        gf.SynchronismCriterion(limit)
    assert repr(limit) in str(error.value)


@pytest.mark.parametrize("name", ["resolution", "longest", "t_end"])
@pytest.mark.parametrize("value", [0.0, -0.1, NAN, INF])
def test_range_of_clearing_times_that_is_not_positive_is_refused(name, value, small_model):
    with pytest.raises(gf.OptionError, match=f"{name} must be") as error:
        gf.critical_clearing_time(small_model, gf.BusFault(3), **{name: value})
    assert repr(value) in str(error.value)


@pytest.mark.parametrize(
    "options",
    [
        {"resolution": 0.5, "longest": 0.4},
        {"longest": 5.0, "t_end": 5.0},
        {"longest": 9.0, "t_end": 5.0},
    ],
)
def test_range_of_clearing_times_in_the_wrong_order_is_refused(options, small_model):
    with pytest.raises(gf.OptionError, match="must lie between"):
        gf.critical_clearing_time(small_model, gf.BusFault(3), **options)


def test_clearing_times_refuse_a_wrong_fault_before_any_run(small_model):
    with pytest.raises(gf.EventError, match="no bus 99"):
        gf.critical_clearing_times(small_model, [gf.BusFault(3), gf.BusFault(99)])


def test_load_far_too_large_is_a_power_flow_error_that_names_buses(npcc_case):
    heavy = replace(
        npcc_case,
        loads=tuple(
            replace(load, active_mw=50 * load.active_mw) if load.bus == 35 else load
            for load in npcc_case.loads
        ),
    )
    with pytest.raises(gf.PowerFlowError, match="did not converge") as error:
        gf.solve_power_flow(heavy)
    assert_says(error, ("npcc", "bus 35:", "MW", "p.u."))


ODD_NUMBERS = ["nan", "inf", "-inf", "1e400", "1e-320", "1_0", "1" + "0" * 400, "\u0661"]
ODD_TEXTS = ["", " ", "true", "slack", "power", "#", '"', '"a', "\x00", "\x0b", "\ufeff", "1,2"]
CELLS = st.one_of(
    st.sampled_from(ODD_NUMBERS + ODD_TEXTS),
    st.integers(-1, 4).map(str),
    st.floats().map(repr),
    st.text(max_size=6),
)
MUTATIONS = st.lists(
    st.tuples(
        st.sampled_from([name for name in SMALL_CASE if name.endswith(".csv")]),
        st.integers(0, 5),
        st.integers(0, 9),
        CELLS,
    ),
    min_size=1,
    max_size=3,
)


def mutated(mutations):
    """Texts of the small case's tables with some cells replaced."""
    tables = {
        name: [row.split(",") for row in text.splitlines()] for name, text in SMALL_CASE.items()
    }
    for name, row, column, text in mutations:
        cells = tables[name][row % len(tables[name])]
        cells[column % len(cells)] = text
    return {name: "\n".join(",".join(cells) for cells in rows) for name, rows in tables.items()}


def outcome(function, error):
    """What `function` returns, or the `error` that it raises; any other error passes."""
    try:
        return function()
    except error as refusal:
        return refusal


@pytest.fixture(scope="module")
def scratch_folder(tmp_path_factory):
    return write_small_case(tmp_path_factory.mktemp("scratch"))


@settings(max_examples=150, deadline=None)
@given(MUTATIONS)
def test_a_table_with_random_cells_loads_or_is_refused_with_reasons(scratch_folder, mutations):
    for name, text in mutated(mutations).items():
        (scratch_folder / name).write_text(text, encoding="utf-8")
    result = outcome(lambda: gf.load_case(scratch_folder), gf.CaseError)
    if isinstance(result, gf.CaseError):
        assert all(fault and fault in str(result) for fault in result.faults)
        assert result.faults
    else:
        assert gf.validate_case(result) == []


WORDS = st.one_of(
    st.sampled_from(["bus-fault", "branch-fault", "branch-trip", "branch-reclose"]),
    st.sampled_from(["machine-trip", "load-step", "bus=3", "branch=2-33", "time=1", "trip=no"]),
    st.builds("{}={}".format, st.sampled_from(["bus", "branch", "start", "id", "kind"]), st.text()),
    st.text(max_size=12),
)


@settings(max_examples=200, deadline=None)
@given(st.one_of(st.text(), st.lists(WORDS, max_size=5).map(" ".join)))
def test_random_event_text_is_an_event_or_is_refused_with_a_reason(npcc_case, text):
    event = outcome(lambda: parse_event(text), gf.EventError)
    if isinstance(event, gf.EventError):
        assert str(event)
    else:
        assert event_from_record(event_record(event)) == event
        outcome(lambda: build_timeline(npcc_case, [event], 16.0), gf.EventError)


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.integers(), max_size=2),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=1),
)
NAMES = st.sampled_from(["bus", "branch", "start", "duration", "fraction", "trip", "id", "time"])


@settings(max_examples=150, deadline=None)
@given(
    st.one_of(VALUES, st.sampled_from(["bus-fault", "branch-fault", "machine-trip", "load-step"])),
    st.dictionaries(NAMES, VALUES, max_size=4),
)
def test_random_event_record_gives_stages_or_is_refused(npcc_case, kind, values):
    def stages():
        return build_timeline(npcc_case, [event_from_record({"kind": kind, **values})], 16.0)

    result = outcome(stages, gf.EventError)
    assert str(result) if isinstance(result, gf.EventError) else result[0].start == 0.0
