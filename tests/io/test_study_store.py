"""The store of a study: what was added is there, whatever happens around it."""

import sqlite3
import stat
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gridfold import OptionError, OutputError
from gridfold.io.study_store import FILE, Result, StudyStore

COLUMNS = {"status": str, "stable": bool, "angle": float, "steps": int}
IDENTITY = {"case": "npcc", "study": {"name": "a"}}


def records(count):
    return [
        {"number": k, "name": f"bus {k}", "kind": "bus fault", "events": [{"kind": "x", "bus": k}]}
        for k in range(1, count + 1)
    ]


def figures(**values):
    return {"status": "completed", "stable": True, "angle": 1.5, "steps": 10} | values


@pytest.fixture
def store(tmp_path):
    with StudyStore.create(tmp_path / "a", IDENTITY, records(4), COLUMNS) as store:
        yield store


def test_what_was_added_is_read_back(store):
    curves = {"angles": np.arange(6.0).reshape(2, 3), "units": np.array(["1:1", "2:1"])}
    store.add([Result(2, figures(angle=0.1 + 0.2), curves), Result(1, figures(angle=None))])
    with StudyStore.read(store.folder) as other:
        frame = other.frame()
        assert frame["number"].tolist() == [1, 2]
        assert frame["name"].tolist() == ["bus 1", "bus 2"]
        assert frame["angle"].isna().tolist() == [True, False]
        assert frame["angle"][1] == 0.1 + 0.2
        assert other.done() == {1, 2}
        assert other.contingencies() == records(4)
        assert other.identity["study"] == {"name": "a"}
        there = other.curves(2)
        np.testing.assert_array_equal(there["angles"], curves["angles"])
        assert there["units"].tolist() == ["1:1", "2:1"]
        assert other.curves(1) is None


@settings(max_examples=30, deadline=None)
@given(st.floats(), st.booleans() | st.none(), st.integers(-(2**62), 2**62), st.text())
def test_every_figure_survives_and_what_is_not_finite_is_left_empty(
    tmp_path_factory, angle, stable, steps, text
):
    folder = tmp_path_factory.mktemp("study") / "a"
    text = text.encode("utf-8", "ignore").decode()
    with StudyStore.create(folder, IDENTITY, records(1), COLUMNS) as store:
        store.add([Result(1, figures(angle=angle, stable=stable, steps=steps, status=text))])
        row = store.frame().iloc[0]
    assert row["steps"] == steps
    assert row["status"] == text
    assert (row["angle"] == angle) if np.isfinite(angle) else row.isna()["angle"]
    assert row.isna()["stable"] if stable is None else row["stable"] == stable


def test_a_contingency_is_never_written_twice(store):
    store.add([Result(1, figures())])
    with pytest.raises(OutputError, match="UNIQUE"):
        store.add([Result(2, figures()), Result(1, figures(angle=9.0))])
    assert store.done() == {1}, "both of one call, or none"
    assert store.frame()["angle"].tolist() == [1.5]


def test_rows_are_sorted_and_chosen(store):
    store.add([Result(k, figures(angle=a)) for k, a in ((1, 2.0), (2, None), (3, 5.0))])
    assert store.frame(sort="angle")["number"].tolist() == [1, 3, 2]
    assert store.frame(sort="angle", descending=True)["number"].tolist() == [3, 1, 2]
    assert store.frame("angle > 3 AND stable = 1")["number"].tolist() == [3]
    assert store.frame("name = 'bus 2'")["number"].tolist() == [2]
    assert len(store.frame("angle > 99")) == 0


@pytest.mark.parametrize("where", ["nonsense", "angle >", "1); DROP TABLE result; --", "angle > ?"])
def test_a_condition_that_makes_no_sense_is_refused_and_does_no_harm(store, where):
    store.add([Result(1, figures())])
    with StudyStore.read(store.folder) as other, pytest.raises(OptionError, match="condition"):
        other.frame(where)
    assert store.done() == {1}


def test_an_unknown_column_is_refused_with_the_known_ones(store):
    with pytest.raises(OptionError, match=r"no column 'angel'; there are: number, name, kind"):
        store.frame(sort="angel")


def test_a_second_writer_is_kept_out_until_the_first_has_gone(store):
    for open_it in (
        lambda: StudyStore.resume(store.folder),
        lambda: StudyStore.create(store.folder, IDENTITY, records(1), COLUMNS),
    ):
        with pytest.raises(OptionError, match="another process is working"):
            open_it()
    store.close()
    with StudyStore.resume(store.folder) as again:
        again.add([Result(1, figures())])


def test_the_lock_goes_with_a_process_that_is_killed(tmp_path):
    code = (
        "import sys, time; from gridfold.io.study_store import StudyStore;"
        f"s = StudyStore.create(sys.argv[1], {IDENTITY!r}, [], {{'angle': float}});"
        "print('there', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "a")], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"there\n"
        with pytest.raises(OptionError, match="another process"):
            StudyStore.resume(tmp_path / "a")
        process.kill()
        process.wait()
        with StudyStore.resume(tmp_path / "a") as store:
            assert store.done() == set()


def test_a_study_is_not_written_over(store):
    store.close()
    with pytest.raises(OptionError, match="holds a study already"):
        StudyStore.create(store.folder, IDENTITY, records(1), COLUMNS)
    with StudyStore.read(store.folder) as there:
        assert len(there.contingencies()) == 4


def test_a_folder_without_a_study_is_named(tmp_path):
    for open_it in (StudyStore.read, StudyStore.resume):
        with pytest.raises(OptionError, match="holds no study"):
            open_it(tmp_path / "nothing")
    assert not (tmp_path / "nothing").exists()


def test_a_store_of_another_format_is_refused(store):
    store.tell("format", 99)
    store.close()
    with pytest.raises(OptionError, match="format 99"):
        StudyStore.read(store.folder)


def test_a_file_that_is_no_database_is_named(tmp_path):
    (tmp_path / FILE).write_text("this is no database, but long enough to be looked at" * 9)
    with pytest.raises(OutputError, match=FILE):
        StudyStore.read(tmp_path)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        StudyStore.create(tmp_path / "file" / "a", IDENTITY, [], COLUMNS)


def test_a_full_disk_leaves_what_was_written(store):
    """SQLite's own limit of pages stands in for the end of the disk."""
    store.add([Result(1, figures())])
    pages = store._connection.execute("PRAGMA page_count").fetchone()[0]
    store._connection.execute(f"PRAGMA max_page_count = {pages + 1}")
    noise = np.random.default_rng(1).random(100_000)
    with pytest.raises(OutputError, match="full"):
        store.add([Result(2, figures(), {"noise": noise})])
    store._connection.execute("PRAGMA max_page_count = 100000")
    assert store.done() == {1}
    store.add([Result(2, figures(), {"noise": noise})])
    assert store.done() == {1, 2}


def test_a_folder_that_may_only_be_read_is_shown(store):
    store.add([Result(1, figures())])
    store.close()
    file, folder = store.folder / FILE, store.folder
    file.chmod(stat.S_IRUSR)
    folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    try:
        with StudyStore.read(folder) as there:
            assert there.done() == {1}
            with pytest.raises((OutputError, sqlite3.OperationalError), match=r"read.?only"):
                there.add([Result(2, figures())])
    finally:
        folder.chmod(stat.S_IRWXU)
        file.chmod(stat.S_IRUSR | stat.S_IWUSR)
