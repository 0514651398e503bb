"""Tables of runs read back."""

import numpy as np
import pytest

import gridfold as gf
from gridfold.io.run_tables import read_run_table


@pytest.fixture(scope="module")
def run(npcc):
    return gf.simulate(npcc, [gf.MachineTrip(23, "1", 0.1)], 0.3, gf.RungeKutta4(0.01))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_is_read_as_it_was_written(run, tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    write = run.to_csv if suffix == ".csv" else run.to_parquet
    write(path, "speed 23, flow 3-2")
    table, frame = read_run_table(path), run.frame("speed 23, flow 3-2")
    np.testing.assert_allclose(table.times, frame["time"])
    assert list(table.values) == list(frame.columns[1:])
    for name, values in table.values.items():
        np.testing.assert_allclose(values, frame[name], rtol=1e-14)
    assert np.isnan(table.values["speed_pu:23:1"][-1])
    assert table.metadata["case"] == "npcc"
    assert table.columns_record["area"] == {"1": "2-3,23"}


def test_a_table_of_another_program_is_read_if_it_has_times_and_numbers(tmp_path):
    (tmp_path / "a.csv").write_text("time,voltage_pu:3,n\n0,1.0,1\n0.5,,2\n")
    table = read_run_table(tmp_path / "a.csv")
    np.testing.assert_array_equal(table.values["voltage_pu:3"], [1.0, np.nan])
    np.testing.assert_array_equal(table.values["n"], [1.0, 2.0])
    assert table.metadata == {}


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", "x,y\n0,1\n", "there is no column 'time'"),
        ("a.csv", "time,y\n0,one\n1,two\n", "column 'y' holds string, not numbers"),
        ("a.csv", "time,y\n", "there is no row"),
        ("a.csv", "time,y\n1,0\n0,0\n", "the times do not ascend"),
        ("a.csv", "", "cannot be read"),
        ("a.parquet", "not Parquet", "cannot be read"),
        ("a.txt", "time\n0\n", "a table of a run ends in .csv or .parquet"),
    ],
)
def test_what_is_no_table_of_a_run_is_refused_with_its_reason(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(gf.CaseFileError, match=said):
        read_run_table(tmp_path / name)


def test_metadata_that_are_damaged_are_told(tmp_path):
    (tmp_path / "a.csv").write_text("time,y\n0,1\n")
    (tmp_path / "a.csv.meta.json").write_text("{")
    with pytest.raises(gf.CaseFileError, match=r"a\.csv\.meta\.json.*\n.*not JSON"):
        read_run_table(tmp_path / "a.csv")
    with pytest.raises(gf.CaseFileError, match="cannot be read"):
        read_run_table(tmp_path / "absent.csv")
