"""Files that are none, or have no end."""

import os
from pathlib import Path

import pytest

import gridfold as gf
from gridfold.ceilings import MEMORY_VARIABLE
from gridfold.io.input_files import read_content
from gridfold.io.rapid_mat import read_rapid
from gridfold.io.results import check_target, write_json
from gridfold.study.study_file import load_study

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")

READERS = {
    "grid.raw": gf.load_case,
    "grid.m": gf.load_case,
    "grid.mat": read_rapid,
    "grid.dyr": lambda path: gf.load_psse(Path(__file__).parent / "raw" / "loads.raw", path),
    "events.toml": gf.load_events,
    "study.toml": load_study,
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("kind", ["a pipe", "a device", "a folder"])
def test_no_reader_waits_for_a_pipe_or_the_end_of_a_device(tmp_path, name, kind):
    path = tmp_path / name
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    with pytest.raises(gf.GridfoldError, match=f"{name}.*(\n.*)?cannot be read: it is {kind}"):
        READERS[name](path)


@pytest.mark.parametrize("name", ["", "\0", "no/such/file", "x" * 300])
def test_a_path_that_leads_nowhere_is_named(name):
    with pytest.raises(gf.CaseFileError, match="cannot be read"):
        read_content(Path(name))


def test_a_file_that_the_memory_cannot_hold_is_not_opened(tmp_path, monkeypatch):
    monkeypatch.setenv(MEMORY_VARIABLE, "0.1")
    path = tmp_path / "grid.raw"
    with path.open("wb") as stream:
        stream.truncate(2**34)  # takes no place on the disk
    with pytest.raises(gf.OptionError, match=r"grid\.raw: a file of 16 GiB would take 480 GiB"):
        gf.load_case(path)
    with pytest.raises(gf.CaseFileError, match="16 GiB, more than 1 GiB"):
        read_content(path, 2**30)


@pytest.mark.parametrize("kind", ["a folder", "a pipe or a device", "no name", "not a folder"])
def test_a_result_is_not_written_where_no_file_can_be(tmp_path, kind):
    path = tmp_path / "a.json"
    if kind == "a folder":
        path.mkdir()
    elif kind == "a pipe or a device":
        os.mkfifo(path)
    elif kind == "no name":
        path = tmp_path / "gone" / ".."
    else:
        path.write_text("here")
        path = path / "b.json"
    with pytest.raises(gf.OutputError, match=f"cannot be written: .*{kind}"):
        check_target(path)
    with pytest.raises(gf.OutputError):
        write_json(path, {})


def test_a_device_is_not_replaced_by_a_file():
    with pytest.raises(gf.OutputError):
        write_json(Path(os.devnull), {})
    assert not Path(os.devnull).is_file()
