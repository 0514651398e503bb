"""Runs that are written while they are stepped are the runs that are kept whole."""

import tracemalloc

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import gridfold as gf
from gridfold.runs.monitor import monitored
from gridfold.runs.monitor.columns import column_filter
from gridfold.runs.streaming import simulate_to_files
from gridfold.runs.summary import summarize
from gridfold.runs.table_files import TableFile, TableFormat

EVENTS = [gf.BusFault(3, 0.5, 0.1), gf.BranchTrip("3-2", 1.0), gf.MachineTrip(23, "2", 1.5)]
FEW = ("speed_pu:78:1", "voltage_pu:3", "field_voltage:2?:*")


@pytest.fixture
def short_pieces(monkeypatch):
    """Pieces of 256 rows, the least there are."""
    monkeypatch.setattr("gridfold.simulation.run._HANDED_ON", 1)


def streamed(model, path, events=EVENTS, t_end=4.0, criterion=None, columns=None):
    columns = columns or monitored(model)
    form = TableFormat(path.suffix[1:])
    method = gf.choose_stepper(model, "rk4", 0.005)
    return simulate_to_files(
        model, [TableFile(path, form, columns)], events, t_end, method, criterion
    )


def assert_same(summary, other):
    """Equal but for rounding: products of other numbers of rows."""
    for one, two in zip(
        (*summary.swings, summary.lowest_voltage, summary.highest_voltage),
        (*other.swings, other.lowest_voltage, other.highest_voltage),
        strict=True,
    ):
        one, two = vars(one), vars(two)
        names = [name for name, value in one.items() if isinstance(value, float)]
        assert [one[name] for name in names] == pytest.approx([two[name] for name in names])
        assert [one[n] for n in one if n not in names] == [two[n] for n in two if n not in names]


def whole(model, events=EVENTS, t_end=4.0, criterion=None):
    return gf.simulate(model, events, t_end, gf.RungeKutta4(0.005), criterion)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_table_and_the_summary_are_those_of_the_whole_run(npcc, short_pieces, tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    run, summary = streamed(npcc, path)
    kept = whole(npcc)
    frame = pd.read_csv(path) if suffix == ".csv" else pd.read_parquet(path)
    assert len(frame) == len(kept.times) == 801
    pd.testing.assert_frame_equal(frame, kept.frame(), rtol=1e-12)
    assert np.isnan(frame["speed_pu:23:2"].iloc[-1])
    assert_same(summary, summarize(kept))
    assert len(run.run.pieces) == len(kept.run.pieces)
    assert len(run.times) == len(run.run.pieces) + 1
    assert run.metadata() | {"method_reason": None} == kept.metadata()
    if suffix == ".parquet":
        assert b"gridfold" in pq.read_schema(path).metadata


def test_a_run_that_ends_early_is_written_up_to_its_end(npcc, short_pieces, tmp_path):
    criterion = gf.SynchronismCriterion()
    events = [gf.BusFault(3, 2.0, 0.6)]
    run, summary = streamed(npcc, tmp_path / "a.csv", events, 16.0, criterion)
    kept = whole(npcc, events, 16.0, criterion)
    assert run.status is kept.status is gf.Status.LOST_SYNCHRONISM
    assert run.culprit == kept.culprit
    frame = pd.read_csv(tmp_path / "a.csv")
    assert frame["time"].iloc[-1] == kept.times[-1] == run.times[-1]
    assert len(frame) == len(kept.times)
    assert_same(summary, summarize(kept))


def test_columns_are_chosen_by_name_and_pattern(npcc, tmp_path):
    columns = column_filter(npcc, FEW)
    assert columns.names[:2] == FEW[:2]
    assert all(name.startswith("field_voltage:2") for name in columns.names[2:])
    assert len(columns.names) > 4
    run = whole(npcc, t_end=2.0)
    every = run.frame("speed, voltage, field_voltage")
    few = pd.DataFrame(run.table(columns), columns=list(columns.header))
    pd.testing.assert_frame_equal(few, every[list(few.columns)], rtol=1e-12)
    for wrong, said in (("speed_pu:78:9", "did you mean 'speed_pu:7"), ("volts", "known: ")):
        with pytest.raises(gf.OptionError, match=said):
            column_filter(npcc, [wrong])


def test_what_has_a_memory_is_the_same_in_pieces_as_in_the_whole(npcc, short_pieces, tmp_path):
    monitor = "frequency 1-5, voltage_angle 3, flow 3-2, load 3-9, area 1, angle_coi 78, every 7"
    path = tmp_path / "run.parquet"
    streamed(npcc, path, columns=monitored(npcc, monitor))
    frame, kept = pd.read_parquet(path), whole(npcc)
    pd.testing.assert_frame_equal(frame, kept.frame(monitor), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(frame["time"], kept.times[::7])


def test_memory_does_not_grow_with_the_length_of_a_run(npcc, short_pieces, tmp_path):
    columns = monitored(npcc, "speed 78, voltage 3, field_voltage, flow 3-2, frequency 3")

    def peak(t_end):
        tracemalloc.start()
        streamed(npcc, tmp_path / "a.csv", (), t_end, columns=columns)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(0.1)
    samples = (30.0 - 15.0) / 0.005
    assert peak(30.0) - peak(15.0) < samples * npcc.n_states * 8 / 10


def test_a_table_that_does_not_fit_is_refused_and_nothing_is_written(npcc, tmp_path):
    with pytest.raises(gf.OutputError, match=r"a\.csv: a table of .* rows and .* Fewer columns"):
        streamed(npcc, tmp_path / "a.csv", t_end=1e14)
    assert not list(tmp_path.iterdir())
