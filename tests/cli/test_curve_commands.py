"""What is watched on the command line, and the commands about curves: plot, compare."""

from __future__ import annotations

import json

import pandas as pd
import pytest

import gridfold as gf


def plain(text):
    return " ".join(text.split())


@pytest.fixture(scope="module")
def tables(npcc, tmp_path_factory):
    """Two runs as tables: a fault of 0.1 s, and of 0.15 s."""
    folder = tmp_path_factory.mktemp("tables")
    for name, duration in (("short.parquet", 0.1), ("long.csv", 0.15)):
        run = gf.simulate(npcc, [gf.BusFault(3, 0.2, duration)], 1.0, gf.RungeKutta4(0.01))
        write = run.to_csv if name.endswith("csv") else run.to_parquet
        write(folder / name, "voltage area:1, flow 3-2, angle_coi")
    return folder


def test_what_is_watched_without_a_file_is_told_as_a_table(command):
    options = ("simulate", "npcc", "--fault-bus", 3, "--t-end", 0.3, "--model", "detailed")
    code, out, _ = command(*options, "--monitor", "flow 3-2, voltage study area except 2-36")
    assert code == 0
    rows = [
        line.split() for line in out.splitlines() if "p_mw:3-2" in line or "voltage_pu:" in line
    ]
    assert [row[1] for row in rows] == ["p_mw:3-2", "voltage_pu:1"]
    _, out, _ = command(*options, "--monitor", "voltage 3", "--json", "-")
    (watched,) = json.loads(out)["monitor"]
    assert (watched["name"], watched["lowest"], watched["lowest_at"]) == ("voltage_pu:3", 0.0, 0.0)
    assert watched["end"] == pytest.approx(1.0, abs=0.1)


def test_older_options_still_work_and_say_what_they_are_now(command, tmp_path):
    options = (
        "simulate",
        "npcc",
        "--t-end",
        0.1,
        "--model",
        "detailed",
        "--csv",
        tmp_path / "a.csv",
    )
    _, _, err = command(*options, "--signals", "field_voltage")
    assert "--signals is now --monitor 'angle, speed, voltage, field_voltage'" in plain(err)
    assert "field_voltage:23:1" in pd.read_csv(tmp_path / "a.csv").columns
    _, _, err = command(*options, "--columns", "speed_pu:7*")
    assert "--columns is now --monitor" in plain(err)
    names = list(pd.read_csv(tmp_path / "a.csv").columns)
    assert names[0] == "time"
    assert all(name.startswith("speed_pu:7") for name in names[1:])


def test_a_watched_run_is_drawn_and_recorded_with_what_is_watched(command, tmp_path):
    targets = ("--plot", tmp_path / "a.svg", "--comtrade", tmp_path / "a.cfg")
    options = (
        "--fault-bus",
        3,
        "--t-end",
        0.3,
        "--model",
        "linear",
        "--monitor",
        "frequency 3, 78",
    )
    code, out, _ = command("simulate", "npcc", *options, *targets)
    assert code == 0
    picture = (tmp_path / "a.svg").read_text()
    assert "Bus frequency (Hz)" in picture
    assert "Rotor angle" not in picture
    assert "frequency_hz:78,,,Hz" in (tmp_path / "a.cfg").read_text()
    assert (tmp_path / "a.dat").read_text().count("\n") == 31
    assert "frequency_hz:78 lies outside the study area" in plain(out)


def test_tables_are_drawn_by_what_is_asked_of_them(command, tables, tmp_path):
    target = tmp_path / "a.svg"
    code, out, _ = command(
        "plot", tables / "short.parquet", "flow 3-2, voltage 1-3", "--out", target
    )
    assert code == 0
    assert "a.svg is written" in plain(out)
    picture = target.read_text()
    assert "Flow into the line (MW)" in picture
    assert "Rotor angle" not in picture
    code, _, err = command("plot", tables / "short.parquet", "frequency 3", "--out", target)
    assert code == 2
    assert "has no 'frequency'; it has: voltage, flow, angle_coi" in plain(err)
    code, _, err = command("plot", tables / "short.parquet", "--out", tmp_path / "a.pdf")
    assert code == 2


def test_two_runs_are_compared_column_by_column(command, tables, tmp_path):
    both = (tables / "short.parquet", tables / "long.csv")
    code, out, _ = command("compare", *both, "voltage 1-9, flow 3-2", "--json", "-")
    assert code == 0
    record = json.loads(out)
    names = [row["name"] for row in record["columns"]]
    assert sorted(names) == sorted(
        [f"voltage_pu:{k}" for k in range(1, 10)] + ["p_mw:3-2", "q_mvar:3-2"]
    )
    short, long = pd.read_parquet(both[0]), pd.read_csv(both[1])
    row = next(row for row in record["columns"] if row["name"] == "voltage_pu:3")
    apart = long["voltage_pu:3"] - short["voltage_pu:3"]
    assert row["largest"] == pytest.approx(apart[apart.abs().argmax()])
    assert row["at"] == pytest.approx(short["time"][apart.abs().argmax()])
    code, out, _ = command("compare", *both, "--out", tmp_path / "a.svg", "--limit", 2)
    assert code == 0
    assert "columns differ less" in out
    assert "Dashed less" in (tmp_path / "a.svg").read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("short.parquet", "absent.csv"), "cannot be read"),
        (("short.parquet", "."), "give two tables of runs"),
        (("short.parquet", "other.csv"), "has none of the columns"),
        ((".", "."), "holds no study"),
        ((".", ".", "voltage"), "it has no effect on studies"),
    ],
)
def test_what_cannot_be_compared_is_told(command, tables, monkeypatch, arguments, said):
    monkeypatch.chdir(tables)
    (tables / "other.csv").write_text("time,x\n0,1\n1,2\n")
    code, _, err = command("compare", *arguments)
    assert code == 2
    assert said in plain(err)
