"""Texts that a spreadsheet would take for formulas."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

#: How a formula begins, in full width too; a tab or a line end before it is dropped by some programs.
_FORMULA = r"^[\t\r\n]|^\s*[=+\-@＝＋－＠]"  # noqa: RUF001


def formula_cells(frame: pd.DataFrame) -> int:
    """How many texts of a table a spreadsheet would take for formulas."""
    return sum(int(_formulas(frame[name]).sum()) for name in _texts(frame))


def without_formulas(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with an apostrophe before each text that a spreadsheet would take for a formula."""
    safe = {}
    for name in _texts(frame):
        column = frame[name]
        safe[name] = column.mask(_formulas(column), "'" + column.astype("string"))
    return frame.assign(**safe)


def _texts(frame: pd.DataFrame) -> list[str]:
    return [str(name) for name in frame if str(frame[name].dtype) in ("string", "str", "object")]


def _formulas(column: pd.Series[str]) -> pd.Series[bool]:
    return column.astype("string").str.contains(_FORMULA, regex=True).fillna(False).astype(bool)
