from __future__ import annotations

import logging

from gridfold.equivalents import warm_up
from gridfold.numerics import kernel_cache
from gridfold.numerics.compile_notice import LOGGER


def test_a_folder_that_is_gone_at_the_end_is_told(monkeypatch, command):
    gone = kernel_cache._for_this_process() / kernel_cache._BASE
    monkeypatch.setattr(kernel_cache, "_folder", lambda label: gone)
    monkeypatch.setattr(warm_up, "_steps", lambda: iter(()))
    code, out, err = command("warm-up")
    assert code == 0
    assert "Compiled functions" in out
    assert "set NUMBA_CACHE_DIR" in " ".join(err.split())


def test_it_does_not_tell_that_it_compiles(monkeypatch, command, caplog):
    def compile_something():
        logging.getLogger(LOGGER).warning("compiling")

    monkeypatch.setattr(warm_up, "_steps", lambda: iter((compile_something,)))
    assert command("warm-up", "--json", "-")[0] == 0
    assert not caplog.messages
