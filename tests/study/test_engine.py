"""Studies from beginning to end: all ways to run one give the same rows."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cases import FALLING

import gridfold as gf
import gridfold.runs.simulate as simulation
from gridfold.equivalents.families import Mode
from gridfold.equivalents.ladder import Ladder
from gridfold.io.event_records import relays_of
from gridfold.io.study_store import FILE, StudyStore
from gridfold.report.study_tables import study_facts
from gridfold.study import Stage, run_study
from gridfold.study.check_sample import checked_runs
from gridfold.study.study_file import parse_study
from gridfold.study.summary import WALL, trajectory_figures

SHORT = {
    "schema": 1,
    "contingencies": {"bus_faults": "1-6", "machine_trips": "21,22", "clearing_time": 0.05},
    "contingency": [
        {"name": "far", "events": [{"kind": "bus-fault", "bus": 78, "duration": 0.1}]},
        {"name": "all out", "events": [{"kind": "bus-fault", "bus": 26, "duration": 0.5}]},
    ],
    "model": {"kind": "detailed"},
    "run": {"t_end": 1.0},
}
#: One whose networks are not those of the intact system, on a reduced model.
REDUCED = SHORT | {
    "contingencies": {
        "bus_faults": "3",
        "line_faults": "3,2",
        "machine_trips": "21",
        "clearing_time": 0.05,
    },
    "contingency": [],
    "model": {"kind": "paper", "order": 40, "angle_deg": 20},
    "check": {"sample": "all"},
}
#: The same with a ladder.
LADDER = REDUCED | {"model": {"kind": "adaptive", "order": 20, "angle_deg": 20, "retain": 3}}


def rows(folder):
    """The results without times of the machine."""
    with StudyStore.read(folder) as store:
        frame = store.frame()
    return frame[[name for name in frame if not name.startswith(WALL)]]


def study_facts_of(folder):
    with StudyStore.read(folder) as store:
        return study_facts(store)


def curves(folder, number):
    with StudyStore.read(folder) as store:
        return store.curves(number)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "reference"
    return folder, run_study(parse_study(SHORT), folder, count=1)


@pytest.fixture(scope="module")
def reduced(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "reduced"
    run_study(parse_study(REDUCED), folder, count=1)
    return folder


def test_every_contingency_has_its_row(reference):
    folder, run = reference
    assert (run.stage, run.done, run.total, run.failed) == (Stage.DONE, 10, 10, 0)
    assert run.complete
    frame = rows(folder)
    assert frame["number"].tolist() == list(range(1, 11))
    assert frame["name"].tolist()[-2:] == ["far", "all out"]
    assert frame["stable"].tolist() == [True] * 9 + [False]
    assert run.unstable == 1
    assert frame["critical_machine"].iloc[-1] == "26:1"
    assert "rotor_angle:26:1" in frame["reason"].iloc[-1]


def test_a_row_says_what_a_run_of_its_own_says(reference):
    folder, _ = reference
    model = gf.build_model(gf.load_case("npcc"))
    run = gf.simulate(model, [gf.BusFault(3, duration=0.05)], t_end=1.0)
    row = rows(folder).set_index("name").loc["bus 3"]
    angles = run.rotor_angle_deg()
    spread = np.ptp(angles, axis=1)
    assert row["largest_separation_deg"] == pytest.approx(spread.max(), abs=1e-9)
    assert row["separation_at"] == run.times[spread.argmax()]
    speed = run.signal("speed") @ model.inertia(model.machines)
    hertz = 60 * speed / model.inertia(model.machines).sum()
    assert row["nadir_hz"] == pytest.approx(hertz.min(), abs=1e-9)
    late = run.times >= 0.05
    lowest = np.abs(run.bus_voltage()[late]).min()
    assert row["lowest_voltage"] == pytest.approx(lowest, rel=1e-11)
    found = curves(folder, 3)
    np.testing.assert_allclose(found["run_times"][[0, -1]], [0.0, 1.0])
    coi = run.rotor_angle_deg(["21:1"], gf.AngleReference.CENTRE_OF_INERTIA)[-1, 0]
    machines = found["units"].tolist()
    assert found["run_angles"][-1, machines.index("21:1")] == pytest.approx(coi, abs=1e-4)


def test_threads_and_executors_give_the_same_rows(reference, tmp_path):
    folder, _ = reference
    run_study(parse_study(SHORT), tmp_path / "threads", count=3)
    pd.testing.assert_frame_equal(rows(tmp_path / "threads"), rows(folder))
    with ThreadPoolExecutor(2) as pool:
        run_study(parse_study(SHORT), tmp_path / "own", executor=pool)
    pd.testing.assert_frame_equal(rows(tmp_path / "own"), rows(folder))


def test_processes_give_the_same_rows_on_a_ladder_too(tmp_path, falling_costs):
    run_study(parse_study(LADDER), tmp_path / "t", count=1)
    run = run_study(parse_study(LADDER), tmp_path / "p", workers="processes", count=2)
    assert run.workers == "2 processes"
    frame = rows(tmp_path / "t")
    pd.testing.assert_frame_equal(rows(tmp_path / "p"), frame)
    assert (frame["error_rms_deg"] < 1.0).all()
    assert (frame["linear_s"] + frame["linear_whole_s"] > 0).all()
    with StudyStore.read(tmp_path / "p") as store:
        settings = store.identity["settings"]
    assert (settings["model"], settings["model_reason"]) == ("adaptive", None)
    assert len(settings["kept"]) == 3
    assert settings["step_seconds"] == {mode.value: s for mode, s in FALLING.items()}


@pytest.fixture
def long_steps(monkeypatch):
    """A step of the detailed model is said to take a second, so that a reduction pays."""
    monkeypatch.setattr("gridfold.equivalents.auto.step_seconds", lambda *_: 1.0)


def automatic(**model):
    content = SHORT | {"model": {"order": 20} | model, "check": {"sample": 0}}
    return parse_study(content | {"contingencies": {"bus_faults": "1-6", "clearing_time": 0.05}})


def settings_of(folder):
    with StudyStore.read(folder) as store:
        return store.identity["settings"]


def test_a_short_study_runs_on_the_detailed_model_and_says_why(tmp_path):
    study = automatic(outputs="polar")
    run_study(study, tmp_path / "a", count=1)
    settings = settings_of(tmp_path / "a")
    assert settings["model"] == "detailed"
    assert settings["model_reason"].startswith("8 detailed runs take about ")
    assert "to reduce 351 external states would take about 1.1 s" in settings["model_reason"]
    assert "kept" not in settings
    assert run_study(study, tmp_path / "a", resume=True).complete
    assert settings_of(tmp_path / "a") == settings


def test_a_study_without_a_study_area_runs_on_the_detailed_model_and_says_why(tmp_path):
    folder = Path(__file__).parents[2] / "examples" / "own_exciter_study"
    content = {
        "case": {"source": "two-plants", "devices": ["my_exciter.py"]},
        "contingencies": {"bus_faults": "1-2"},
        "run": {"t_end": 0.5},
    }
    run_study(parse_study(content), tmp_path / "a", folder=folder, count=1, trust_devices=True)
    settings = settings_of(tmp_path / "a")
    assert settings["model"] == "detailed"
    assert settings["model_reason"] == "no study area is given"


def test_a_study_that_goes_on_keeps_the_model_and_the_costs_chosen_at_first(
    tmp_path, falling_costs, long_steps, monkeypatch
):
    study = automatic()
    run_study(study, tmp_path / "whole", count=1)
    settings = settings_of(tmp_path / "whole")
    assert settings["model"] == "adaptive"
    assert settings["model_reason"].startswith("8 detailed runs take about 8e+02 s; the ladder is")
    assert (rows(tmp_path / "whole")["linear_s"] > 0).sum() > 1

    def interrupt(progress):
        if progress.done == 2 and progress.latest:
            raise KeyboardInterrupt

    first = run_study(study, tmp_path / "parts", count=1, on_progress=interrupt)
    assert first.stage is Stage.INTERRUPTED
    before = first.done

    # Now the ladder would not be chosen, and none of its rungs would be used.
    def dear(ladder, stepper):
        modes = (Mode.DETAILED, *ladder.rungs)
        return replace(ladder, step_seconds={mode: 1.0 + k for k, mode in enumerate(modes)})

    monkeypatch.setattr(Ladder, "measured", dear)
    monkeypatch.setattr("gridfold.equivalents.auto.FACTOR", 0.0)
    monkeypatch.setattr("gridfold.study.prepare.choose_model", None)
    assert before < 8
    assert run_study(study, tmp_path / "parts", resume=True, count=1).complete
    pd.testing.assert_frame_equal(rows(tmp_path / "parts"), rows(tmp_path / "whole"))
    assert settings_of(tmp_path / "parts") == settings


def test_topologies_that_contingencies_leave_count_against_a_reduction(
    tmp_path, falling_costs, long_steps
):
    content = SHORT | {"contingencies": {"machine_trips": "21-26"}, "contingency": []}
    run_study(parse_study(content | {"model": {"order": 20}}), tmp_path / "a", count=1)
    settings = settings_of(tmp_path / "a")
    assert settings["model"] == "detailed"
    assert "the ladder is predicted to take" in settings["model_reason"]


def test_a_cluster_that_loses_a_worker_gives_the_same_rows(reduced, tmp_path):
    """One of two worker processes is killed once the first result is there."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    killed = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:

        def kill(progress):
            if progress.latest and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        address = cluster.scheduler_address
        run = run_study(parse_study(REDUCED), tmp_path / "d", cluster=address, on_progress=kill)
    assert killed
    assert run.complete
    assert run.failed == 0, rows(tmp_path / "d")[["name", "reason"]].to_string()
    pd.testing.assert_frame_equal(rows(tmp_path / "d"), rows(reduced))


