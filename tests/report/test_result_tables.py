from __future__ import annotations

import io
import re

import pandas as pd
import pytest

from gridfold.report.plain import PlainConsole
from gridfold.report.result_tables import result_tables

NAMES = ["transformer 3-4 at 4, cleared by tripping it", "bus 12", "line 1001-1002:BL at 1001"]


def frame(**columns: list) -> pd.DataFrame:
    base = {
        "number": [1, 2, 3],
        "name": NAMES,
        "status": ["completed", "lost synchronism", "completed"],
        "critical_machine": ["26:1"] * 3,
        "largest_separation_deg": [149.04, 310.0, 97.7],
        "lowest_voltage": [0.641, 0.2, 0.9],
        "damping_ratio": [0.328, 0.05, 0.4],
        "error_rms_deg": [0.58, 0.4, 0.1],
    }
    return pd.DataFrame(base | columns).convert_dtypes()


def text(width: int, columns: tuple[str, ...] = (), **more: list) -> str:
    console = PlainConsole(width=width, file=io.StringIO(), highlight=False)
    for table in result_tables(frame(**more), 3, width, columns):
        console.print(table)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [80, 100, 220])
def test_names_of_contingencies_stay_on_one_line(width):
    said = text(width)
    assert all(name in said for name in NAMES)
    assert max(map(len, said.splitlines())) <= width


def test_columns_without_room_are_named_and_give_way_from_the_right():
    said = text(80)
    assert "no room for" in said
    assert "error_rms_deg: --columns" in said
    assert "no room" not in text(220)


def test_damping_is_in_percent_and_its_column_is_a_ratio_as_it_is_called():
    assert "(%)" in text(220)
    assert "32.8" in text(220)
    stored = text(220, ("damping_ratio",))
    assert "0.328" in stored
    assert "%" not in stored


@pytest.mark.parametrize("width", [40, 80, 220])
def test_all_columns_are_there_with_their_names_whole(width):
    many = {f"a_column_with_a_rather_long_name_{k}": [k + 0.5] * 3 for k in range(30)}
    columns = ("number", "name", "status", *many)
    said = text(width, columns, **many)
    if width >= 80:
        assert all(name in said for name in columns)
    folded = "".join(re.split(r"[\s]+", said))
    assert folded.count("12.500000") == 3
    assert max(map(len, said.splitlines())) <= width


def test_a_name_longer_than_the_terminal_is_folded_not_cut():
    long = "x" * 150
    said = text(80, name=[long, "b", "c"])
    assert sum(line.count("x") for line in said.splitlines()) == 150
