from __future__ import annotations

import pickle

import pytest

import gridfold as gf

ERRORS = [
    gf.OptionError("the step is negative"),
    gf.InitializationError("beyond limits", ["--on-limit adjust moves them"]),
    gf.CaseError(["one", "two"], "grid.raw", ["--some-option"]),
    gf.CaseError("one", "grid.raw", ["--a"]).joined(
        gf.PowerFlowError("no solution", ["--b", "--a"])
    ),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_says_the_same_on_the_other_side_of_a_pipe(error):
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert str(there) == str(error)
    assert there.advice == error.advice
    assert getattr(there, "faults", None) == getattr(error, "faults", None)


def test_joined_errors_say_both_and_each_option_once_at_the_end():
    both = gf.CaseError(["one", "two"], "grid.raw", ["--a"]).joined(
        gf.CaseError("three", "grid.dyr", ["--b", "--a"])
    )
    assert str(both).splitlines() == [
        "grid.raw: 2 faults", "  one", "  two", "grid.dyr: 1 fault", "  three", "--a", "--b",
    ]  # fmt: skip
    assert both.faults == ["one", "two", "three"]
