"""Clearing-time maps from the command line: places, folder, tables, picture and page."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import pandas as pd
import pytest

import gridfold as gf
from gridfold import ClearingTime

QUICK = ("--t-end", 1, "--longest", 0.1, "--resolution", 0.05, "--model", "detailed")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """All that is written of a map of the whole built-in case."""
    return tmp_path_factory.mktemp("map")


@pytest.fixture
def whole(command, written):
    """The same, made once."""
    if not (written / "map.html").exists():
        kinds = ("out", "csv", "parquet", "json", "plot", "report")
        names = ("npcc.cct", "a.csv", "a.parquet", "a.json", "a.png", "map.html")
        options = [x for k, n in zip(kinds, names, strict=True) for x in (f"--{k}", written / n)]
        code, out, err = command("cct", "npcc", *QUICK, *options)
        assert (code, err) == (0, "")
        (written / "out.txt").write_text(out)
    return written


def test_without_places_every_bus_of_the_grid_is_one(whole, npcc):
    rows = json.loads((whole / "a.json").read_text())["clearing_times"]
    assert [row["bus"] for row in rows] == [bus.number for bus in npcc.case.buses]
    out = (whole / "out.txt").read_text()
    assert "The 40 shortest of 140." in out
    assert "one clearing time of each place at once" in " ".join(out.split())


def test_tables_page_and_folder_have_the_same_places(whole):
    rows = json.loads((whole / "a.json").read_text())["clearing_times"]
    for frame in (pd.read_csv(whole / "a.csv"), pd.read_parquet(whole / "a.parquet")):
        assert frame["cct_s"].tolist() == [row["cct_s"] for row in rows]
        assert frame["place"].tolist() == [row["place"] for row in rows]
    lines = (whole / "npcc.cct" / "clearing_times.jsonl").read_text().splitlines()
    kept = [json.loads(line) for line in lines]
    assert sorted(row["place"] for row in kept) == sorted(row["place"] for row in rows)
    text = (whole / "map.html").read_text()
    assert all(f'["{row["place"]}",' in text for row in rows)
    assert (whole / "a.png").read_bytes().startswith(b"\x89PNG")


def test_what_is_complete_is_resumed_without_a_run_and_reported_from_its_folder(whole, command):
    code, out, _ = command(
        "cct", "npcc", *QUICK, "--out", whole / "npcc.cct", "--resume", "--json", "-"
    )
    assert code == 0
    before = json.loads((whole / "a.json").read_text())
    assert json.loads(out)["clearing_times"] == before["clearing_times"]
    assert command("report", whole / "npcc.cct", "--out", whole / "again.html")[0] == 0
    assert (whole / "again.html").read_text() == (whole / "map.html").read_text()
    code, _, err = command("cct", "npcc", *QUICK, "--out", whole / "npcc.cct")
    assert code == 2
    assert "--resume" in err


def test_a_map_on_a_reduced_model_goes_on_though_its_rungs_are_timed_anew(command, tmp_path):
    options = ("--buses", "17", "--model", "adaptive", "--t-end", 1, "--longest", 0.1)
    first = ("cct", "npcc", *options, "--out", tmp_path / "map", "--json", "-")
    code, out, _ = command(*first)
    assert code == 0
    again, resumed, _ = command(*first, "--resume")
    assert again == 0
    assert json.loads(resumed)["clearing_times"] == json.loads(out)["clearing_times"]


def test_another_grid_of_times_in_the_same_folder_is_refused(whole, command):
    again = ("cct", "npcc", *QUICK, "--out", whole / "npcc.cct", "--resume")
    code, _, err = command(*again, "--longest", 0.2)
    assert code == 2
    assert "longest (was 0.1, is 0.2)" in " ".join(err.split())


def test_calibration_does_not_start_from_a_fault_whose_clearing_time_is_not_known(
    command, monkeypatch
):
    failed = ClearingTime(gf.BusFault(3), math.nan, False, 1, reason="the network is singular")
    found = SimpleNamespace(failed=(failed,))
    monkeypatch.setattr("gridfold.cli.calibrate.critical_clearing_times", lambda *_, **__: found)
    code, _, err = command("calibrate", "npcc", "--study-buses", "1-36", "--buses", "3")
    assert code == 2
    told = "bus 3: the clearing time cannot be found: the network is singular"
    assert told in " ".join(err.split())
