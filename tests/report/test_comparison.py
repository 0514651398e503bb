"""Tables of two runs or two studies beside each other, in the width of a terminal."""

import io

from gridfold.report.comparison import difference_table, figure_table
from gridfold.report.plain import PlainConsole
from gridfold.runs.monitor.differences import Difference
from gridfold.study.compare import FigureDifference


def printed(table, width=80):
    console = PlainConsole(file=io.StringIO(), width=width)
    console.print(table)
    return console.file.getvalue()


def test_names_of_figures_stay_whole_in_a_narrow_terminal():
    names = ("largest_angle_change_deg", "critical_clearing_time", "largest_separation_deg")
    place = "line 1001-1002:1 at 1001, then its bus"
    text = printed(
        figure_table(
            [FigureDifference(name, 60, 42, -96.535, place, 202.14, 105.61) for name in names]
        )
    )
    lines = [line.split() for line in text.splitlines()]
    for name in names:
        assert [name, "42", "of", "60", "-96.535"] in [line[:5] for line in lines]
    assert max(map(len, text.splitlines())) <= 80
    assert "202.14" in text


def test_columns_that_one_run_has_alone_at_times_are_named():
    gap = Difference("frequency_hz:8", 0.06, 1.06, 0.04, (60.3, 60.4), 5)
    whole = Difference("voltage_pu:8", 0.01, 1.0, 0.01, (1.0, 1.01), 0)
    text = " ".join(printed(difference_table([gap, whole], 20)).split())
    assert "at some times one of the runs alone has a value: frequency_hz:8" in text
    assert "has a value: frequency_hz:8, voltage_pu:8" not in text
