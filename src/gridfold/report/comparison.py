"""Tables and pictures of two runs or two studies beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD

from gridfold.report.plain import PlainTable, visible
from gridfold.report.style import PALETTE, new_figure, put_title
from gridfold.runs.monitor.differences import Difference
from gridfold.study.compare import FigureDifference, OtherVerdict, StudyComparison

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

#: Figures of studies that are drawn against each other, with what their axes say.
_DRAWN = {
    "largest_separation_deg": "Largest separation (degrees)",
    "lowest_voltage": "Lowest voltage (p.u.)",
    "nadir_hz": "Lowest frequency (Hz)",
    "critical_clearing_time": "Critical clearing time (s)",
}
_NAMES = 8
#: Width to which names of contingencies may shrink.
_NARROW = 10


def difference_table(found: Sequence[Difference], limit: int) -> PlainTable:
    """Columns of two runs with their differences, the `limit` largest of each kind."""
    table = PlainTable(title="Differences, second less first", title_justify="left")
    table.add_column("column", overflow="fold")
    for name in ("largest", "at (s)", "first", "second", "RMS"):
        table.add_column(name, justify="right")
    shown = 0
    counts: dict[str, int] = {}
    for item in found:
        kind = item.name.partition(":")[0]
        counts[kind] = counts.get(kind, 0) + 1
        if counts[kind] <= limit:
            shown += 1
            figures = (item.largest, item.at, *item.values, item.root_mean_square)
            table.add_row(item.name, *map(_number, figures))
    notes = [f"{len(found) - shown:,} columns differ less"] if shown < len(found) else []
    if gaps := [item.name for item in found if item.gaps]:
        notes.append(names_line("at some times one of the runs alone has a value", gaps))
    if notes:
        table.note("; ".join(notes))
    return table


def verdict_table(found: Sequence[OtherVerdict], limit: int) -> PlainTable:
    """Contingencies that ended otherwise."""
    table = PlainTable(title="Other verdict", title_justify="left")
    for name in ("contingency", "first", "second"):
        table.add_column(name, overflow="fold")
    for item in found[:limit]:
        table.add_row(item.name, item.first, item.second)
    if len(found) > limit:
        table.note(f"{len(found) - limit:,} more; --limit shows more of them")
    return table


def figure_table(found: Sequence[FigureDifference]) -> PlainTable:
    """Figures of two studies where they differ most."""
    table = PlainTable(
        title="Figures, second less first",
        title_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("figure", no_wrap=True)
    for name in ("differ", "largest"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("at contingency", overflow="fold", min_width=_NARROW)
    for name in ("first", "second"):
        table.add_column(name, justify="right", no_wrap=True)
    for item in found:
        count = f"{item.differing:,} of {item.contingencies:,}"
        values = map(_number, (item.first, item.second))
        table.add_row(item.figure, count, _number(item.largest), item.name, *values)
    if not found:
        table.note("all figures that both have are the same")
    return table


def names_line(text: str, names: Sequence[str]) -> str:
    """A line with the first few of some names."""
    more = " ..." if len(names) > _NAMES else ""
    return f"{text}: {', '.join(map(visible, names[:_NAMES]))}{more}"


def draw_figures(
    first: pd.DataFrame,
    second: pd.DataFrame,
    found: StudyComparison,
    labels: tuple[str, str],
) -> Figure:
    """Figures of contingencies that both studies have, one against the other; other verdicts marked."""
    one, two = (frame.set_index("name").loc[list(found.common)] for frame in (first, second))
    drawn = {
        name: (_floats(one[name]), _floats(two[name]))
        for name in _DRAWN
        if name in one and name in two and (one[name].notna() & two[name].notna()).any()
    }
    otherwise = one.index.isin([item.name for item in found.verdicts])
    columns = 1 if len(drawn) < 2 else 2
    rows = max(1, (len(drawn) + 1) // 2)
    figure = new_figure(5.2 * columns, 0.9 + 4.4 * rows)
    panels = figure.subplots(rows, columns, squeeze=False)
    for axes, (name, (x, y)) in zip(panels.ravel(), drawn.items(), strict=False):
        ends = [float(np.nanmin([x, y])), float(np.nanmax([x, y]))]
        axes.plot(ends, ends, color="#999999", linewidth=0.8)
        for chosen, marker, color, label in (
            (~otherwise, "o", PALETTE[0], "same verdict"),
            (otherwise, "D", PALETTE[1], "other verdict"),
        ):
            if chosen.any():
                axes.plot(x[chosen], y[chosen], marker, color=color, markersize=5, label=label)
        axes.set_title(_DRAWN[name], fontsize="medium")
        axes.set_xlabel("First")
        axes.set_ylabel("Second")
        axes.grid(color="#eeeeee")
        axes.ticklabel_format(useOffset=False)
        axes.legend(fontsize="small")
    for axes in panels.ravel()[len(drawn) :]:
        axes.set_visible(False)
    put_title(figure, f"First: {labels[0]}\nSecond: {labels[1]}")
    return figure


def _floats(column: pd.Series[float]) -> NDArray[np.float64]:
    values = column.astype("Float64").to_numpy(dtype=float, na_value=float("nan"))
    return np.asarray(values, dtype=np.float64)


def _number(value: float) -> str:
    return f"{value:.5g}" if isfinite(value) else ""
