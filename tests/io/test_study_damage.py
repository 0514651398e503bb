"""Damaged stores: what is whole is given, what is not is told, and nothing ends in a traceback."""

from __future__ import annotations

import random
import sqlite3
from pathlib import Path

import pandas as pd
import pytest
from study_stores import SETTINGS, failed, finish, new_store, small_study, stable, unstable

from gridfold import GridfoldError, OptionError, OutputError
from gridfold.io.study_repair import check_store, repair_store
from gridfold.io.study_schema import FILE
from gridfold.io.study_store import StudyStore
from gridfold.report.study_record import study_record
from gridfold.report.study_report import page


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of a whole store with some pages, and its rows."""
    folder = tmp_path_factory.mktemp("study") / "a"
    with new_store(folder, 60) as store:
        results = [stable(k, float(k)) if k % 3 else unstable(k, 200.0 + k) for k in range(1, 60)]
        store.add([*results, failed(60)])
        finish(store)
        frame = store.frame()
    return (folder / FILE).read_bytes(), frame.set_index("number")


def put(folder: Path, content: bytes) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / FILE).write_bytes(content)
    return folder


def edit(folder: Path, *statements: str) -> None:
    with sqlite3.connect(folder / FILE) as connection:
        for statement in statements:
            connection.execute(statement)
    connection.close()


def read(folder: Path) -> tuple[pd.DataFrame, list[str]]:
    with StudyStore.read(folder) as store:
        frame = store.frame(where="number > 0", sort="largest_separation_deg")
        store.contingencies(), store.done(), store.columns
        for number in store.done():
            store.curves(number)
        return frame.set_index("number").sort_index(), [str(item) for item in store.damage]


def mutations(content: bytes, chance: random.Random) -> bytes:
    """Some bytes changed, a piece zeroed, copied, cut out, or the end cut off."""
    data, size = bytearray(content), len(content)
    at, length = chance.randrange(size), chance.choice((1, 16, 512, 4096, 20000))
    kind = chance.randrange(6)
    if kind == 0:
        for _ in range(chance.choice((1, 4, 64))):
            data[chance.randrange(size)] = chance.randrange(256)
    elif kind == 1:
        data[at : at + length] = bytes(min(length, size - at))
    elif kind == 2:
        data[at : at + length] = chance.randbytes(min(length, size - at))
    elif kind == 3:
        other = chance.randrange(size)
        piece = data[other : other + length]
        data[at : at + len(piece)] = piece
    elif kind == 4:
        del data[at : at + length]
    else:
        del data[at:]
    return bytes(data)


def test_no_mutation_gives_a_traceback_or_a_row_that_was_not_written(whole, tmp_path):
    content, frame = whole
    chance, read_at_all = random.Random(2026), 0
    for k in range(50):
        folder = put(tmp_path / str(k), mutations(content, chance))
        try:
            found, _ = read(folder)
        except GridfoldError:
            continue
        read_at_all += 1
        there = frame[frame.index.isin(found.index)]
        pd.testing.assert_frame_equal(found, there, check_dtype=False, check_index_type=False)
        check_store(folder)
    assert read_at_all > 15


@pytest.mark.parametrize(
    ("statement", "said"),
    [
        ("UPDATE result SET largest_separation_deg = 7.5 WHERE number = 7", "not what was written"),
        ("UPDATE contingency SET name = 'bus 8' WHERE number = 7", "not what was written"),
        ("UPDATE contingency SET events = '[' WHERE number = 7", "Expecting value"),
        ("DELETE FROM contingency WHERE number = 7", "not in the list"),
        ("UPDATE result SET status = x'ff' WHERE number = 7", "status is b'"),
        ("UPDATE result SET stable = NULL WHERE number = 7", "does not go with stable None"),
        ("UPDATE result SET steps = 'many' WHERE number = 7", "steps is 'many'"),
        ("UPDATE result SET seal = NULL WHERE number = 7", "not what was written"),
    ],
)
def test_a_row_that_is_not_whole_is_told_and_done_anew_after_a_repair(
    whole, tmp_path, statement, said
):
    content, frame = whole
    folder = put(tmp_path / "a", content)
    edit(folder, statement)
    found, damage = read(folder)
    assert found.index.tolist() == [k for k in frame.index if k != 7]
    assert any(said in item and "contingency 7" in item for item in damage)
    with pytest.raises(OptionError, match=r"damaged .*gridfold check .* --repair"):
        StudyStore.resume(folder)
    assert any(said in str(item) for item in check_store(folder).damage)
    done = repair_store(folder)
    assert (done.kept, done.damaged_file.name) == (59, f"{FILE}.damaged")
    assert check_store(folder).damage == ()
    with StudyStore.resume(folder) as store:
        assert store.done() == set(frame.index) - {7}
        assert store.curves(8) is not None
        with new_store(tmp_path / "list", 60) as other:
            listed = other.contingencies()
        store.complete_list(listed)
        assert [item["number"] for item in store.contingencies()] == list(frame.index)
        store.add([stable(7, 7.0)])
    found, damage = read(folder)
    pd.testing.assert_frame_equal(found, frame, check_index_type=False)
    assert damage == []


def test_curves_that_are_not_whole_are_told_and_their_row_is_done_anew(whole, tmp_path):
    content, _ = whole
    folder = put(tmp_path / "a", content)
    edit(folder, "UPDATE curves SET content = substr(content, 1, 300) WHERE number = 5")
    with StudyStore.read(folder) as store:
        assert store.curves(5) is None
        assert store.curves(6) is not None
        assert [item.number for item in store.damage] == [5]
        assert "bus 5" in page(study_record(store))
    repair_store(folder)
    with StudyStore.read(folder) as store:
        assert 5 not in store.done()
        assert not store.damage


def test_results_of_an_unknown_study_are_shown_but_not_gone_on_with(whole, tmp_path):
    content, frame = whole
    folder = put(tmp_path / "a", content)
    edit(folder, "UPDATE about SET value = '{}' WHERE name = 'settings'")
    found, damage = read(folder)
    assert len(found) == len(frame)
    assert damage == ["description of the study, 'settings': it is not what was written"]
    with pytest.raises(OptionError, match="what the study is about cannot be read"):
        repair_store(folder)
    with StudyStore.read(folder) as store, pytest.raises(OutputError, match="settings"):
        study_record(store)


@pytest.mark.parametrize(
    "content", [b"", b"SQLite format 3\x00", b"name,kind\n", bytes(8192)], ids=range(4)
)
def test_a_file_that_is_no_store_is_named(tmp_path, content):
    folder = put(tmp_path / "a", content)
    for use in (StudyStore.read, StudyStore.resume, check_store, repair_store):
        with pytest.raises(GridfoldError, match=FILE):
            use(folder)


def test_a_store_without_seals_is_read_and_gone_on_with(tmp_path):
    small_study(tmp_path / "a").close()
    tables = ("about", "contingency", "result")
    edit(tmp_path / "a", *(f"ALTER TABLE {table} DROP COLUMN seal" for table in tables))
    found = check_store(tmp_path / "a")
    assert (found.results, found.unsealed, found.damage) == (5, 5, ())
    with StudyStore.resume(tmp_path / "a") as store:
        store.add([stable(3, 30.0)], again={3})
        store.tell("last_run", SETTINGS)
    found = check_store(tmp_path / "a")
    assert (found.results, found.unsealed, found.damage) == (5, 0, ())


def test_nothing_is_repaired_where_nothing_is_damaged(tmp_path):
    small_study(tmp_path / "a").close()
    with pytest.raises(OptionError, match="nothing is damaged"):
        repair_store(tmp_path / "a")
