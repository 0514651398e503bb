"""Figures 2 to 5 of Osipov & Sun from our runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gridfold.equivalents.adaptive import AdaptiveRun
from gridfold.equivalents.families import Mode
from gridfold.errors import OptionError
from gridfold.grid.case import Bus
from gridfold.paper.runs import CaseStudy, SmallRun
from gridfold.report.plain import picture_text
from gridfold.report.style import BACKGROUND_LINE, PALETTE, new_figure, save_figure
from gridfold.runs.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MODE_COLORS = {
    Mode.DETAILED: PALETTE[1],
    Mode.RETAINED: PALETTE[4],
    Mode.HYBRID: PALETTE[4],
    Mode.LINEAR: PALETTE[5],
    Mode.WHOLE: PALETTE[2],
}
#: Machines of "generator 23".
MACHINES = ("23:1", "23:2")


def plot_switches(
    study: CaseStudy, runs: Sequence[tuple[SmallRun, AdaptiveRun]], path: Path
) -> None:
    """Fig. 2 as it ran: the angle deviation that decides, and the model in use, along time."""
    figure = new_figure(10, 3.2 * len(runs))
    rows = figure.subplots(len(runs), 1, sharex=True, squeeze=False)[:, 0]
    limits = {
        SmallRun.ADAPTIVE_PARTITIONED: study.thresholds.partitioned_deg,
        SmallRun.ADAPTIVE_WHOLE: study.thresholds.whole_deg,
    }
    for axes, (kind, run) in zip(rows, runs, strict=True):
        trajectory = run.trajectory
        _shade_modes(axes, run)
        axes.plot(trajectory.times, _largest_deviation(study, trajectory), color="black")
        limit = limits[kind]
        if limit is None:
            raise OptionError(f"there is no angle threshold for the run {kind.value}")
        axes.axhline(limit, color="#555555", linestyle="--", linewidth=0.9)
        axes.annotate(f"threshold {limit:g}°", (trajectory.t_end, limit), ha="right", va="bottom")
        count = len(run.switches)
        name = kind.value.replace("_", ", ")
        axes.set_title(f"{name}: {count} entries in the log of switches", fontsize="medium")
        axes.set_ylabel("Largest angle\ndeviation (degrees)")
        axes.margins(x=0)
        axes.legend(loc="upper right", fontsize="small")
    rows[-1].set_xlabel("Time (s)")
    save_figure(figure, path)


def plot_map(study: CaseStudy, path: Path) -> None:
    """Fig. 3: the grid by bus coordinates, with the study area, tie lines and marked machines."""
    case, parts = study.model.case, study.parts
    place = {bus.number: _coordinates(bus) for bus in case.buses}
    figure = new_figure(11, 7)
    axes = figure.subplots()
    ties = {tie.branch for tie in parts.tie_lines}
    for position, branch in enumerate(case.branches):
        line = np.array([place[branch.from_bus], place[branch.to_bus]])
        style = (PALETTE[1], 2.2) if position in ties else (BACKGROUND_LINE, 0.8)
        axes.plot(*line.T, color=style[0], linewidth=style[1], zorder=1)
    inside = [bus.number for bus in case.buses if bus.number in parts.study_buses]
    outside = [bus.number for bus in case.buses if bus.number not in parts.study_buses]
    kept = list(dict.fromkeys(unit.bus for unit in study.external.kept))
    reference = [study.reference_unit.bus]
    groups = (
        ("external bus", outside, ".", "#888888", 4),
        ("study-area bus", inside, "o", PALETTE[0], 5),
        ("study-area generators", _buses(parts.study_units), "s", PALETTE[0], 8),
        ("external generators", _buses(parts.external_units), "s", "#888888", 6),
        ("kept nonlinear", kept, "s", PALETTE[2], 9),
        ("reference generator", reference, "^", PALETTE[3], 11),
    )
    for label, buses, marker, color, size in groups:
        points = np.array([place[bus] for bus in buses]).reshape(-1, 2)
        axes.plot(*points.T, marker, color=color, markersize=size, label=label)
    axes.plot([], [], color=PALETTE[1], linewidth=2.2, label="tie line")
    ends = [bus for tie in parts.tie_lines for bus in (tie.study_bus, tie.external_bus)]
    named = (*kept, *reference, *ends)
    for bus in dict.fromkeys(named):
        axes.annotate(str(bus), place[bus], textcoords="offset points", xytext=(6, 5))
    latitude = np.mean([point[1] for point in place.values()])
    axes.set_aspect(1 / np.cos(np.deg2rad(latitude)))
    axes.set_xlabel("Longitude (degrees east)")
    axes.set_ylabel("Latitude (degrees north)")
    axes.legend(loc="lower right", fontsize="small")
    title = picture_text(f"{case.name}: study area, tie lines and external area")
    axes.set_title(title, fontsize="medium")
    save_figure(figure, path)


def plot_rotor_angles(
    detailed: Trajectory, linear: Trajectory, adaptive: Trajectory, title: str, path: Path
) -> None:
    """Figs. 4 and 5: rotor angles of the machines at bus 23, detailed, linear and adaptive."""
    figure = new_figure(10, 7)
    rows = figure.subplots(len(MACHINES), 1, sharex=True)
    runs = (
        ("detailed", detailed, "black", "-"),
        ("linear", linear, PALETTE[1], "--"),
        ("adaptive", adaptive, PALETTE[0], "-."),
    )
    for column, (axes, machine) in enumerate(zip(rows, MACHINES, strict=True)):
        for label, run, color, line in runs:
            note = "" if run.status.value == "completed" else f" ({run.status.value})"
            angles = run.rotor_angle_deg(MACHINES)[:, column]
            axes.plot(run.times, angles, line, color=color, linewidth=1.4, label=label + note)
        axes.set_ylabel(f"Rotor angle of machine {machine}\n(degrees)")
        axes.grid(color="#eeeeee")
        axes.margins(x=0)
    rows[0].legend(loc="upper right", ncols=3, fontsize="small")
    rows[0].set_title(title, fontsize="medium")
    rows[-1].set_xlabel("Time (s)")
    save_figure(figure, path)


def _shade_modes(axes: Axes, run: AdaptiveRun) -> None:
    """Bands of colour for the model in use; each model is named once."""
    ends = [*(switch.time for switch in run.switches[1:]), run.trajectory.times[-1]]
    named: set[Mode] = set()
    for switch, end in zip(run.switches, ends, strict=True):
        mode = switch.after
        label = None if mode in named else mode.value
        named.add(mode)
        axes.axvspan(
            switch.time, end, color=_MODE_COLORS[mode], alpha=0.45, linewidth=0, label=label
        )


def _largest_deviation(study: CaseStudy, run: Trajectory) -> NDArray[np.float64]:
    angles = run.rotor_angle_deg(study.parts.study_units, study.reference_unit)
    largest: NDArray[np.float64] = np.abs(angles - angles[0]).max(axis=1)
    return largest


def _coordinates(bus: Bus) -> tuple[float, float]:
    if bus.longitude is None or bus.latitude is None:
        raise OptionError(f"bus {bus.number} has no coordinates; a map cannot be drawn")
    return bus.longitude, bus.latitude


def _buses(units: Sequence[object]) -> list[int]:
    return list(dict.fromkeys(int(str(unit).split(":")[0]) for unit in units))
