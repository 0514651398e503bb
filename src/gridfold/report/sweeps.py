"""Pictures of sweeps: figures of merit along an option, in panels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gridfold.report.style import PALETTE, new_figure, save_figure


@dataclass(frozen=True)
class Curve:
    """One line of a panel.

    Parameters
    ----------
    label : str
        What the legend says.
    points : sequence of (float, float)
        Abscissae and ordinates; NaN where there is no value.
    color : int
        Place in the palette.
    dashed : bool
        Dashed with hollow markers.
    """

    label: str
    points: Sequence[tuple[float, float]]
    color: int = 0
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """A title, what the axes are, the curves, and whether the ordinates are logarithmic."""

    title: str
    across: str
    up: str
    curves: Sequence[Curve]
    logarithmic: bool = False


def plot_panels(panels: Sequence[Panel], path: Path) -> None:
    """Draw the panels one above the other, with a tick at each point of the first curve."""
    figure = new_figure(9, 3.0 * len(panels))
    rows = figure.subplots(len(panels), 1, squeeze=False)[:, 0]
    for axes, panel in zip(rows, panels, strict=True):
        for curve in panel.curves:
            style = ("--", "white") if curve.dashed else ("-", PALETTE[curve.color])
            axes.plot(
                *zip(*curve.points, strict=True),
                linestyle=style[0],
                marker="o",
                markersize=4,
                markerfacecolor=style[1],
                color=PALETTE[curve.color],
                label=curve.label,
            )
        if panel.logarithmic:
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0)
        axes.set_title(panel.title, fontsize="medium")
        axes.set_xlabel(panel.across)
        axes.set_ylabel(panel.up)
        axes.grid(color="#eeeeee")
        axes.set_xticks([x for x, _ in panel.curves[0].points])
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    save_figure(figure, path)
