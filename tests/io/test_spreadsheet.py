"""Texts that a spreadsheet would run."""

import pandas as pd
import pytest

from gridfold.io.spreadsheet import formula_cells, without_formulas

FORMULAS = ["=1+1", "+1", "-5e9 load", "@SUM(A1)", "\t=1", "\r=1", " =cmd|'/c calc'!A0", "＝1"]  # noqa: RUF001
HARMLESS = ["bus 3", "3-2", "a=b", "'=1", "", "1+1", "Łódź"]


@pytest.mark.parametrize("dtype", ["object", "string"])
def test_formulas_are_counted_and_begin_with_an_apostrophe(dtype):
    names = pd.Series([*FORMULAS, *HARMLESS, None], dtype=dtype)
    frame = pd.DataFrame({"name": names, "angle": -1.0})
    assert formula_cells(frame) == len(FORMULAS)
    safe = without_formulas(frame)
    assert safe["name"].tolist()[: len(FORMULAS)] == ["'" + text for text in FORMULAS]
    assert safe["name"].tolist()[len(FORMULAS) : -1] == HARMLESS
    assert safe["name"].isna().tolist()[-1]
    assert (safe["angle"] == -1.0).all(), "numbers stay numbers"
    assert formula_cells(safe) == 0
