"""Data sets from beginning to end: however they are made, they are the same."""

import json
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pandas as pd
import pytest

import gridfold as gf
from gridfold.io.sample_store import SampleStore
from gridfold.sampling import SamplePlan
from gridfold.study import Stage
from gridfold.study.summary import trajectory_figures

ANGLES = tuple(f"angle_deg:{unit}" for unit in ("21:1", "22:1", "23:1", "23:2"))
#: A third of the samples has more load than the network can carry.
PLAN = {
    "samples": 12,
    "seed": 4,
    "chunk": 5,
    "load": [
        {"name": "west", "where": "1-36", "factor": {"choice": [0.95, 1.05, 4.0]}},
        {"name": "rest", "where": "all except 1-36", "factor": {"uniform": [0.97, 1.03]}},
    ],
    "parameter": [{"name": "h", "parameter": "inertia", "factor": {"uniform": [0.8, 1.0]}}],
    "faults": {
        "bus_faults": "3,26",
        "line_faults": "2,3",
        "clearing_time": {"uniform": [0.05, 0.4]},
    },
    "contingency": [{"name": "trip", "events": [{"kind": "machine-trip", "bus": 21}]}],
    "run": {"t_end": 2.0, "step": 0.01, "method": "rk4"},
    "outputs": {"trajectories": "unstable", "monitor": "angle 21-23, every 10"},
    "check": {"samples": 3},
}
TOML = """
samples = 40
seed = 4
chunk = 4
[[load]]
factor = {{ uniform = [0.97, 1.03] }}
[faults]
bus_faults = "3,26"
clearing_time = {{ uniform = [0.05, 0.4] }}
[run]
t_end = {t_end}
step = 0.01
method = "rk4"
[check]
samples = 0
"""


def plan(**changes):
    return SamplePlan.model_validate({**PLAN, **changes})


def rows(folder):
    return SampleStore.read(folder).frame()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("samples") / "made"
    progress = []
    outcome = gf.sample(plan(), folder, workers="threads", count=1, on_progress=progress.append)
    return folder, outcome, progress


def test_every_sample_is_there_once_and_counted(made):
    folder, outcome, progress = made
    frame = rows(folder)
    assert frame["number"].tolist() == list(range(1, 13))
    assert sorted(path.name for path in (folder / "samples").iterdir()) == [
        f"part-00000{k}.parquet" for k in range(3)
    ]
    assert outcome.complete
    assert outcome.stage is Stage.DONE
    kinds = (outcome.stable, outcome.unstable, outcome.infeasible, outcome.failed)
    assert sum(kinds) == 12
    assert outcome.failed == 0
    assert min(kinds[:3]) > 0
    assert outcome.infeasible == (frame["status"] == "infeasible").sum()
    assert [each.done for each in progress if each.stage is Stage.RUNNING] == [0, 5, 10, 12]
    assert progress[-1].seconds_left == 0.0


def test_an_infeasible_sample_keeps_what_was_drawn_and_its_reason(made):
    frame = rows(made[0])
    heavy = frame[frame["west"] == 4.0]
    assert set(heavy["status"]) == {"infeasible"}
    assert heavy["reason"].str.contains("the power flow did not converge").all()
    assert heavy[["rest", "h", "contingency"]].notna().all(axis=None)
    assert heavy[["stable", "nadir_hz", "load_mw"]].isna().all(axis=None)
    assert set(frame["status"][frame["west"] != 4.0]) <= {"completed", "lost synchronism"}


def test_labels_are_those_of_a_single_run_of_the_case(made):
    frame = rows(made[0]).set_index("number")
    for number in frame.index[frame["stable"].notna()]:
        row, single = frame.loc[number], gf.single_sample(plan(), number)
        model = gf.build_model(single.case)
        run = gf.simulate(model, single.events, 2.0, single.stepper)
        figures = trajectory_figures(run)
        assert figures["status"] == row["status"]
        for name in ("largest_separation_deg", "lowest_voltage", "nadir_hz", "damping_ratio"):
            if figures.get(name) is None:
                assert pd.isna(row[name])
            else:
                assert row[name] == pytest.approx(figures[name], rel=1e-9), (number, name)
        lost = row["status"] == "lost synchronism"
        assert pd.notna(row["lost_at"]) == lost
        if lost:
            assert row["lost_at"] == run.times[-1]
            assert row["lost_machine"] == run.culprit.partition(":")[2]


