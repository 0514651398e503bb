from __future__ import annotations

import logging
import multiprocessing

import pytest

from gridfold.numerics import compile_notice
from gridfold.numerics.compile_notice import LOGGER, CompileNotice


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until it is moved."""
    now = [0.0]
    monkeypatch.setattr(compile_notice.time, "perf_counter", lambda: now[0])

    def move(seconds: float) -> None:
        now[0] += seconds

    return move


def _compile(notice: CompileNotice, clock, what: str, seconds: float) -> None:
    notice.begin(what)
    clock(seconds)
    notice.end(what)


def test_it_is_told_once_and_only_where_it_takes_a_while(clock, caplog):
    notice = CompileNotice()
    with caplog.at_level(logging.WARNING, LOGGER):
        _compile(notice, clock, "one", 0.4)
        clock(100.0)  # what is not compiling does not count
        _compile(notice, clock, "two", 0.05)
        assert not caplog.messages
        _compile(notice, clock, "three", 0.3)
        _compile(notice, clock, "four", 5.0)
        _compile(notice, clock, "five", 5.0)
    (message,) = caplog.messages
    assert "compiling, once, about 15 s" in message
    assert "warm-up" in message


def test_what_is_compiled_within_another_counts_once(clock, caplog):
    notice = CompileNotice()
    with caplog.at_level(logging.WARNING, LOGGER):
        notice.begin("outer")
        clock(0.2)
        _compile(notice, clock, "inner", 0.2)
        notice.end("outer")
        _compile(notice, clock, "next", 0.05)
        assert not caplog.messages


def test_workers_are_silent(clock, caplog, monkeypatch):
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: object())
    notice = CompileNotice()
    with caplog.at_level(logging.WARNING, LOGGER):
        _compile(notice, clock, "one", 9.0)
        _compile(notice, clock, "two", 9.0)
    assert not caplog.messages
