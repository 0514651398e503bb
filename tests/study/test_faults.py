"""What goes wrong around a study: time, disk, workers, changes between a run and its resume."""

import multiprocessing
import os
import resource
import signal
from pathlib import Path

import pandas as pd
import pytest
from study_stores import finish, new_store, small_study, stable

import gridfold as gf
from gridfold.io.results import write_csv
from gridfold.io.study_repair import check_store
from gridfold.io.study_store import FILE, StudyStore
from gridfold.report.study_report import write_report
from gridfold.study import Stage, run_study
from gridfold.study.study_file import parse_study
from gridfold.study.summary import WALL

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_exciter_study"
SMALL = {
    "case": {"source": "two-plants", "devices": ["my_exciter.py"]},
    "contingencies": {"bus_faults": "1", "clearing_time": 0.05},
    "model": {"kind": "detailed"},
    "run": {"t_end": 0.5},
}
NPCC = {
    "contingencies": {"bus_faults": "1-6", "clearing_time": 0.05},
    "model": {"kind": "detailed"},
    "run": {"t_end": 1.0},
}


def rows(folder):
    """The results without times of the machine."""
    with StudyStore.read(folder) as store:
        frame = store.frame()
    return frame[[name for name in frame if not name.startswith(WALL)]]


def run_small(folder, *, run=(), **options):
    study = parse_study(SMALL | {"run": SMALL["run"] | dict(run)})
    return run_study(study, folder, folder=EXAMPLE, count=1, trust_devices=True, **options)


def test_a_contingency_beyond_its_time_fails_and_is_tried_again(tmp_path):
    slow = {"step": 2e-6, "t_end": 4.0}
    first = run_small(tmp_path / "a", run=slow, time_limit=0.3)
    assert (first.stage, first.failed) == (Stage.DONE, 1)
    row = rows(tmp_path / "a").iloc[0]
    assert row["reason"] == "not done within the time limit of 0.3 s"
    with StudyStore.read(tmp_path / "a") as store:
        assert 0.2 < store.frame()["wall_s"].iloc[0] < 5.0
    again = run_small(tmp_path / "a", run=slow, resume=True)
    assert again.failed == 1, "resume alone does not try it again"
    run_small(tmp_path / "a", run=slow | {"time_limit": 0.2}, retry_failed=True)
    assert "0.2 s" in rows(tmp_path / "a")["reason"].iloc[0], "the key may change"
    with pytest.raises(gf.OptionError, match="positive number of seconds"):
        run_small(tmp_path / "b", time_limit=-1.0)
    assert not (tmp_path / "b").exists()


def test_what_failed_gets_the_row_of_an_undisturbed_run(tmp_path, monkeypatch):
    study = parse_study(NPCC | {"run": NPCC["run"] | {"batch": "off"}})
    run_study(study, tmp_path / "calm", count=2)
    original = gf.simulate

    def simulate(model, events, *rest):
        if events[0].bus in (2, 5):
            raise MemoryError("Unable to allocate 32 GiB")
        return original(model, events, *rest)

    monkeypatch.setattr("gridfold.study.solve.simulate", simulate)
    assert run_study(study, tmp_path / "a", count=2).failed == 2
    monkeypatch.undo()
    done = run_study(study, tmp_path / "a", count=2, retry_failed=True)
    assert (done.stage, done.done, done.failed) == (Stage.DONE, 6, 0)
    pd.testing.assert_frame_equal(rows(tmp_path / "a"), rows(tmp_path / "calm"))
    assert check_store(tmp_path / "a").damage == ()


def test_a_worker_process_that_is_killed_costs_no_row(tmp_path):
    """As the kernel kills one for its memory, once the first result is there."""
    run_study(parse_study(NPCC), tmp_path / "calm", count=1)
    killed = []

    def kill(progress):
        if progress.latest and not killed:
            killed.append(multiprocessing.active_children()[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    run = run_study(
        parse_study(NPCC), tmp_path / "a", workers="processes", count=1, on_progress=kill
    )
    assert killed
    assert (run.stage, run.failed) == (Stage.DONE, 0)
    pd.testing.assert_frame_equal(rows(tmp_path / "a"), rows(tmp_path / "calm"))


@pytest.fixture
def largest_file():
    """Sets the size beyond which no file can be written."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_at_any_write_loses_no_row_that_was_there(tmp_path, largest_file):
    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    outcomes, told = [], []
    for kilobytes in range(0, 160, 8):
        folder, done = tmp_path / str(kilobytes), 0
        try:
            largest_file(kilobytes * 1024)
            with new_store(folder, 20) as store:
                for number in range(1, 21):
                    store.add([stable(number, float(number))])
                    done = number
                finish(store)
        except gf.OutputError as error:
            told.append(str(folder) in str(error))
        finally:
            largest_file(soft)
        outcomes.append(done)
        if not (folder / FILE).exists():
            assert done == 0
            continue
        with StudyStore.resume(folder) as store:
            assert store.done() >= set(range(1, done + 1))
            missing = set(range(1, 21)) - store.done()
            store.add([stable(number, float(number)) for number in missing])
        assert check_store(folder).damage == ()
        assert rows(folder)["largest_separation_deg"].tolist() == list(range(1, 21))
    assert all(told)
    assert outcomes[0] == 0
    assert outcomes[-1] == 20
    assert len(set(outcomes)) > 4, "it was full at several writes"


def test_files_that_do_not_fit_leave_those_that_were_there(tmp_path, largest_file):
    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    with small_study(tmp_path / "a") as store:
        frame = store.frame()
        for write, name in (
            (lambda path: write_report(store, path), "report.html"),
            (lambda path: write_csv(path, frame, {"a": 1}), "rows.csv"),
        ):
            path = tmp_path / name
            path.write_text("before")
            try:
                largest_file(512)
                with pytest.raises(gf.OutputError, match=name):
                    write(path)
            finally:
                largest_file(soft)
            assert path.read_text() == "before"
            assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("name,kind,bus\nx,bus-fault,2\n", "made from other files"),
        ("name,kind,bus\ny,bus-fault,1\n", "made from other files"),
        ("name,kind,bus\nx,bus-fault,1\ny,bus-fault,2\n", "made from other files"),
    ],
)
def test_a_table_of_contingencies_that_has_changed_is_refused(tmp_path, table, said):
    (tmp_path / "list.csv").write_text("name,kind,bus\nx,bus-fault,1\n")
    content = {
        "contingencies": {"csv": str(tmp_path / "list.csv")},
        "model": {"kind": "detailed"},
        "run": {"t_end": 0.2},
    }
    run_study(parse_study(content), tmp_path / "a", count=1)
    before = rows(tmp_path / "a")
    (tmp_path / "list.csv").write_text(table)
    for how in ({"resume": True}, {"retry_failed": True}):
        with pytest.raises(gf.OptionError, match=said):
            run_study(parse_study(content), tmp_path / "a", count=1, **how)
    pd.testing.assert_frame_equal(rows(tmp_path / "a"), before)