def test_a_scheduler_that_is_not_there_is_named(tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed")
    with pytest.raises(gf.OptionError, match="no scheduler at nowhere://1"):
        run_study(parse_study(SHORT), tmp_path / "d", cluster="nowhere://1")


def test_checked_contingencies_carry_their_error(reduced):
    frame = rows(reduced)
    assert (frame["checked"] == "completed").all()
    assert frame["error_rms_deg"].notna().all(), "of a tripped machine's contingency too"
    assert (frame["error_rms_deg"] < frame["error_largest_deg"]).all()
    assert (frame["error_largest_deg"] < 1.0).all()
    assert (frame["detailed_s"] + frame["hybrid_s"] + frame["linear_s"]).tolist() == pytest.approx(
        [1.0] * len(frame)
    )
    found = curves(reduced, 1)
    assert {"run_angles", "detailed_angles", "linear_angles", "error"} <= set(found)
    apart = np.abs(found["run_angles"] - found["detailed_angles"]).max()
    assert 0 < apart < 1.0


def test_checks_are_chosen_by_what_the_runs_came_to_and_can_be_interrupted(reduced, tmp_path):
    folder, wanted = tmp_path / "study", REDUCED | {"check": {"sample": 2}}
    every, stop = rows(reduced), threading.Event()

    def interrupt(progress):
        if progress.message.endswith("checked with the detailed model"):
            stop.set()

    first = run_study(parse_study(wanted), folder, count=1, on_progress=interrupt, stop=stop)
    assert first.complete
    assert first.stage is Stage.INTERRUPTED
    assert rows(folder)["checked"].isna().all()
    second = run_study(parse_study(wanted), folder, count=1, resume=True)
    assert second.stage is Stage.DONE
    found = rows(folder)
    chosen = checked_runs(every, 2)
    assert found["number"][found["checked"].notna()].tolist() == sorted(chosen)
    of_checks = [name for name in every if name.startswith(("error_", "checked"))]
    unlike = found["number"].isin(chosen)
    pd.testing.assert_frame_equal(found.drop(columns=of_checks), every.drop(columns=of_checks))
    pd.testing.assert_frame_equal(found[unlike], every[unlike])


def test_checks_compare_damping_frequency_and_voltage(reduced):
    frame = rows(reduced)
    assert frame[["error_nadir_hz", "error_lowest_voltage"]].notna().all(axis=None)
    assert frame["error_nadir_hz"].abs().max() < 1e-3
    assert 0 < frame["error_lowest_voltage"].abs().max() < 0.05


def test_an_interrupted_study_goes_on_where_it_was(reference, tmp_path):
    folder = tmp_path / "study"

    def interrupt(progress):
        if progress.done == 4 and progress.latest:
            raise KeyboardInterrupt

    first = run_study(parse_study(SHORT), folder, count=1, on_progress=interrupt)
    assert first.stage is Stage.INTERRUPTED
    assert 4 <= first.done < 10
    before = rows(folder)
    second = run_study(parse_study(SHORT), folder, resume=True)
    assert second.complete
    pd.testing.assert_frame_equal(rows(folder), rows(reference[0]))
    pd.testing.assert_frame_equal(rows(folder).loc[before.index], before)
    third = run_study(parse_study(SHORT), folder, resume=True)
    assert third.done == 10


def test_a_killed_study_goes_on_and_does_nothing_twice(reference, tmp_path):
    """SIGKILL at several moments; the row of each contingency is written once by construction."""
    folder = tmp_path / "study"
    (tmp_path / "study.json").write_text(json.dumps(SHORT))
    code = (
        "import json, sys; from pathlib import Path; from gridfold.study import run_study;"
        "from gridfold.study.study_file import parse_study;"
        "study = parse_study(json.loads(Path(sys.argv[1]).read_text()));"
        "run_study(study, sys.argv[2], count=1, resume=Path(sys.argv[2], 'study.sqlite').exists())"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "study.json"), str(folder)]
    for target in (1, 4, 7):
        with subprocess.Popen(command) as process:
            while process.poll() is None and _count(folder) < target:
                time.sleep(0.002)
            process.send_signal(signal.SIGKILL)
    run = run_study(parse_study(SHORT), folder, resume=(folder / FILE).exists())
    assert run.complete
    pd.testing.assert_frame_equal(rows(folder), rows(reference[0]))


