"""How pictures look: one palette, safe for the colour-blind, and one way to save."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gridfold.errors import OptionError
from gridfold.io.results import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Okabe & Ito, Color Universal Design, 2008.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
BACKGROUND_LINE = "#c8c8c8"
FORMATS = (".png", ".svg")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def check_format(path: Path) -> None:
    """Raise :class:`OptionError` unless the picture's name ends in a known format."""
    if path.suffix.lower() not in FORMATS:
        raise OptionError(f"{path}: a picture is {' or '.join(FORMATS)}, not {path.suffix!r}")


def save_figure(figure: Figure, path: Path) -> None:
    """Save as PNG or SVG, by the file's ending."""
    check_format(path)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=150)
