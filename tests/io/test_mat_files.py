import contextlib
import io
import tracemalloc

import numpy as np
import pytest
from scipy.io import loadmat, savemat

import gridfold as gf
from gridfold.io.mat_files import read_tables, variables
from gridfold.io.rapid_mat import read_rapid

#: A table of 16,000 columns whose file is 1/1000 of it.
JUNK = np.zeros((500, 16000))


def saved(compressed=True, **content):
    stream = io.BytesIO()
    savemat(stream, content, do_compression=compressed)
    return stream.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_names_and_sizes_are_found_without_reading(compressed):
    content = saved(compressed, x=np.ones((3, 4)), long_name_of_it=np.zeros((5, 6)), s={"a": JUNK})
    sizes = {variable.name: variable.size for variable in variables(content)}
    assert list(sizes) == ["x", "long_name_of_it", "s"]
    assert sizes["x"] >= 8 * 12
    assert sizes["long_name_of_it"] >= 8 * 30
    assert sizes["s"] >= JUNK.nbytes


@pytest.mark.parametrize("compressed", [False, True])
def test_tables_are_those_of_scipy(compressed):
    chance = np.random.default_rng(0)
    numbers = chance.normal(size=(7, 5))
    kinds = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
    tables = {f"t_{kind}": (50 * numbers).astype(kind) for kind in kinds}
    tables |= {
        "whole": np.arange(12.0).reshape(3, 4),
        "one": np.array([[7.0]]),
        "flags": numbers > 0,
    }
    others = {"text": "words", "cell": np.array([1, "a"], dtype=object), "complex": 1j * numbers}
    content = saved(compressed, **tables, **others, s={**tables, **others})
    found = read_tables(content, [*tables, *others, "s"], 2**20)
    read = loadmat(io.BytesIO(content))
    for place, expected in ((found, read), (found["s"], read["s"][0, 0])):
        for name in tables:
            np.testing.assert_array_equal(place[name], expected[name].astype(float))
        assert all(place[name] is None for name in others)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "no MATLAB file"),
        (b"not MATLAB", "no MATLAB file"),
        (bytes(200), "no MATLAB file"),
        (saved(x=1)[:140], "breaks off"),
        (saved(x=1)[:-1], "breaks off"),
        (b"MATLAB 7.3 MAT-file" + bytes(600), "-v7"),
    ],
)
def test_what_is_no_such_file_is_refused(content, said):
    with pytest.raises(ValueError, match=said):
        read_tables(content, ["x"], 2**20)


def test_every_damaged_byte_ends_in_tables_or_a_refusal():
    """SciPy's reader ends some of these in a segmentation fault."""
    sound = saved(False, mpc={"bus": np.ones((2, 3)), "name": "x"}, GenData=np.eye(2))
    for at in range(128, len(sound)):
        for value in (0, 1, 14, 127, 255, sound[at] ^ 1):
            spoilt = sound[:at] + bytes([value]) + sound[at + 1 :]
            with contextlib.suppress(ValueError):
                read_tables(spoilt, ["mpc", "GenData"], 2**20)


def test_a_variable_that_is_not_wanted_is_not_read(tmp_path):
    path = tmp_path / "grid.mat"
    path.write_bytes(saved(junk=JUNK, mpc=1.0))
    tracemalloc.start()
    with pytest.raises(gf.CaseFileError, match="mpc is not a structure"):
        read_rapid(path)
    assert tracemalloc.get_traced_memory()[1] < JUNK.nbytes / 4
    tracemalloc.stop()


def test_a_small_file_of_a_large_table_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("gridfold.io.rapid_mat._LARGEST", JUNK.nbytes)
    path = tmp_path / "grid.mat"
    path.write_bytes(saved(mpc={"bus": JUNK}))
    assert path.stat().st_size < JUNK.nbytes / 500
    with pytest.raises(gf.CaseFileError, match=r"mpc would take .* of memory"):
        read_rapid(path)
