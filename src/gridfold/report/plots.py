"""Pictures of runs and of eigenvalues."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gridfold.grid.case import UnitKey
from gridfold.report.plain import picture_text
from gridfold.report.style import (
    BACKGROUND_LINE,
    FAULT_SHADE,
    PALETTE,
    new_figure,
    put_title,
    save_figure,
)
from gridfold.runs.small_signal import SmallSignal
from gridfold.runs.summary import summarize
from gridfold.runs.trajectory import AngleReference, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NAMED = 6


def plot_trajectory(
    run: Trajectory,
    path: Path,
    named: Sequence[UnitKey] = (),
    detailed: Trajectory | None = None,
) -> None:
    """Rotor angles against the centre of inertia, speeds and voltages of a run.

    `named` are the machines drawn in colour; by default those that swing most. Shaded: fault on.
    Rotor angles and speeds of these machines in a `detailed` run are added as dashed lines.
    """
    units = list(named) or [swing.unit for swing in summarize(run).swings[:_NAMED]]
    figure = new_figure(10, 10)
    angle, speed, voltage = figure.subplots(3, 1, sharex=True)
    coi = run.rotor_angle_deg(reference=AngleReference.CENTRE_OF_INERTIA)
    _draw_machines(angle, run, coi, units)
    _draw_machines(speed, run, run.signal("speed"), units)
    if detailed is not None:
        relative = detailed.rotor_angle_deg(units, AngleReference.CENTRE_OF_INERTIA)
        _draw_dashed(angle, detailed.times, relative)
        _draw_dashed(speed, detailed.times, detailed.signal("speed", units))
    magnitude = np.abs(run.bus_voltage())
    _draw_background(voltage, run.times, magnitude)
    buses = list(dict.fromkeys(unit.bus for unit in units))
    for color, bus in zip(PALETTE, buses, strict=False):
        column = run.model.case.bus_index[bus]
        voltage.plot(run.times, magnitude[:, column], color=color, label=f"bus {bus}")
    angle.set_ylabel("Rotor angle against the\ncentre of inertia (degrees)")
    speed.set_ylabel("Speed (p.u.)")
    voltage.set_ylabel("Bus voltage (p.u.)")
    voltage.set_xlabel("Time (s)")
    for axes in (angle, speed, voltage):
        _mark_events(axes, run)
        axes.grid(color="#eeeeee")
        axes.margins(x=0)
    angle.legend(loc="upper right", ncols=3, fontsize="small", title="machine (BUS:ID)")
    voltage.legend(loc="lower right", ncols=3, fontsize="small")
    what = "; ".join(f"{notice.time:g} s: {notice.text}" for notice in run.notices[:4])
    title = f"{run.model.case.name}, {run.simulated.name} model: {run.status.value}"
    put_title(figure, f"{title}\n{what}" if what else title)
    save_figure(figure, path)


def plot_eigenvalues(modes: SmallSignal, title: str, path: Path) -> None:
    """Eigenvalues in the complex plane with lines of constant damping ratio."""
    figure = new_figure(9, 6)
    axes = figure.subplots()
    values = modes.eigenvalues[modes.eigenvalues.imag >= 0]
    shown = values[values.real > -3.0]
    top = max(float(np.abs(shown.imag).max(initial=1.0)) * 1.08, 1.0)
    for ratio in (0.03, 0.05, 0.1):
        edge = -top * ratio / np.sqrt(1 - ratio**2)
        axes.plot([0, edge], [0, top], color="#999999", linewidth=0.8, linestyle="--")
        axes.annotate(f"{100 * ratio:g} %", (edge, top), fontsize="small", color="#555555")
    axes.axvline(0, color="#333333", linewidth=0.8)
    axes.plot(shown.real, shown.imag, "x", color=PALETTE[0])
    axes.set_ylim(-0.02 * top, top * 1.05)
    axes.set_xlabel("Real part (1/s)")
    axes.set_ylabel("Imaginary part (rad/s)")
    hidden = len(values) - len(shown)
    text = f"{title} ({hidden} modes lie further left; dashed: damping ratio)"
    put_title(figure, text)
    axes.grid(color="#eeeeee")
    save_figure(figure, path)


def _draw_machines(
    axes: Axes, run: Trajectory, values: NDArray[np.float64], units: Sequence[UnitKey]
) -> None:
    """All machines in grey, the named ones in colour on top."""
    _draw_background(axes, run.times, values)
    for color, unit in zip(PALETTE, units, strict=False):
        column = run.model.machines.index(unit)
        label = picture_text(str(unit))
        axes.plot(run.times, values[:, column], color=color, linewidth=1.3, label=label)


def _draw_dashed(axes: Axes, times: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """The detailed run, for the machines in colour."""
    for k, column in enumerate(values.T[: len(PALETTE)]):
        label = "detailed run" if k == 0 else None
        axes.plot(times, column, color="#000000", linewidth=0.7, linestyle="--", label=label)


def _draw_background(axes: Axes, times: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """All columns of `values` in grey, as one artist."""
    from matplotlib.collections import LineCollection

    lines = [np.column_stack([times, column]) for column in values.T]
    axes.add_collection(LineCollection(lines, colors=BACKGROUND_LINE, linewidths=0.6))
    axes.autoscale_view()


def _mark_events(axes: Axes, run: Trajectory) -> None:
    for piece, model in zip(run.run.pieces, run.models, strict=False):
        if model.state.faulted:
            axes.axvspan(piece.times[0], piece.times[-1], color=FAULT_SHADE, linewidth=0)
        elif piece.times[0] > 0:
            axes.axvline(piece.times[0], color="#999999", linewidth=0.8, linestyle=":")
