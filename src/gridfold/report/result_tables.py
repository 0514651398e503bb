"""Results of a study in the width of a terminal: names stay whole, columns give way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.box import SIMPLE_HEAD

from gridfold.report.plain import PlainTable, visible

if TYPE_CHECKING:
    import pandas as pd


class _Column(NamedTuple):
    """How a column is written: its heading, digits, and what its values are multiplied by."""

    heading: str
    digits: int
    factor: float = 1.0


#: Columns that are shown if none are asked for, in the order in which they matter.
_SHOWN = {
    "number": _Column("no.", 0),
    "name": _Column("contingency", 0),
    "status": _Column("status", 0),
    "critical_machine": _Column("machine", 0),
    "violations": _Column("vio-\nlates", 0),
    "largest_separation_deg": _Column("apart\n(deg)", 1),
    "lowest_voltage": _Column("lowest\n(p.u.)", 3),
    "lowest_voltage_bus": _Column("at\nbus", 0),
    "damping_ratio": _Column("damping\n(%)", 1, 100.0),
    "islanded_mw": _Column("cut off\n(MW)", 0),
    "lost_load_mw": _Column("lost\n(MW)", 0),
    "critical_clearing_time": _Column("CCT\n(s)", 2),
    "error_rms_deg": _Column("error\n(deg)", 2),
}
#: Columns that are shown only if one of their values is not 0.
_SELDOM = ("islanded_mw", "lost_load_mw")
#: Columns that do not give way to others.
_KEPT = ("number", "name", "status", "critical_machine")
_FINE = 6
#: Width to which texts may shrink, and that of a contingency in a table that stands on its side.
_NARROW, _UPRIGHT = 16, 24
#: Characters between two columns.
_GAP = 2


def result_tables(
    frame: pd.DataFrame, limit: int, width: int, columns: Sequence[str] = ()
) -> list[PlainTable]:
    """The first `limit` rows in tables of at most `width` characters.

    Columns that are not asked for are left out where they have no value or no room. Those that are
    asked for stand below one another where they have no room, as many contingencies beside one
    another as fit.
    """
    rows = frame.head(limit)
    if not columns:
        shown = {name: what for name, what in _SHOWN.items() if _worth_showing(frame, name)}
        return [_fitting(rows, shown, width)]
    asked = {name: _as_stored(name) for name in columns}
    if _width(rows, asked) <= width:
        return [_upright(rows, asked)]
    beside = max(1, width // (_UPRIGHT + _GAP) - 1)
    return [_on_its_side(rows.iloc[at : at + beside], asked) for at in range(0, len(rows), beside)]


def _as_stored(name: str) -> _Column:
    """A column under its own name, in the unit in which it is stored."""
    if name not in _SHOWN:
        return _Column(name, _FINE)
    usual = _SHOWN[name]
    return _Column(name, usual.digits + round(math.log10(usual.factor)))


def _fitting(rows: pd.DataFrame, shown: dict[str, _Column], width: int) -> PlainTable:
    """The table with as many columns as fit, and a line about the others."""
    left_out = []
    for name in reversed([name for name in shown if name not in _KEPT]):
        if _width(rows, shown) <= width:
            break
        left_out.append(name)
        shown = {key: what for key, what in shown.items() if key != name}
    table = _upright(rows, shown)
    if left_out:
        table.note(f"no room for {', '.join(reversed(left_out))}: --columns")
    return table


def _upright(rows: pd.DataFrame, shown: dict[str, _Column]) -> PlainTable:
    """A row for each contingency. Texts give way where the terminal is narrow, figures do not."""
    table = PlainTable(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name, column in shown.items():
        number, widest = _is_number(rows, name), _widest(rows, name, column)
        table.add_column(
            column.heading,
            justify="right" if number else "left",
            no_wrap=number,
            overflow="fold",
            min_width=widest if number else min(widest, _NARROW),
        )
    for row in rows.to_dict("records"):
        table.add_row(*(_cell(row[name], column) for name, column in shown.items()))
    return table


def _on_its_side(rows: pd.DataFrame, shown: dict[str, _Column]) -> PlainTable:
    """A column for each contingency."""
    table = PlainTable(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_header=False)
    table.add_column(overflow="fold", style="bold")
    records = rows.to_dict("records")
    for _ in records:
        table.add_column(overflow="fold", min_width=min(_UPRIGHT, _NARROW))
    for name, column in shown.items():
        table.add_row(name, *(_cell(row[name], column) for row in records))
    return table


def _is_number(rows: pd.DataFrame, name: str) -> bool:
    return rows[name].dtype.name in ("Float64", "Int64", "int64")


def _width(rows: pd.DataFrame, shown: dict[str, _Column]) -> int:
    """Characters that a table takes where nothing is broken."""
    return sum(_widest(rows, name, column) + _GAP for name, column in shown.items()) + 1


def _widest(rows: pd.DataFrame, name: str, column: _Column) -> int:
    cells = (len(_cell(value, column)) for value in rows[name])
    return max([*cells, *map(len, column.heading.split("\n"))])


def _worth_showing(frame: pd.DataFrame, name: str) -> bool:
    if name not in frame:
        return False
    known = frame[name].dropna()
    return bool((known != 0).any()) if name in _SELDOM else bool(len(known))


def _cell(value: Any, column: _Column) -> str:
    import pandas as pd

    if value is None or value is pd.NA:
        return ""
    if isinstance(value, float):
        return f"{value * column.factor:.{column.digits}f}"
    return visible(str(value))