def _count(folder):
    try:
        with sqlite3.connect(f"{(folder / FILE).as_uri()}?mode=ro", uri=True) as connection:
            return connection.execute("SELECT count(*) FROM result").fetchone()[0]
    except sqlite3.OperationalError:
        return 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"run": {"t_end": 2.0}}, r"run\.t_end was 1\.0 and is 2\.0"),
        ({"case": {"source": "npcc-pst"}}, r"case\.source was 'npcc'"),
        ({"contingency": []}, "contingency was"),
    ],
)
def test_another_study_is_not_mixed_in(reference, change, said):
    with pytest.raises(gf.OptionError, match=said):
        run_study(parse_study(SHORT | change), reference[0], resume=True)
    assert len(rows(reference[0])) == 10


def test_another_version_or_other_data_are_not_mixed_in(reference, monkeypatch):
    monkeypatch.setattr("gridfold.study.identity.__version__", "0.0.0")
    with pytest.raises(gf.OptionError, match="another version of gridfold"):
        run_study(parse_study(SHORT), reference[0], resume=True)
    monkeypatch.undo()
    case = gf.load_case("npcc")
    other = replace(case, buses=(replace(case.buses[0], base_kv=2.0), *case.buses[1:]))
    monkeypatch.setattr("gridfold.study.prepare.load_case", lambda *_, **__: other)
    with pytest.raises(gf.OptionError, match="other data of the case"):
        run_study(parse_study(SHORT), reference[0], resume=True)