def test_the_operating_point_is_that_of_the_case(made):
    frame = rows(made[0]).set_index("number")
    number = frame.index[frame["stable"].notna()][0]
    single = gf.single_sample(plan(), number)
    flow = gf.solve_power_flow(single.case)
    row = frame.loc[number]
    assert row["load_mw"] == pytest.approx(sum(load.active_mw for load in single.case.loads))
    assert row["generation_mw"] - row["load_mw"] == pytest.approx(flow.losses_mw)
    assert row["start_lowest_voltage"] == pytest.approx(np.abs(flow.voltage).min())


def test_curves_of_the_unstable_samples_are_kept_and_decimated(made):
    folder, _, _ = made
    frame = rows(folder).set_index("number")
    curves = pd.read_parquet(folder / "trajectories")
    assert set(curves["number"]) == set(frame.index[frame["stable"] == False])  # noqa: E712
    assert list(curves.columns) == ["number", "time", *ANGLES]
    for number, curve in curves.groupby("number"):
        assert np.diff(curve["time"]).max() == pytest.approx(0.1, abs=1e-6)
        assert curve["time"].max() <= frame.loc[number, "ended_at"]


def test_the_card_tells_what_is_in_the_data(made):
    folder, outcome, _ = made
    card = json.loads((folder / "card.json").read_text())
    assert card["grid"]["fingerprint"] == gf.load_case("npcc").fingerprint
    assert card["grid"]["models"]["two_axis"] == 48
    assert card["samples"] == {
        "wanted": 12,
        "made": 12,
        "stable": outcome.stable,
        "unstable": outcome.unstable,
        "infeasible": outcome.infeasible,
        "failed": 0,
    }
    assert sum(card["infeasible_reasons"].values()) == outcome.infeasible
    assert {column["name"] for column in card["columns"]} == set(rows(folder).columns)
    anew = card["validation"]["run_anew"]
    assert (anew["samples"], anew["same_status"]) == (3, 3)
    assert max(anew["largest_difference"].values()) < 1e-9
    text = (folder / "card.md").read_text()
    assert f"| infeasible | {outcome.infeasible} |" in text
    assert "3 samples were run anew" in text
    assert "Seed 4, sobol" in text


@pytest.mark.parametrize("workers", ["threads", "processes"])
def test_workers_and_chunks_change_nothing(made, tmp_path, workers):
    small = plan(chunk=2, samples=8, check={"samples": 0})
    gf.sample(small, tmp_path / "other", workers=workers, count=2)
    pd.testing.assert_frame_equal(rows(tmp_path / "other"), rows(made[0])[:8])


def test_a_killed_data_set_goes_on_where_it_was(tmp_path):
    path, out = tmp_path / "plan.toml", tmp_path / "killed"
    path.write_text(TOML.format(t_end=16.0))
    line = [sys.executable, "-m", "gridfold", "sample", str(path), "--out", str(out)]
    with subprocess.Popen([*line, "--workers", "threads", "-j", "1"]) as process:
        while process.poll() is None and len(list(out.glob("samples/part-*"))) < 2:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    before = {part: part.stat().st_mtime_ns for part in out.glob("samples/part-*")}
    assert 2 <= len(before) < 10
    (out / "samples" / ".part-000009-half.parquet").write_bytes(b"half a file")
    outcome = gf.sample(path, out, resume=True, workers="threads", count=1)
    assert outcome.complete
    assert all(part.stat().st_mtime_ns == when for part, when in before.items())
    assert not list(out.glob("samples/.*"))
    frame = rows(out)
    assert frame["number"].tolist() == list(range(1, 41))
    gf.sample(path, tmp_path / "calm", workers="threads", count=1)
    pd.testing.assert_frame_equal(frame, rows(tmp_path / "calm"))


