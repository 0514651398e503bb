"""Two studies: their contingencies matched by name, verdicts and figures that differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gridfold.study.summary import WALL

if TYPE_CHECKING:
    import pandas as pd

#: Columns that are no figures: what names something, and the verdict itself.
_NO_FIGURES = ("number", "name", "kind", "stable")
_BUS = "_bus"


@dataclass(frozen=True)
class OtherVerdict:
    """A contingency that ended otherwise: its name, and how it ended in both studies."""

    name: str
    first: str
    second: str


@dataclass(frozen=True)
class FigureDifference:
    """A figure in which studies differ.

    Parameters
    ----------
    figure : str
        Its column.
    contingencies : int
        How many contingencies have it in both studies.
    differing : int
        In how many of them it differs.
    largest : float
        The largest difference, second less first.
    name : str
        Which contingency has that.
    first, second : float
        The figure there in both studies.
    """

    figure: str
    contingencies: int
    differing: int
    largest: float
    name: str
    first: float
    second: float


@dataclass(frozen=True)
class StudyComparison:
    """What two studies have in common, and where they differ.

    Parameters
    ----------
    common : tuple of str
        Names of the contingencies that both have a result of.
    first_only, second_only : tuple of str
        Names that one of them has alone.
    verdicts : tuple of OtherVerdict
        Contingencies that ended otherwise.
    figures : tuple of FigureDifference
        Figures that differ, in the order of the columns.
    """

    common: tuple[str, ...]
    first_only: tuple[str, ...]
    second_only: tuple[str, ...]
    verdicts: tuple[OtherVerdict, ...]
    figures: tuple[FigureDifference, ...]


def compare_studies(first: pd.DataFrame, second: pd.DataFrame) -> StudyComparison:
    """Compare the results of two studies, from :meth:`gridfold.StudyStore.frame`."""
    one, two = first.set_index("name"), second.set_index("name")
    common = [name for name in one.index if name in two.index]
    one, others = one.loc[common], two.loc[common]
    verdicts = [
        OtherVerdict(name, str(before), str(after))
        for name, before, after in zip(common, one["status"], others["status"], strict=True)
        if before != after
    ]
    columns = [
        name
        for name in one.columns
        if name in others.columns
        and name not in _NO_FIGURES
        and not name.startswith(WALL)
        and not name.endswith(_BUS)
    ]
    found = (_figure(name, one[name], others[name]) for name in columns)
    return StudyComparison(
        tuple(common),
        tuple(name for name in first["name"] if name not in two.index),
        tuple(name for name in second["name"] if name not in common),
        tuple(verdicts),
        tuple(item for item in found if item is not None),
    )


def _figure(name: str, first: pd.Series, second: pd.Series) -> FigureDifference | None:
    """The difference of a figure; None where it has no numbers in both, or the same ones."""
    numbers = [_numbers(column) for column in (first, second)]
    apart = numbers[1] - numbers[0]
    both = np.isfinite(apart)
    differing = int((apart[both] != 0).sum())
    if not differing:
        return None
    at = int(np.flatnonzero(both)[np.abs(apart[both]).argmax()])
    values = float(numbers[0][at]), float(numbers[1][at])
    return FigureDifference(
        name, int(both.sum()), differing, float(apart[at]), str(first.index[at]), *values
    )


def _numbers(column: pd.Series) -> np.ndarray:
    import pandas as pd

    if not pd.api.types.is_numeric_dtype(column):
        return np.full(len(column), np.nan)
    return column.astype("Float64").to_numpy(dtype=float, na_value=np.nan)
