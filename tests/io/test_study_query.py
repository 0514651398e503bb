"""Conditions on results: one row at a time, read only, never for long."""

import sqlite3
import time

import pytest
from study_stores import small_study

from gridfold import OptionError
from gridfold.io import study_query
from gridfold.io.study_store import StudyStore


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "a"
    small_study(folder).close()
    with StudyStore.read(folder) as store:
        yield store


@pytest.mark.parametrize(
    ("where", "numbers"),
    [
        ("stable = 1 AND lowest_voltage < 0.95", [1, 5]),
        ("status = 'failed'", [3]),
        ("stable IS NULL OR largest_separation_deg > 205", [3, 4]),
        ("name LIKE '%bus 4%' AND (1 + (2) = 3)", [4]),
        ('"stable" = 0', [2, 4]),
        ("[stable] = 0 AND `number` > 2", [4]),
        ("name = 'it''s -- no comment; (' OR number = 1", [1]),
        ("abs(number - 3) < 2 AND upper(kind) = 'BUS FAULT'", [2, 3, 4]),
    ],
)
def test_a_condition_chooses_rows(store, where, numbers):
    assert store.frame(where)["number"].tolist() == numbers


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("stble = 1", "no such column: stble; there are: number, name, kind, status"),
        ('"stble" = 1', "no such column: stble; there are: number, name"),
        ("[stble] = 1", "no such column: stble"),
        ("`stble` = 1", "no such column: stble"),
        ("stable = ", "cannot be used"),
        ("1) UNION SELECT 1 --", "a bracket is closed that was not opened"),
        ("1; DROP TABLE result", "';' has no place"),
        ("1 -- comment", "'--' has no place"),
        ("1 /* comment", r"'/\*' has no place"),
        ("name = 'open", "has no end"),
        ("number IN (SELECT number FROM study)", "'SELECT' has no place"),
        (
            "1 IN (WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT n+1 FROM t) SELECT n FROM t)",
            "'WITH' has no place",
        ),
        ("length(randomblob(1000000000)) > 1", "too big"),
        ("length(zeroblob(2000000000)) > 1", "too big"),
        ("load_extension('x')", "cannot be used"),
        ("1 = 1\x00", "cannot be used"),
        ("(" * 5000 + "1" + ")" * 5000, "cannot be used"),
    ],
)
def test_what_is_more_than_a_condition_is_refused(store, where, said):
    with pytest.raises(OptionError, match=said):
        store.frame(where)
    assert len(store.frame()) == 5


def test_a_condition_that_takes_long_is_broken_off(monkeypatch):
    monkeypatch.setattr(study_query, "SECONDS", 0.2)
    connection = sqlite3.connect(":memory:")
    connection.execute("CREATE TABLE result (number INTEGER)")
    connection.executemany("INSERT INTO result VALUES (?)", ((k,) for k in range(2_000)))
    query = (
        "SELECT a.number + b.number + c.number AS number FROM result AS a, result AS b, result AS c"
    )
    began = time.monotonic()
    with pytest.raises(OptionError, match=r"takes longer than 0\.2 s"):
        study_query.chosen_rows(connection, query, "number < 0", "", ["number"])
    assert time.monotonic() - began < 5.0
    assert connection.execute("SELECT count(*) FROM result").fetchone() == (2_000,)