def test_a_file_that_is_not_whole_is_made_again(made, tmp_path):
    small = plan(samples=4, chunk=2, check={"samples": 0})
    gf.sample(small, tmp_path / "s", workers="threads", count=1)
    before = rows(tmp_path / "s")
    part = tmp_path / "s" / "samples" / "part-000001.parquet"
    part.write_bytes(part.read_bytes()[:100])
    assert gf.sample(small, tmp_path / "s", resume=True, workers="threads", count=1).complete
    pd.testing.assert_frame_equal(rows(tmp_path / "s"), before)


def test_a_sobol_data_set_may_grow_and_no_other(made, tmp_path):
    out, rest = tmp_path / "s", {"workers": "threads", "count": 1}
    few = {"chunk": 4, "check": {"samples": 0}}
    gf.sample(plan(samples=6, **few), out, **rest)
    assert gf.sample(plan(samples=12, **few), out, resume=True, **rest).done == 12
    pd.testing.assert_frame_equal(rows(out), rows(made[0]))
    with pytest.raises(
        gf.OptionError, match="samples was 12 and is 6; only with sobol it may grow"
    ):
        gf.sample(plan(samples=6, **few), out, resume=True, **rest)
    with pytest.raises(gf.OptionError, match="seed was 4 and is 5"):
        gf.sample(plan(samples=12, seed=5, **few), out, resume=True, **rest)
    with pytest.raises(gf.OptionError, match="holds samples already"):
        gf.sample(plan(**few), out, **rest)


def test_a_stop_writes_what_is_worked_on(tmp_path):
    stop = threading.Event()

    def after_the_first(progress):
        if progress.done:
            stop.set()

    rest = {"workers": "threads", "count": 1}
    small = plan(chunk=1, check={"samples": 0})
    outcome = gf.sample(small, tmp_path / "s", on_progress=after_the_first, stop=stop, **rest)
    assert outcome.stage is Stage.INTERRUPTED
    assert 1 <= outcome.done < 12
    assert len(rows(tmp_path / "s")) == outcome.done
    assert "of 12 samples" in (tmp_path / "s" / "card.md").read_text()


def test_margins_are_those_of_the_clearing_time(tmp_path):
    small = plan(
        samples=2,
        load=[],
        parameter=[],
        contingency=[],
        faults={"bus_faults": "26", "clearing_time": {"uniform": [0.1, 0.3]}},
        clearing_times={"wanted": True, "resolution": 0.05, "longest": 1.0},
        check={"samples": 0},
    )
    gf.sample(small, tmp_path / "s", workers="threads", count=1)
    frame = rows(tmp_path / "s")
    model = gf.build_model(gf.load_case("npcc"))
    found = gf.critical_clearing_time(model, gf.BusFault(26), 0.05, 1.0, 2.0, gf.RungeKutta4(0.01))
    assert frame["critical_clearing_time"].tolist() == [found.seconds] * 2
    assert frame["margin"].to_numpy() == pytest.approx(
        found.seconds - frame["clearing_time"].to_numpy()
    )


def test_margins_of_samples_that_run_together_are_those_of_each(tmp_path):
    varied = plan(
        samples=5,
        contingency=[],
        load=[{"name": "west", "where": "1-36", "factor": {"uniform": [0.95, 1.05]}}],
        faults={"bus_faults": "3,26", "clearing_time": {"uniform": [0.1, 0.3]}},
        clearing_times={"wanted": True, "resolution": 0.05, "longest": 1.0},
        outputs={"trajectories": "none"},
        check={"samples": 0},
    )
    gf.sample(varied, tmp_path / "s", workers="threads", count=1)
    for row in rows(tmp_path / "s").to_dict("records"):
        one = gf.single_sample(varied, row["number"])
        model = gf.build_model(one.case)
        found = gf.critical_clearing_time(model, one.events[0], 0.05, 1.0, 2.0, one.stepper)
        assert row["critical_clearing_time"] == found.seconds
        assert row["clearing_time_bounded"] == found.bounded


def test_a_plan_without_anything_that_happens_is_refused(tmp_path):
    with pytest.raises(gf.OptionError, match="no contingencies"):
        gf.sample(SamplePlan.model_validate({"samples": 1, "seed": 1}), tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_there_is_no_sample_beyond_the_last():
    with pytest.raises(gf.OptionError, match="samples 1 to 12, not 13"):
        gf.single_sample(plan(), 13)
