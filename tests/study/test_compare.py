"""Two tables of figures, compared by hand."""

import pandas as pd

from gridfold.study.compare import FigureDifference, OtherVerdict, compare_studies


def frame(**columns):
    count = len(columns["name"])
    return pd.DataFrame({"number": range(1, count + 1), "kind": "bus fault", **columns})


def test_contingencies_are_matched_by_name_and_figures_by_column():
    first = frame(
        name=["a", "b", "c"],
        status=["completed", "completed", "failed"],
        lowest_voltage=[0.9, 0.8, None],
        steps=pd.array([5, 6, None], dtype="Int64"),
        reason=["", "", "x"],
        wall_s=[1.0, 2.0, 3.0],
    )
    second = frame(
        name=["d", "b", "a"],
        status=["completed", "lost synchronism", "completed"],
        lowest_voltage=[0.1, 0.5, 0.9],
        steps=pd.array([1, 6, 5], dtype="Int64"),
        reason=["", "y", ""],
        wall_s=[9.0, 9.0, 9.0],
    )
    found = compare_studies(first, second)
    assert found.common == ("a", "b")
    assert (found.first_only, found.second_only) == (("c",), ("d",))
    assert found.verdicts == (OtherVerdict("b", "completed", "lost synchronism"),)
    (figure,) = found.figures
    rounded = FigureDifference(**{**vars(figure), "largest": round(figure.largest, 12)})
    assert rounded == FigureDifference("lowest_voltage", 2, 1, -0.3, "b", 0.8, 0.5)


def test_a_study_is_no_different_from_itself():
    one = frame(name=["a"], status=["completed"], lowest_voltage=[0.9])
    found = compare_studies(one, one)
    assert (found.verdicts, found.figures, found.first_only) == ((), (), ())