def test_results_are_not_written_over(reference):
    with pytest.raises(gf.OptionError, match="holds a study already"):
        run_study(parse_study(SHORT), reference[0])
    assert len(rows(reference[0])) == 10


@pytest.mark.parametrize("batch", ["auto", "off"])
def test_a_contingency_that_fails_is_a_row_with_its_reason(tmp_path, monkeypatch, batch):
    original = simulation.plan_simulation

    def plan_simulation(model, events, *rest):
        if events[0] == gf.BusFault(2, duration=0.05):
            raise ArithmeticError("the sky has fallen")
        return original(model, events, *rest)

    for module in ("simulate", "members"):
        monkeypatch.setattr(f"gridfold.runs.{module}.plan_simulation", plan_simulation)
    study = parse_study(SHORT | {"run": {"t_end": 1.0, "batch": batch}})
    run = run_study(study, tmp_path / "a", count=2)
    assert (run.done, run.failed) == (10, 1)
    row = rows(tmp_path / "a").set_index("name").loc["bus 2"]
    assert row["status"] == "failed"
    assert row["reason"] == "ArithmeticError: the sky has fallen"
    assert pd.isna(row["stable"])


def test_rows_and_curves_are_the_same_one_by_one(tmp_path, reference):
    folder, _ = reference
    study = parse_study(SHORT | {"run": {"t_end": 1.0, "batch": "off"}})
    run_study(study, tmp_path / "alone", count=1)
    there, here = rows(folder), rows(tmp_path / "alone")
    for name in here:
        if pd.api.types.is_float_dtype(here[name]):
            assert here[name].isna().equals(there[name].isna()), name
            apart = (here[name] - there[name]).abs().max()
            fitted = name in ("swing_hz", "damping_ratio")  # to the swing, which magnifies rounding
            assert pd.isna(apart) or apart < (1e-6 if fitted else 1e-9), name
        else:
            assert here[name].equals(there[name]), name
    for number in here["number"]:
        alone, together = curves(tmp_path / "alone", number), curves(folder, number)
        assert alone.keys() == together.keys()
        np.testing.assert_allclose(alone["run_angles"], together["run_angles"], atol=1e-4)


