"""A picture of a clearing-time map: the grid in the colours of the times, and the shortest as bars."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gridfold.report.plain import picture_text
from gridfold.report.style import BACKGROUND_LINE, PALETTE, new_figure, put_title, save_figure
from gridfold.runs.clearing import ClearingTimes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Record = Mapping[str, Any]

#: Bars that are drawn.
_BARS = 25
#: Letters of the name of a place.
_LETTERS = 26
_EDGE = "#1b1f24"


def plot_clearing_times(times: ClearingTimes, path: Path) -> None:
    """Draw clearing times into a picture, PNG or SVG by the file's ending."""
    save_figure(times.plot(), path)


def draw_clearing_times(record: Record) -> Figure:
    """The picture of a record of :func:`gridfold.report.clearing_record.clearing_record`."""
    rows = [dict(zip(record["fields"], row, strict=True)) for row in record["rows"]]
    figure = new_figure(13, 7)
    grid, bars = figure.subplots(1, 2, width_ratios=(1.9, 1))
    _draw_grid(grid, record, rows)
    _draw_bars(bars, record, rows)
    put_title(figure, f"{record['case']}: critical clearing times of three-phase faults")
    return figure


def _draw_grid(axes: Axes, record: Record, rows: list[dict[str, Any]]) -> None:
    from matplotlib.collections import LineCollection

    grid = record["map"]
    spots = {bus["number"]: (bus["x"], bus["y"]) for bus in grid["buses"]}
    lines = [[spots[a], spots[b]] for a, b in grid["branches"] if a in spots and b in spots]
    axes.add_collection(LineCollection(lines, colors=BACKGROUND_LINE, linewidths=0.8, zorder=1))
    few = min(1.0, 400 / max(len(rows), 1))
    groups = [*range(len(record["classes"])), "never", "failed"]
    for order, group in enumerate(groups):
        own = [row for row in rows if row["group"] == group]
        for line in (False, True):
            places = [row for row in own if row["line"] is line]
            label = (
                f"{_words(record, group)}: {len(own)}" if line is (not _any(own, False)) else None
            )
            if not places:
                continue
            axes.scatter(
                [row["x"] for row in places],
                [row["y"] for row in places],
                s=(78 - 9 * order) * (0.2 + 0.8 * few),
                label=label,
                zorder=20 - order,
                **_style(record, group, line),
            )
    axes.autoscale_view()
    if view := record["view"]:
        axes.set_xlim(view["x"])
        axes.set_ylim(view["y"])
    axes.set_aspect(_ratio(grid), adjustable="datalim")
    axes.set_axis_off()
    if rows:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4, fontsize="small", frameon=False
        )


def _any(rows: list[dict[str, Any]], line: bool) -> bool:
    return any(row["line"] is line for row in rows)


def _style(record: Record, group: int | str, line: bool) -> dict[str, Any]:
    marker = "^" if line else "o"
    if group == "failed":
        return {"marker": "x", "c": PALETTE[1]}
    if group == "never":
        return {"marker": marker, "facecolors": "#ffffff", "edgecolors": PALETTE[0]}
    color = record["classes"][group]["color"]
    return {"marker": marker, "facecolors": color, "edgecolors": _EDGE, "linewidths": 0.5}


def _words(record: Record, group: int | str) -> str:
    """What a group is called in the legend."""
    if group == "never":
        return f"stable up to {record['longest_ms']:g} ms"
    if group == "failed":
        return "failed"
    above, end = record["classes"][group]["above"], record["classes"][group]["up_to"]
    if above is None:
        return "all times" if end is None else f"up to {end:g} ms"
    return f"above {above:g} ms" if end is None else f"{above:g} to {end:g} ms"


def _ratio(grid: Record) -> float:
    """Height of a unit upwards over the width of one to the right."""
    if not grid["geographic"] or not grid["buses"]:
        return 1.0
    middle = float(np.mean([bus["y"] for bus in grid["buses"]]))
    return float(1 / max(0.2, np.cos(np.radians(middle))))


def _draw_bars(axes: Axes, record: Record, rows: list[dict[str, Any]]) -> None:
    timed = [row for row in rows if isinstance(row["group"], int)]
    shown = timed[:_BARS]
    if not shown:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no place has a limit", ha="center", transform=axes.transAxes)
        return
    places = np.arange(len(shown))
    colors = [record["classes"][row["group"]]["color"] for row in shown]
    bars = axes.barh(
        places, [row["cct_ms"] for row in shown], color=colors, edgecolor=_EDGE, linewidth=0.5
    )
    figures = [f"{row['cct_ms']:g}" if row["cct_ms"] else f"< {row['lost_ms']:g}" for row in shown]
    axes.bar_label(bars, figures, padding=2, fontsize="small")
    axes.set_yticks(places, [_label(row) for row in shown], fontsize="small")
    axes.invert_yaxis()
    axes.margins(x=0.12, y=0.01)
    axes.set_xlabel("Critical clearing time (ms)")
    axes.set_title(f"The {len(shown)} shortest of {len(timed)} with a limit", fontsize="medium")
    axes.spines[["top", "right"]].set_visible(False)


def _label(row: Mapping[str, Any]) -> str:
    text = f"{row['place']} ({row['name']})" if row["name"] else row["place"]
    return picture_text(text if len(text) <= _LETTERS else text[: _LETTERS - 1] + "…")
