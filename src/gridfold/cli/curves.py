"""Commands about curves that are there: plot, compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gridfold.cli.console import out, speaks_to_people, write_json_option
from gridfold.cli.options import JsonOption
from gridfold.errors import OptionError
from gridfold.io.run_tables import RunTable, is_run_table, read_run_table
from gridfold.io.study_store import StudyStore
from gridfold.report.comparison import (
    difference_table,
    draw_figures,
    figure_table,
    names_line,
    verdict_table,
)
from gridfold.report.curves import RunCurves, draw_both, draw_curves, table_curves
from gridfold.report.style import check_format, save_figure
from gridfold.report.tables import facts_table
from gridfold.runs.monitor.differences import at_times, differences
from gridfold.runs.monitor.table_choice import TableChoice, choose_columns
from gridfold.study.compare import compare_studies

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MonitorArgument = Annotated[
    str | None,
    typer.Argument(
        help="What is shown, such as 'flow 101-103, voltage area:1'.", show_default="all columns"
    ),
]


def plot(
    table: Annotated[Path, typer.Argument(help="Table of a run (.csv or .parquet).")],
    monitor: MonitorArgument = None,
    pictures: Annotated[
        list[Path] | None, typer.Option("--out", help="The picture (.png or .svg).")
    ] = None,
) -> None:
    """Draw the table of a run that simulate or a study has written.

    Example: gridfold plot run.parquet "voltage 1001-1050, flow 101-103" --out run.png
    """
    targets = pictures or [Path(f"{table.with_suffix('')}.png")]
    for picture in targets:
        check_format(picture)
    found = read_run_table(table)
    figure = draw_curves(_curves(found, _choice(found, monitor)))
    for picture in targets:
        save_figure(figure, picture)
        out.print(f"{picture} is written")


def compare(
    first: Annotated[Path, typer.Argument(help="Table of a run, or folder of a study.")],
    second: Annotated[Path, typer.Argument(help="Another one.")],
    monitor: MonitorArgument = None,
    pictures: Annotated[
        list[Path] | None, typer.Option("--out", help="A picture (.png or .svg).")
    ] = None,
    limit: Annotated[int, typer.Option(min=1, help="Rows of each table.")] = 20,
    json: JsonOption = None,
) -> None:
    """Compare two runs, or two studies: where they differ most.

    The contingencies of studies are matched by name. Differences are second less first.

    Examples: gridfold compare detailed.parquet reduced.parquet "voltage area:1" --out both.png

              gridfold compare before.results after.results
    """
    for picture in pictures or []:
        check_format(picture)
    runs = [is_run_table(path) for path in (first, second)]
    if runs[0] != runs[1]:
        raise OptionError("give two tables of runs (.csv, .parquet), or two folders of studies")
    shown = _Shown(pictures or [], limit, json)
    if runs[0]:
        _compare_runs(first, second, monitor, shown)
    elif monitor is not None:
        raise OptionError(f"{monitor!r} says what is shown of runs: it has no effect on studies")
    else:
        _compare_studies(first, second, shown)


@dataclass(frozen=True)
class _Shown:
    """Where a comparison goes: pictures, tables of so many rows, JSON."""

    pictures: Sequence[Path]
    limit: int
    json: str | None

    @property
    def to_people(self) -> bool:
        return speaks_to_people(self.json)

    def save(self, figure: Figure) -> None:
        for picture in self.pictures:
            save_figure(figure, picture)
            if self.to_people:
                out.print(f"{picture} is written")


def _compare_runs(first: Path, second: Path, monitor: str | None, shown: _Shown) -> None:
    one, two = read_run_table(first), read_run_table(second)
    choice = _choice(one, monitor)
    common = tuple(name for name in choice.names if name in two.values)
    if not common:
        raise OptionError(f"{second} has none of the columns of {first} that are compared")
    curves = _curves(one, TableChoice(common, choice.every))
    others = {name: at_times(curves.times, two.times, two.values[name]) for name in common}
    found = differences(curves.times, curves.values, others)
    left_out = [name for name in choice.names if name not in two.values]
    write_json_option(
        shown.json,
        {
            "first": str(first),
            "second": str(second),
            "columns": [_finite(asdict(item)) for item in found],
            "missing_in_second": left_out,
        },
    )
    if shown.to_people:
        out.print(facts_table({"First": _told(one), "Second": _told(two)}))
        out.print(difference_table(found, shown.limit))
        if left_out:
            out.print(names_line(f"{len(left_out):,} columns are in the first alone", left_out))
    if shown.pictures:
        beside = RunCurves(second.name, curves.times, others)
        figure = draw_both(curves, beside, (f"{first}: {_told(one)}", f"{second}: {_told(two)}"))
        shown.save(figure)


def _compare_studies(first: Path, second: Path, shown: _Shown) -> None:
    with StudyStore.read(first) as one, StudyStore.read(second) as two:
        frames = one.frame(), two.frame()
    found = compare_studies(*frames)
    write_json_option(
        shown.json,
        {
            "first": str(first),
            "second": str(second),
            "common": len(found.common),
            "first_only": list(found.first_only),
            "second_only": list(found.second_only),
            "verdicts": [asdict(item) for item in found.verdicts],
            "figures": [_finite(asdict(item)) for item in found.figures],
        },
    )
    if shown.to_people:
        out.print(
            facts_table(
                {
                    "First": str(first),
                    "Second": str(second),
                    "In both": f"{len(found.common):,} contingencies, matched by name",
                    "Other verdict": f"{len(found.verdicts):,}" if found.verdicts else "none",
                }
            )
        )
        if found.verdicts:
            out.print(verdict_table(found.verdicts, shown.limit))
        out.print(figure_table(found.figures))
        for which, names in (("first", found.first_only), ("second", found.second_only)):
            if names:
                out.print(names_line(f"{len(names):,} are in the {which} alone", names))
    if shown.pictures:
        shown.save(draw_figures(*frames, found, (str(first), str(second))))


def _choice(table: RunTable, monitor: str | None) -> TableChoice:
    names = tuple(table.values)
    if not names:
        raise OptionError(f"{table.path} has no column beside the time")
    if monitor is None:
        return TableChoice(names)
    return choose_columns(names, table.columns_record, monitor)


def _curves(table: RunTable, choice: TableChoice) -> RunCurves:
    return table_curves(table, choice.names, choice.every)


def _told(table: RunTable) -> str:
    """What a table is of, as far as its metadata say."""
    told = [
        str(table.metadata[key]) for key in ("case", "model", "status") if key in table.metadata
    ]
    rows = f"{len(table.times):,} rows to {table.times[-1]:g} s"
    return f"{', '.join(told)}; {rows}" if told else rows


def _finite(record: dict[str, Any]) -> dict[str, Any]:
    """A record ready for JSON: what is no number is None."""
    return {key: _plain(value) for key, value in record.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value
