"""How pictures look: one palette, safe for the colour-blind, and one way to save."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gridfold.errors import OptionError
from gridfold.io.results import replacing
from gridfold.report.plain import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Okabe & Ito, Color Universal Design, 2008.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
BACKGROUND_LINE = "#c8c8c8"
#: What lies behind curves while a fault is on.
FAULT_SHADE = "#f4d9c6"
FORMATS = (".png", ".svg")
#: Part of a picture's width that its title may take, and its lines.
_TITLE_WIDTH, _TITLE_LINES = 0.94, 6


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def put_title(figure: Figure, text: str) -> None:
    """Put a title above all panels, in lines that fit the picture; what is too long ends with dots."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.font_manager import FontProperties

    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer: Any = canvas.get_renderer()  # type: ignore[no-untyped-call]
    font = FontProperties(size="medium")
    room = _TITLE_WIDTH * figure.bbox.width

    def fits(line: str) -> bool:
        width, _, _ = renderer.get_text_width_height_descent(line, font, ismath=False)
        return bool(width <= room)

    lines = [line for part in text.split("\n") for line in _broken(visible(part), fits)]
    if len(lines) > _TITLE_LINES:
        lines = [*lines[: _TITLE_LINES - 1], lines[_TITLE_LINES - 1][:-3] + "..."]
    figure.suptitle("\n".join(lines).replace("$", r"\$"), fontproperties=font)


def _broken(text: str, fits: Callable[[str], bool]) -> list[str]:
    """A text in lines that fit, broken between words, and within one that is too long."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if fits(longer):
            lines[-1] = longer
            continue
        if lines[-1]:
            lines.append("")
        for letter in word:
            if lines[-1] and not fits(lines[-1] + letter):
                lines.append("")
            lines[-1] += letter
    return lines


def check_format(path: Path) -> None:
    """Raise :class:`OptionError` unless the picture's name ends in a known format."""
    if path.suffix.lower() not in FORMATS:
        raise OptionError(f"{path}: a picture is {' or '.join(FORMATS)}, not {path.suffix!r}")


def save_figure(figure: Figure, path: Path) -> None:
    """Save as PNG or SVG, by the file's ending."""
    check_format(path)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=150)
