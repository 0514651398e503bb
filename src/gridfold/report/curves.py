"""Pictures of what is watched of a run: a panel for each kind of quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.io.run_tables import RunTable
from gridfold.report.plain import picture_text
from gridfold.report.style import (
    BACKGROUND_LINE,
    FAULT_SHADE,
    PALETTE,
    new_figure,
    put_title,
)
from gridfold.runs.monitor import Columns
from gridfold.runs.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Curves of a panel that are told apart by colour.
_COLOURED = 6
#: What the axis of a panel says, by the beginning of its columns' names.
_AXES = {
    "angle_deg": "Rotor angle\n(degrees)",
    "angle_coi_deg": "Rotor angle against the\ncentre of inertia (degrees)",
    "speed_pu": "Speed (p.u.)",
    "generation_mw": "Generation (MW)",
    "generation_mvar": "Generation (Mvar)",
    "voltage_pu": "Bus voltage (p.u.)",
    "voltage_angle_deg": "Angle of bus voltage\n(degrees)",
    "frequency_hz": "Bus frequency (Hz)",
    "island_hz": "Frequency of islands (Hz)",
    "load_mw": "Load (MW)",
    "load_mvar": "Load (Mvar)",
    "p_mw": "Flow into the line (MW)",
    "q_mvar": "Flow into the line (Mvar)",
    "current_pu": "Current into the line (p.u.)",
    "interface_mw": "Interface (MW)",
    "interface_mvar": "Interface (Mvar)",
}
#: Height in inches of a panel, and of what stands around them.
_PANEL, _AROUND = 2.5, 1.3
_WIDTH = 11.0
#: Kinds of quantities for which a picture has room.
_MOST_KINDS = 24


@dataclass(frozen=True)
class RunCurves:
    """Curves of a run.

    Parameters
    ----------
    title : str
        What the run is.
    times : ndarray, shape (n,)
        In seconds.
    values : mapping of str to ndarray of shape (n,)
        Curves by the names of their columns.
    faults : sequence of (float, float)
        When a fault is on, in seconds.
    events : sequence of float
        When something else happens, in seconds.
    """

    title: str
    times: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]
    faults: Sequence[tuple[float, float]] = ()
    events: Sequence[float] = field(default=())


def run_curves(run: Trajectory, columns: Columns) -> RunCurves:
    """Curves of `columns` of a run."""
    table = run.table(columns)
    told = "; ".join(f"{notice.time:g} s: {notice.text}" for notice in run.notices[:4])
    title = f"{run.model.case.name}, {run.simulated.name} model: {run.status.value}"
    stages = [
        (piece.times, model) for piece, model in zip(run.run.pieces, run.models, strict=False)
    ]
    return RunCurves(
        f"{title}\n{told}" if told else title,
        table[:, 0],
        dict(zip(columns.names, table.T[1:], strict=True)),
        [(float(times[0]), float(times[-1])) for times, model in stages if model.state.faulted],
        [float(times[0]) for times, model in stages if times[0] > 0 and not model.state.faulted],
    )


def table_curves(table: RunTable, names: Sequence[str], every: int = 1) -> RunCurves:
    """Curves `names` of a table that was written, each how many-th row of it."""
    about = table.metadata
    told = ", ".join(str(about[key]) for key in ("case", "model", "status") if key in about)
    faults, times = [], []
    for event in about.get("events", ()):
        if "duration" in event and "start" in event:
            faults.append((float(event["start"]), float(event["start"]) + float(event["duration"])))
        elif "time" in event:
            times.append(float(event["time"]))
    values = {name: table.values[name][::every] for name in names}
    last = float(table.times[-1])
    return RunCurves(
        f"{table.path.name}\n{told}" if told else table.path.name,
        table.times[::every],
        values,
        [(start, min(end, last)) for start, end in faults if start < last],
        [time for time in times if 0 < time < last],
    )


def draw_curves(curves: RunCurves) -> Figure:
    """A figure of curves: of many of a kind those that move most in colour, the others grey.

    Raises
    ------
    OptionError
        There are too many kinds of them for one picture.
    """
    kinds = _by_kind(curves.values)
    figure = new_figure(_WIDTH, _AROUND + _PANEL * len(kinds))
    panels = figure.subplots(len(kinds), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (kind, names) in zip(panels, kinds.items(), strict=True):
        moving = most_moving(curves.values, names)
        if len(names) > len(moving):
            _draw_grey(axes, curves.times, [curves.values[name] for name in names])
        for color, name in zip(PALETTE, moving, strict=False):
            label = _label(name)
            axes.plot(curves.times, curves.values[name], color=color, linewidth=1.3, label=label)
        title = (
            None if len(moving) == len(names) else f"{len(moving)} of {len(names)},\nmoving most"
        )
        finish_panel(axes, kind, curves, title)
    panels[-1].set_xlabel("Time (s)")
    figure.align_ylabels()
    put_title(figure, curves.title)
    return figure


def draw_both(first: RunCurves, second: RunCurves, labels: tuple[str, str]) -> Figure:
    """Two runs with the same curves at the same times, and their differences below each panel.

    Of each kind the curves that differ most are drawn, the first run solid, the second one dashed.
    """
    kinds = _by_kind(first.values)
    figure = new_figure(_WIDTH, _AROUND + 1.6 * _PANEL * len(kinds))
    grid = figure.subplots(
        2 * len(kinds), 1, sharex=True, squeeze=False, height_ratios=[1.6, 1.0] * len(kinds)
    )[:, 0]
    apart = {name: second.values[name] - first.values[name] for name in first.values}
    for above, below, (kind, names) in zip(grid[::2], grid[1::2], kinds.items(), strict=True):
        for color, name in zip(PALETTE, _largest(apart, names), strict=False):
            label = _label(name)
            style = {"color": color, "linewidth": 1.2}
            above.plot(first.times, first.values[name], label=label, **style)
            above.plot(first.times, second.values[name], linestyle="--", **style)
            below.plot(first.times, apart[name], label=label, **style)
        shown = min(_COLOURED, len(names))
        title = None if shown == len(names) else f"{shown} of {len(names)},\ndiffering most"
        finish_panel(above, kind, first, title)
        finish_panel(below, kind, first, None, legend=False)
        below.set_ylabel("Dashed less\nsolid")
    grid[-1].set_xlabel("Time (s)")
    figure.align_ylabels()
    put_title(figure, f"Solid: {labels[0]}\nDashed: {labels[1]}")
    return figure


def _label(name: str) -> str:
    """What a column is of, for a legend; Matplotlib leaves out what begins with an underscore."""
    text = picture_text(name.partition(":")[2] or name)
    return f" {text}" if text.startswith("_") else text


def most_moving(
    values: Mapping[str, NDArray[np.float64]], names: Sequence[str], count: int = _COLOURED
) -> list[str]:
    """Those of the curves whose values range furthest, in the order of `names`; all of a few."""
    if len(names) <= len(PALETTE):
        return list(names)
    ranges = {name: _range(values[name]) for name in names}
    chosen = sorted(names, key=lambda name: -ranges[name])[:count]
    return [name for name in names if name in chosen]


def finish_panel(
    axes: Axes, kind: str, curves: RunCurves, title: str | None, legend: bool = True
) -> None:
    """Faults, events, labels and the legend beside a panel."""
    for start, end in curves.faults:
        axes.axvspan(start, end, color=FAULT_SHADE, linewidth=0)
    for time in curves.events:
        axes.axvline(time, color="#999999", linewidth=0.8, linestyle=":")
    axes.set_ylabel(picture_text(axis_text(kind)).replace("\\n", "\n"))
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.grid(color="#eeeeee")
    axes.margins(x=0)
    if legend:
        axes.legend(
            loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", title=title,
            title_fontsize="small", frameon=False,
        )  # fmt: skip


def axis_text(kind: str) -> str:
    """What the axis of a kind of columns says."""
    if kind in _AXES:
        return _AXES[kind]
    for group in ("area", "zone", "owner"):
        for what in ("generation", "load", "interchange"):
            if kind == f"{group}_{what}_mw":
                return f"{what.capitalize()} of the\n{group} (MW)"
    words = kind.replace("_", " ")
    return f"{words[:1].upper()}{words[1:]}\n(p.u., angles in rad)"


def _by_kind(names: Mapping[str, object]) -> dict[str, list[str]]:
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(name.partition(":")[0], []).append(name)
    if len(kinds) > _MOST_KINDS:
        raise OptionError(
            f"a picture has room for {_MOST_KINDS} kinds of quantities, not for {len(kinds)}: "
            "choose some"
        )
    return kinds


def _range(values: NDArray[np.float64]) -> float:
    there = values[np.isfinite(values)]
    return float(np.ptp(there)) if len(there) else -1.0


def _largest(apart: Mapping[str, NDArray[np.float64]], names: Sequence[str]) -> list[str]:
    sizes = {name: float(np.nanmax(np.abs(apart[name]), initial=0.0)) for name in names}
    chosen = sorted(names, key=lambda name: -sizes[name])[:_COLOURED]
    return [name for name in names if name in chosen]


def _draw_grey(
    axes: Axes, times: NDArray[np.float64], curves: Sequence[NDArray[np.float64]]
) -> None:
    """Curves in grey, as one artist."""
    from matplotlib.collections import LineCollection

    lines = [np.column_stack([times, values]) for values in curves]
    axes.add_collection(LineCollection(lines, colors=BACKGROUND_LINE, linewidths=0.6))
    axes.autoscale_view()
