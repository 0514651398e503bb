"""What is too large is refused with its size before it is made."""

import tracemalloc

import pytest

import gridfold as gf
from gridfold.ceilings import MEMORY_VARIABLE, memory_limit, require_disk, require_memory, size_text
from gridfold.runs.size import check_models, check_states, check_times

GIB = 2.0**30


@pytest.fixture
def one_gib(monkeypatch):
    monkeypatch.setenv(MEMORY_VARIABLE, "1")


def test_sizes_are_told_with_a_unit():
    assert size_text(1000) == "1000 bytes"
    assert size_text(1.5 * 2**20) == "1.5 MiB"
    assert size_text(2.0**60) == "1 EiB"
    assert size_text(float("inf")) == "more than can be counted"


def test_the_limit_is_below_what_the_machine_has_and_can_be_set(monkeypatch):
    monkeypatch.delenv(MEMORY_VARIABLE, raising=False)
    assert 0 <= memory_limit() < 2.0**50
    monkeypatch.setenv(MEMORY_VARIABLE, "0.25")
    assert memory_limit() == 0.25 * GIB
    for text in ("", "much", "-1", "0", "nan"):
        monkeypatch.setenv(MEMORY_VARIABLE, text)
        with pytest.raises(gf.OptionError, match=MEMORY_VARIABLE):
            memory_limit()


def test_what_fits_exactly_is_let_through(one_gib):
    require_memory("this", GIB, "")
    for size in (GIB + 1, float("inf"), float("nan")):
        with pytest.raises(gf.OptionError, match=r"this would take .* 1 GiB may be taken"):
            require_memory("this", size, "")


def test_a_file_has_to_fit_on_its_disk(tmp_path):
    require_disk(tmp_path / "new" / "a.csv", "a table", 1.0, "")
    with pytest.raises(gf.OutputError, match=r"a\.csv: a table would take .* are free\. Go\."):
        require_disk(tmp_path / "new" / "a.csv", "a table", 1e30, "Go.")


@pytest.mark.parametrize(("t_end", "step"), [(1e9, 0.01), (1e300, 1e-3), (1e5, 1e-6)])
def test_a_run_beyond_the_memory_is_refused_before_anything_is_allocated(
    npcc, one_gib, t_end, step
):
    tracemalloc.start()
    for refuse in (
        lambda: check_times(t_end, step),
        lambda: check_states(npcc, t_end, step),
        lambda: gf.simulate(npcc, [], t_end, gf.RungeKutta4(step)),
    ):
        with pytest.raises(gf.OptionError, match=r"samples .* would take .* of memory"):
            refuse()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1e8


@pytest.mark.parametrize("t_end", [0.0, -1.0, float("nan"), float("inf")])
def test_a_run_has_to_end(npcc, t_end):
    with pytest.raises(gf.OptionError, match="positive number of seconds"):
        check_times(t_end, 0.01)
    with pytest.raises(gf.OptionError, match="positive number of seconds"):
        gf.simulate(npcc, [], t_end)


def test_the_size_counts_samples_states_and_runs(npcc, one_gib):
    samples = int(GIB / (16 * npcc.n_states + 32))
    check_states(npcc, 0.01 * (samples - 2), 0.01)
    for t_end, at_once in ((0.01 * (samples + 2), 1), (0.01 * samples / 2, 3)):
        with pytest.raises(gf.OptionError):
            check_states(npcc, t_end, 0.01, at_once)


def test_each_network_state_counts(npcc, one_gib):
    check_models(npcc, 100)
    with pytest.raises(gf.OptionError, match="1,000,000 different network states"):
        check_models(npcc, 10**6)


def test_clearing_times_are_not_looked_for_below_a_microsecond(npcc):
    with pytest.raises(gf.OptionError, match="resolution"):
        gf.critical_clearing_time(npcc, gf.BusFault(3), resolution=1e-300)
