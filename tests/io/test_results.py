import json
import os
import stat

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import gridfold as gf
from gridfold.io.results import (
    METADATA_KEY,
    replacing,
    write_csv,
    write_json,
    write_npz,
    write_parquet,
)

FRAME = pd.DataFrame({"time": [0.0, 0.1, 0.2], "angle": [1.0, 1 / 3, -2.5e-7]})
METADATA = {"case": "small", "events": [{"kind": "bus-fault", "bus": 3}]}
WRITERS = {
    "csv": lambda path, metadata=METADATA: write_csv(path, FRAME, metadata),
    "parquet": lambda path, metadata=METADATA: write_parquet(path, FRAME, metadata),
    "npz": lambda path, metadata=METADATA: write_npz(path, {"time": FRAME.time}, metadata),
    "json": lambda path, metadata=METADATA: write_json(path, metadata),
}
writers = pytest.mark.parametrize("kind", WRITERS)


def content(folder):
    return {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_csv_holds_ten_digits_and_metadata_beside_it(tmp_path):
    write_csv(tmp_path / "run.csv", FRAME, METADATA)
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "run.csv"), FRAME, rtol=1e-9)
    assert json.loads((tmp_path / "run.csv.meta.json").read_text()) == METADATA
    assert set(content(tmp_path)) == {"run.csv", "run.csv.meta.json"}


def test_parquet_holds_all_digits_and_metadata_in_its_schema(tmp_path):
    write_parquet(tmp_path / "run.parquet", FRAME, METADATA)
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "run.parquet"), FRAME, check_exact=True
    )
    schema = pq.read_schema(tmp_path / "run.parquet")
    assert json.loads(schema.metadata[METADATA_KEY.encode()]) == METADATA
    assert set(content(tmp_path)) == {"run.parquet"}


def test_npz_holds_arrays_and_metadata(tmp_path):
    write_npz(tmp_path / "run.npz", {"states": np.eye(3)}, METADATA)
    with np.load(tmp_path / "run.npz") as archive:
        np.testing.assert_array_equal(archive["states"], np.eye(3))
        assert json.loads(str(archive["metadata"])) == METADATA
    assert set(content(tmp_path)) == {"run.npz"}


def test_json_is_indented_and_ends_with_a_newline(tmp_path):
    write_json(tmp_path / "run.json", {"a": [1]})
    assert (tmp_path / "run.json").read_text() == '{\n  "a": [\n    1\n  ]\n}\n'


@writers
def test_missing_folders_are_made(kind, tmp_path):
    WRITERS[kind](tmp_path / "new" / "deep" / f"run.{kind}")
    assert (tmp_path / "new" / "deep" / f"run.{kind}").is_file()


@writers
def test_an_existing_file_is_replaced(kind, tmp_path):
    path = tmp_path / f"run.{kind}"
    path.write_text("old")
    WRITERS[kind](path)
    assert path.read_bytes() != b"old"
    assert not [name for name in content(tmp_path) if name.startswith(".")]


@writers
def test_files_can_be_read_by_those_whom_the_mask_allows(kind, tmp_path):
    before = os.umask(0o027)
    try:
        WRITERS[kind](tmp_path / f"run.{kind}")
    finally:
        os.umask(before)
    for path in tmp_path.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o640


@writers
def test_a_target_below_a_file_is_an_output_error_that_names_it(kind, tmp_path):
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / f"run.{kind}"
    with pytest.raises(gf.OutputError, match="cannot be written") as error:
        WRITERS[kind](path)
    assert str(path) in str(error.value)
    assert content(tmp_path) == {"file": b"in the way"}


@writers
def test_a_target_that_is_a_folder_is_an_output_error(kind, tmp_path):
    path = tmp_path / f"run.{kind}"
    path.mkdir()
    with pytest.raises(gf.OutputError, match="cannot be written"):
        WRITERS[kind](path)
    assert path.is_dir()
    assert content(tmp_path) == {}


@writers
def test_metadata_that_cannot_be_written_leaves_the_folder_as_it_was(kind, tmp_path):
    (tmp_path / f"run.{kind}").write_text("old")
    before = content(tmp_path)
    with pytest.raises(TypeError):
        WRITERS[kind](tmp_path / f"run.{kind}", {"bad": object()})
    assert content(tmp_path) == before


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt()])
def test_a_writer_that_fails_half_way_leaves_the_folder_as_it_was(error, tmp_path):
    path = tmp_path / "run.txt"
    path.write_text("old")

    def write():
        with replacing(path) as temporary:
            temporary.write_text("half a fi")
            raise error

    with pytest.raises(type(error)):
        write()
    assert content(tmp_path) == {"run.txt": b"old"}


def test_a_full_disk_is_an_output_error_and_leaves_the_folder_as_it_was(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text("old")

    def write():
        with replacing(path) as temporary:
            temporary.write_text("half a fi")
            raise OSError(28, "No space left on device")

    with pytest.raises(
        gf.OutputError, match=r"run.txt: cannot be written: No space left on device"
    ):
        write()
    assert content(tmp_path) == {"run.txt": b"old"}


def test_the_old_file_stands_until_the_new_one_is_whole(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text("old")
    with replacing(path) as temporary:
        assert temporary.parent == tmp_path
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
