"""Archives are believed as far as they agree with themselves, the file and what is asked for."""

from __future__ import annotations

import io
import os
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

import gridfold as gf
from gridfold.io.array_files import ArrayForm, Forms, arrays_digest, open_arrays

FORMS = Forms(
    {
        "a": ArrayForm("f", (2, "r")),
        "b": ArrayForm("f", ("r",)),
        "at": ArrayForm("i", ("r",), below="r"),
        "names": ArrayForm("U", (2,)),
        "more": ArrayForm("f", (1,), optional=True),
    },
    {"r": 5},
)
GOOD = {
    "a": np.arange(6.0).reshape(2, 3),
    "b": np.ones(3),
    "at": np.array([2, 1, 0]),
    "names": np.array(["x", "yy"]),
}


def read(path):
    with open_arrays(path) as archive:
        return archive.arrays(FORMS)


def written(path, **changes):
    arrays = {name: value for name, value in (GOOD | changes).items() if value is not None}
    np.savez_compressed(path, **arrays)
    return path


def faults(path):
    with pytest.raises(gf.CaseFileError) as raised:
        read(path)
    assert str(path) in str(raised.value)
    return raised.value.faults


def test_what_is_asked_for_comes_back(tmp_path):
    for changes in ({}, {"more": np.zeros(1)}, {"a": np.asfortranarray(GOOD["a"])}):
        found = read(written(tmp_path / "a.npz", **changes))
        assert found.keys() == (GOOD | changes).keys()
        for name, array in found.items():
            np.testing.assert_array_equal(array, (GOOD | changes)[name])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"b": None}, "array b is missing"),
        ({"other": np.zeros(1)}, "array 'other' is not known"),
        ({"b": np.ones(4)}, "b has shape (4,), expected (3,) as for a"),
        ({"a": np.ones((2, 6))}, "a has shape (2, 6), expected (2, 5)"),
        ({"a": np.ones(6)}, "a has shape (6,), expected (2, r)"),
        ({"names": np.array(["x", "y", "z"])}, "names has shape (3,), expected (2,)"),
        ({"b": np.float64(1)}, "b has shape (), expected (3,) as for a"),
        ({"b": np.ones(3, np.float32)}, "b has type float32, which it must not"),
        ({"b": np.ones(3, ">f8")}, "b has type >f8, which it must not"),
        ({"b": np.ones(3, int)}, "b has type int64, which it must not"),
        ({"names": np.array(["x" * 257, "y"])}, "names has type <U257, which it must not"),
        ({"b": np.array([1, np.nan, 1])}, "b is not finite"),
        ({"b": np.array([1, np.inf, 1])}, "b is not finite"),
        ({"at": np.array([0, 1, 3])}, "at holds position 3, which is not from 0 to 2"),
        ({"at": np.array([0, -1, 2])}, "at holds position -1, which is not from 0 to 2"),
        ({"at": np.array([0, 2**40, 2])}, f"at holds position {2**40}, which is not from 0 to 2"),
        ({"at": np.array([0, 1, 2], np.uint64)}, "at has type uint64, which it must not"),
    ],
)
def test_an_array_that_is_not_what_it_has_to_be_is_told(tmp_path, changes, message):
    assert message in faults(written(tmp_path / "a.npz", **changes))


def test_all_faults_are_told_at_once(tmp_path):
    path = written(tmp_path / "a.npz", b=np.ones(4), names=None, other=np.zeros(1), at=np.ones(3))
    assert len(faults(path)) == 4


@pytest.mark.parametrize("dtype", ["O", "c16", "?", "M8[s]", "V8", [("x", "f8")], "S3"])
def test_other_kinds_of_entries_are_not_read(tmp_path, dtype):
    path = tmp_path / "a.npz"
    np.savez(path, **(GOOD | {"b": np.zeros(3, dtype)}))
    assert faults(path) == ["this is not a NumPy archive, or it is damaged"]


def head_of(shape, dtype="<f8"):
    """The head of an array file, without content."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return stream.getvalue()


def zipped(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


def test_a_size_that_the_file_does_not_hold_takes_no_memory(tmp_path):
    path = zipped(tmp_path / "a.npz", a=head_of((2, 5_000_000_000)))
    tracemalloc.start()
    (fault,) = faults(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert fault.startswith("a has 80000000000 bytes by its head, which the ")
    assert peak < 5e6


def test_sizes_that_are_wrong_in_head_and_directory_take_no_memory(tmp_path):
    """The directory at the end of the archive repeats the lie of the head."""
    path = zipped(tmp_path / "a.npz", a=head_of((2, 200_000_000)))
    content = bytearray(path.read_bytes())
    entry = content.index(b"PK\x01\x02")
    true = struct.unpack_from("<I", content, entry + 24)[0]
    struct.pack_into("<I", content, entry + 24, true + 2 * 200_000_000 * 8)
    struct.pack_into("<I", content, entry + 20, 2**31)
    path.write_bytes(content)
    # Python 3.13 sees the lie in the directory itself.
    assert faults(path)[0].startswith(("a has 3200000000 bytes by its head", "this is not a NumPy"))


def test_an_array_that_is_small_when_compressed_and_too_large_is_not_read(tmp_path):
    path = written(tmp_path / "bomb.npz", a=np.zeros((2, 4_000_000)))
    assert path.stat().st_size < 200_000
    tracemalloc.start()
    assert "a has shape (2, 4000000), expected (2, 5)" in faults(path)
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_names_twice_or_without_suffix_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", head_of((0,)))
        archive.writestr("a.npy", head_of((0,)))
    assert "stands there twice" in faults(path)[0]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a", head_of((0,)))
    assert "no array" in faults(path)[0]


def test_what_is_no_archive_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fifo.npz")
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "link.npz").symlink_to(tmp_path / "nowhere")
    (tmp_path / "text.npz").write_text("a,b\n1,2\n")
    (tmp_path / "empty.npz").touch()
    for name, message in {
        "fifo": "not a plain file", "folder": "not a plain file", "link": "cannot be read",
        "text": "not a NumPy archive", "empty": "not a NumPy archive", "gone": "cannot be read",
        "x" * 300: "cannot be read", "a\0b": "not a NumPy archive",
    }.items():  # fmt: skip
        assert message in faults(tmp_path / f"{name}.npz")[0]


def test_every_truncated_archive_is_refused(tmp_path):
    path = written(tmp_path / "a.npz")
    content = path.read_bytes()
    for length in range(0, len(content), 7):
        path.write_bytes(content[:length])
        assert faults(path)


def test_a_changed_byte_never_gives_other_arrays(tmp_path):
    path = written(tmp_path / "a.npz")
    content, digest = path.read_bytes(), arrays_digest(GOOD)
    generator = np.random.default_rng(7)
    refused = 0
    for place in range(0, len(content), 3):
        changed = bytearray(content)
        changed[place] ^= int(generator.integers(1, 256))
        path.write_bytes(changed)
        try:
            assert arrays_digest(read(path)) == digest
        except gf.CaseFileError:
            refused += 1
    assert refused > len(content) / 3 / 2


def test_the_digest_knows_names_types_shapes_and_contents():
    digest = arrays_digest(GOOD)
    assert digest == arrays_digest(dict(reversed(GOOD.items())))
    others = (
        {"a": GOOD["a"].reshape(3, 2)}, {"b": np.ones(3, np.float32)}, {"at": np.array([2, 0, 1])},
        {"more": np.zeros(0)}, {"names": np.array(["x", "yz"])},
    )  # fmt: skip
    assert digest not in {arrays_digest(GOOD | other) for other in others}
