import io
import tracemalloc

import numpy as np
import pytest
from scipy.io import savemat

import gridfold as gf
from gridfold.io.mat_sizes import variables
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
    sizes = {name: size for name, size, _ in variables(content)}
    assert list(sizes) == ["x", "long_name_of_it", "s"]
    assert sizes["x"] >= 8 * 12
    assert sizes["long_name_of_it"] >= 8 * 30
    assert sizes["s"] >= JUNK.nbytes


def test_what_is_no_such_file_has_no_sizes():
    for content in (b"", b"not MATLAB", bytes(200), saved(x=1)[:140]):
        assert not list(variables(content))


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