def test_a_study_that_runs_side_by_side_goes_on_one_by_one(tmp_path):
    study = parse_study(SHORT)
    alone = parse_study(SHORT | {"run": {"t_end": 1.0, "batch": "off"}})
    run_study(study, tmp_path / "a", count=1, on_progress=None)
    assert run_study(alone, tmp_path / "a", resume=True).complete


def test_kept_trajectories_are_those_of_runs_alone(tmp_path):
    kept = SHORT | {"outputs": {"trajectories": "all"}}
    run_study(parse_study(kept), tmp_path / "together", count=1)
    run_study(parse_study(kept | {"run": {"t_end": 1.0, "batch": "off"}}), tmp_path / "alone")
    for number in (1, 7, 10):
        name = f"trajectories/{number:06d}.parquet"
        here, there = (pd.read_parquet(tmp_path / k / name) for k in ("together", "alone"))
        pd.testing.assert_frame_equal(here, there, rtol=0, atol=1e-9)


class _Fragile(ThreadPoolExecutor):
    """Loses the first results of every contingency, and all those of one."""

    def __init__(self):
        super().__init__(2)
        self.seen = set()

    def submit(self, function, offline, batch):
        name = batch[0].contingency.name
        if name in self.seen and name != "bus 5":
            return super().submit(function, offline, batch)
        self.seen.add(name)
        lost = Future()
        lost.set_exception(ConnectionError("the worker is gone"))
        return lost


def test_what_a_lost_worker_had_is_done_again(reference, tmp_path):
    with _Fragile() as pool:
        run = run_study(parse_study(SHORT), tmp_path / "a", executor=pool)
    assert (run.done, run.failed) == (10, 1)
    found, there = rows(tmp_path / "a"), rows(reference[0])
    lost = found["name"] == "bus 5"
    assert found[lost]["reason"].tolist() == ["ConnectionError: the worker is gone"]
    pd.testing.assert_frame_equal(found[~lost], there[~lost])


