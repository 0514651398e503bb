"""gridfold beside PSS/E: all cases with trajectories that PSS/E computed; a table and two pictures.

Run by ``make bench-psse``; the comparison is that of the tests (``tests/beside_psse.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from beside_psse import ALLOWED, PART_OF_RANGE, STEP, STUDIES, Difference, compare, reference_path
from matplotlib.figure import Figure
from PIL import Image
from psse_causes import cause_table, exciter_table
from report import GENERATED, Table, machine, one_thread, write

from gridfold.report.style import PALETTE, new_figure, save_figure

#: Why a case is beyond a limit.
REASONS = {
    "sexs_te_zero": "step of PSS/E",
    "exst1": "step of PSS/E",
    "degov": "PowerWorld, another swing equation",
    "regca1_reference_flag": "step of PSS/E",
}
COLUMNS, LINES = 4, 5
#: Width and height of a picture in inches, its colours, and samples of a curve, a few for each pixel.
SIZE, COLOURS, DRAWN = (8.5, 9.5), 32, 500

Found = dict[str, tuple[Difference, ...]]


def difference_table(found: Found) -> Table:
    """All columns of all cases."""
    rows = [
        (
            name,
            one.column,
            f"{one.largest:.1e}",
            f"{one.allowed:.1e}",
            f"{one.largest / one.range:.2%}" if one.range > 1e-6 else "",
            "met" if one.met else f"not met: {REASONS[name]}",
        )
        for name, columns in found.items()
        for one in columns
    ]
    return Table(
        "Largest difference, but for the 15 ms around the event:",
        ("case", "column", "difference", "limit", "of the range", "verdict"),
        rows,
    )


def first_columns(found: Found) -> list[Difference]:
    """Of each case the column that moves it: field voltage of exciters, else the first one."""
    chosen = []
    for columns in found.values():
        fields = [one for one in columns if one.kind == "field_voltage"]
        chosen.append((fields or list(columns))[0])
    return chosen


def draw_curves(shown: Sequence[Difference]) -> None:
    """Both curves of one column of each case."""
    figure = new_figure(*SIZE)
    for axes, one in zip(figure.subplots(LINES, COLUMNS).flat, shown, strict=True):
        rows = _thinned(one)
        axes.plot(
            one.times[rows], one.reference[rows], color="#b0c8e0", linewidth=3, label="reference"
        )
        axes.plot(
            one.times[rows], one.ours[rows], color=PALETTE[1], linewidth=0.9, label="gridfold"
        )
        axes.set_title(f"{one.case}\n{one.column}", fontsize="x-small")
        axes.tick_params(labelsize="x-small")
        axes.ticklabel_format(useOffset=False)
    figure.supxlabel("time, s")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    _save(figure, GENERATED / "psse_curves.png")


def draw_differences(found: Found) -> None:
    """Differences over their limits, all columns of each case."""
    figure = new_figure(*SIZE)
    for axes, columns in zip(figure.subplots(LINES, COLUMNS).flat, found.values(), strict=True):
        for k, one in enumerate(columns):
            rows = _thinned(one)
            error = np.where(one.kept, (one.ours - one.reference) / one.allowed, np.nan)
            label = one.column.partition(":")[0]
            axes.plot(one.times[rows], error[rows], color=PALETTE[k], linewidth=0.8, label=label)
        axes.axhspan(-1, 1, color="#f0f0f0", zorder=0)
        largest = max(1.1, *(1.05 * one.largest / one.allowed for one in columns))
        axes.set_ylim(-largest, largest)
        axes.set_title(columns[0].case, fontsize="x-small")
        axes.tick_params(labelsize="x-small")
    figure.supxlabel("time, s")
    figure.supylabel("gridfold less the reference, over the limit")
    _save(figure, GENERATED / "psse_differences.png")


def _save(figure: Figure, path: Path) -> None:
    """Save with few colours, so that the file is small."""
    save_figure(figure, path)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(COLOURS)
    small.save(path, optimize=True)


def _thinned(one: Difference) -> np.ndarray:
    """Positions of the samples that are drawn: all near the event, fewer later."""
    every = max(1, len(one.times) // DRAWN)
    near = np.abs(one.times - 1.5) < 0.6
    return np.flatnonzero(near | (np.arange(len(one.times)) % every == 0))


def main() -> str:
    """Measure, draw and write the page; a message if the cases are absent."""
    missing = [name for name in STUDIES if not reference_path(name).is_file()]
    if missing:
        path = reference_path(missing[0])
        return f"{path} is absent; GRIDFOLD_CASES names the folder of public cases"
    found = {name: compare(study) for name, study in STUDIES.items()}
    draw_curves(first_columns(found))
    draw_differences(found)
    limits = ", ".join(f"{kind} {value:g}" for kind, value in ALLOWED.items())
    parts = (
        "# gridfold and PSS/E",
        f"{machine()} All of it: `make bench-psse`.",
        difference_table(found),
        f"gridfold steps by Runge-Kutta's method with {STEP * 1e3:g} ms. Limits: {limits}; all else "
        f"{PART_OF_RANGE:.0%} of the range of the reference.",
        cause_table(found),
        exciter_table(found),
    )
    print(*parts, sep="\n\n")
    write("psse.md", *parts)
    met = sum(one.met for columns in found.values() for one in columns)
    return f"{met} of {sum(map(len, found.values()))} columns are within their limits."


if __name__ == "__main__":
    one_thread()
    print(main())
