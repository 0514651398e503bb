"""Rows of clearing times in a folder: whole lines count, whatever a kill has left."""

from __future__ import annotations

from pathlib import Path

import pytest

import gridfold as gf
from gridfold.io.clearing_store import IDENTITY, ROWS, ClearingStore

ABOUT = {"case": "c", "fingerprint": "f", "settings": {}, "faults": [], "map": {}}


def row(number: int, seconds: float = 0.1) -> dict[str, object]:
    return {"number": number, "cct_s": seconds, "bounded": True, "runs": 5}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with ClearingStore.create(tmp_path / "map", ABOUT) as store:
        for number in (3, 1):
            store.add(row(number))
    return tmp_path / "map"


def test_rows_are_read_by_number_and_of_several_the_last(folder):
    with ClearingStore.resume(folder) as store:
        store.add(row(3, 0.2))
    assert ClearingStore.read(folder).rows() == [row(1), row(3, 0.2)]


@pytest.mark.parametrize("torn", ['{"number": 2, "cct_s": 0.', '{"number": 2}', "\x00\x00", "7"])
def test_half_a_line_is_no_row_and_is_gone_when_work_goes_on(folder, torn):
    with (folder / ROWS).open("a") as stream:
        stream.write(torn)
    assert ClearingStore.read(folder).rows() == [row(1), row(3)]
    with ClearingStore.resume(folder) as store:
        store.add(row(2))
    assert ClearingStore.read(folder).rows() == [row(1), row(2), row(3)]


def test_one_process_writes_at_a_time(folder):
    with ClearingStore.resume(folder), pytest.raises(gf.OptionError, match="another process"):
        ClearingStore.resume(folder)


def test_a_folder_that_holds_no_map_or_a_broken_one_is_told(folder, tmp_path):
    with pytest.raises(gf.OptionError, match=IDENTITY):
        ClearingStore.read(tmp_path)
    (folder / IDENTITY).write_text("{}")
    with pytest.raises(gf.CaseFileError, match="what the clearing times are about"):
        ClearingStore.read(folder)
    (folder / IDENTITY).write_text("{")
    with pytest.raises(gf.CaseFileError, match="not JSON"):
        ClearingStore.read(folder)