def test_the_clock_of_the_wall_may_jump(tmp_path, monkeypatch):
    ticks = iter(range(10**9, 0, -(10**6)))
    monkeypatch.setattr(time, "time", lambda: float(next(ticks)))
    run = run_study(parse_study(SHORT), tmp_path / "a", count=1)
    assert run.complete
    assert 0 < run.seconds < 600


def test_trajectories_are_kept_where_asked_for(tmp_path):
    wanted = {"trajectories": "unstable", "signals": ["field_voltage"], "curves": False}
    run_study(parse_study(SHORT | {"outputs": wanted}), tmp_path / "a")
    files = sorted((tmp_path / "a" / "trajectories").iterdir())
    assert [file.name for file in files] == ["000010.parquet"]
    frame = pd.read_parquet(files[0])
    assert frame["angle_deg:26:1"].abs().max() > 180
    assert "field_voltage:21:1" in frame
    assert curves(tmp_path / "a", 1) is None


def test_what_is_watched_is_kept_in_files_and_as_curves(tmp_path):
    wanted = {"trajectories": "unstable", "monitor": ["flow 3-2, voltage 1-20", "area 1, every 4"]}
    content = SHORT | {"contingencies": {"bus_faults": "3"}, "outputs": wanted}
    run_study(parse_study(content), tmp_path / "a", count=1)
    (file,) = (tmp_path / "a" / "trajectories").iterdir()
    frame = pd.read_parquet(file)
    events = [gf.BusFault(26, 0.0, 0.5)]
    run = gf.simulate(gf.build_model(gf.load_case("npcc")), events, 1.0)
    monitor = "flow 3-2, voltage 1-20, area 1"
    pd.testing.assert_frame_equal(frame, run.frame(f"{monitor}, every 4"), rtol=1e-9)
    kept = curves(tmp_path / "a", 3)
    names = kept["watched_names"].tolist()
    assert names[:2] == ["p_mw:3-2", "q_mvar:3-2"]
    assert sum(name.startswith("voltage_pu") for name in names) == 12
    assert kept["watched_left_out"] == 8
    every = run.frame(monitor)
    ranges = every.max() - every.min()
    left_out = {name for name in every if name.startswith("voltage_pu")} - set(names)
    assert ranges[list(left_out)].max() <= ranges[[n for n in names if "voltage" in n]].min()
    np.testing.assert_allclose(
        kept["watched_values"],
        every[names].to_numpy().T[:, : len(kept["watched_times"])],
        rtol=1e-6,
    )


def test_what_cannot_be_watched_is_told_before_anything_is_written(tmp_path):
    for monitor, said in (("voltage 999", "outputs.monitor: voltage: there is no bus 999"),):
        with pytest.raises(gf.OptionError, match=said):
            run_study(parse_study(SHORT | {"outputs": {"monitor": monitor}}), tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_clearing_times_are_those_of_the_detailed_search(tmp_path):
    content = SHORT | {
        "contingencies": {"bus_faults": "17,26", "clearing_time": 0.05},
        "contingency": [],
        "clearing_times": {"wanted": True, "longest": 0.5},
        "run": {"t_end": 4.0},
    }
    run_study(parse_study(content), tmp_path / "a")
    model = gf.build_model(gf.load_case("npcc"))
    for _, row in rows(tmp_path / "a").iterrows():
        fault = gf.BusFault(int(row["name"].split()[1]))
        found = gf.critical_clearing_time(model, fault, longest=0.5, t_end=4.0)
        assert row["critical_clearing_time"] == found.seconds
        assert row["margin"] == pytest.approx(found.seconds - 0.05)
        assert row["stable"] == (row["margin"] >= 0)


def test_thresholds_are_calibrated_from_the_faults_of_the_study(tmp_path):
    content = REDUCED | {
        "contingencies": {"bus_faults": "3", "clearing_time": 0.2},
        "model": {"kind": "paper", "order": 60, "calibrate": True, "largest_error_deg": 1.0},
        "run": {"t_end": 3.0},
    }
    run_study(parse_study(content), tmp_path / "a")
    assert (rows(tmp_path / "a")["error_rms_deg"] < 1.0).all()
    with StudyStore.read(tmp_path / "a") as store:
        assert store.identity["settings"]["column_norm"] > 0
    content["contingencies"] = {"machine_trips": "21"}
    with pytest.raises(gf.OptionError, match="calibrate needs faults"):
        run_study(parse_study(content), tmp_path / "b")
    assert not (tmp_path / "b" / FILE).exists()


def test_a_study_area_that_is_not_there_is_named_before_anything_is_written(tmp_path):
    content = SHORT | {"model": {"kind": "linear"}, "study_area": {"buses": "1-36,999"}}
    with pytest.raises(gf.OptionError, match="999"):
        run_study(parse_study(content), tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_a_study_with_a_tolerance_estimates_every_row_and_keeps_it(tmp_path, falling_costs):
    model = {"kind": "adaptive", "tolerance_deg": 0.3}
    run_study(parse_study(LADDER | {"model": model}), tmp_path / "results", count=1)
    with StudyStore.read(tmp_path / "results") as store:
        frame, settings = store.frame(), store.identity["settings"]
    assert settings["tolerance_deg"] == 0.3
    assert frame["error_estimate_deg"].le(0.3).all()
    assert frame["error_coi_deg"].le(0.3).all()
    assert "0 beyond the tolerance" in study_facts_of(tmp_path / "results")["Tolerance"]


def test_a_tolerance_and_thresholds_exclude_each_other():
    model = {"kind": "adaptive", "tolerance_deg": 0.3, "angle_deg": 20}
    with pytest.raises(gf.CaseFileError, match="tolerance or angle_deg, not both"):
        parse_study(LADDER | {"model": model})


def test_relays_watch_every_run_of_a_study(tmp_path):
    """A row is that of a run with the relays among its events."""
    relay = {
        "kind": "under-frequency-shedding", "areas": "1", "measured_at": 3,
        "stages": [{"pickup": 59.97, "delay": 0.2, "share": 0.1}],
    }  # fmt: skip
    step = {"kind": "load-step", "bus": 3, "time": 0.5, "active_mw": 900.0}
    study = SHORT | {
        "contingencies": {},
        "contingency": [{"name": "load", "events": [step]}],
        "relays": [relay],
        "run": {"t_end": 4.0},
    }
    run_study(parse_study(study), tmp_path / "watched", count=1)
    (nadir,) = rows(tmp_path / "watched")["nadir_hz"]
    model = gf.build_model(gf.load_case("npcc"))
    watched = [gf.LoadStep(3, 0.5, 900.0), *relays_of([relay])]
    expected, without = (
        trajectory_figures(gf.simulate(model, events, 4.0))["nadir_hz"]
        for events in (watched, watched[:1])
    )
    assert nadir == expected
    assert nadir > without


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"relays": [{"kind": "distance", "branch": "3-2"}]}, "relay 1: distance needs bus"),
        ({"relays": [{"kind": "distance", "branch": "3-2", "bus": 9}]}, "its ends are buses 3 and 2"),
        (
            {"contingency": [{"name": "x", "events": [{"kind": "set", "bus": 21, "parameter": "y",
                                                       "value": 1.0}]}]},
            "contingency 'x': y of unit 21:1: no device of the unit has it",
        ),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_told_before_the_first_contingency(tmp_path, change, message):
    with pytest.raises(gf.EventError, match=message):
        run_study(parse_study(SHORT | change), tmp_path / "none", count=1)
    assert not (tmp_path / "none").exists()
