"""The command that computes the case studies of Osipov & Sun."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from gridfold.cli.console import out, speaks_to_people, stage_bars, write_json_option
from gridfold.cli.options import JsonOption
from gridfold.dynamics.model import build_model
from gridfold.grid.events import BusFault
from gridfold.io.case_folder import read_case
from gridfold.paper import published
from gridfold.paper.calibrated import (
    calibrate_study,
    calibrated_rows,
    calibrated_study,
)
from gridfold.paper.record import Reproduction, system_facts
from gridfold.paper.runs import (
    OURS,
    PRINTED,
    BusRow,
    CaseStudy,
    Clearing,
    SmallRun,
    bus_row,
    bus_rows,
    prepare,
)
from gridfold.paper.tables import ADAPTIVE, table_2, table_3, table_4, verdicts
from gridfold.report.reproduction import reproduction_tables
from gridfold.report.reproduction_figures import plot_map, plot_rotor_angles, plot_switches
from gridfold.runs.clearing import critical_clearing_time


class Part(Enum):
    """What can be reproduced."""

    ALL = "all"
    TABLE1 = "table1"
    TABLE2 = "table2"
    TABLE3 = "table3"
    TABLE4 = "table4"
    FIG2 = "fig2"
    FIG3 = "fig3"
    FIG4 = "fig4"
    FIG5 = "fig5"


_FIGURES = (Part.FIG2, Part.FIG3, Part.FIG4, Part.FIG5)


def reproduce(
    part: Annotated[Part, typer.Argument(help="A table, a figure, or all of them.")] = Part.ALL,
    json: JsonOption = None,
    folder: Annotated[Path, typer.Option("--out", help="Folder for the figures.")] = Path(
        "gridfold-reproduction"
    ),
    clearing: Annotated[
        Clearing, typer.Option(help="Faults are cleared at our critical time, or the paper's.")
    ] = Clearing.OWN,
    calibration: Annotated[
        bool | None,
        typer.Option(
            help="Table I with thresholds of our own calibration too.", show_default="with all"
        ),
    ] = None,
) -> None:
    """Compute the tables and figures of Osipov & Sun on npcc, beside the paper's numbers.

    Example: gridfold reproduce all --json reproduction.json --out figures
    """
    study = prepare(build_model(read_case("npcc")))
    calibrated = part is Part.ALL if calibration is None else calibration
    result = _tables(study, part, clearing)
    if calibrated and result.table1 is not None:
        result = _calibrate(study, result, result.table1)
    write_json_option(json, result.record())
    if speaks_to_people(json):
        for table in reproduction_tables(result):
            out.print(table)
    for path in _figures(study, part, clearing, folder):
        if speaks_to_people(json):
            out.print(f"Drawn: {path}")


def _tables(study: CaseStudy, part: Part, clearing: Clearing) -> Reproduction:
    wanted = set(Part) if part is Part.ALL else {part}
    large = published.LARGE_DISTURBANCE_BUS
    rows = _first_table(study, clearing) if Part.TABLE1 in wanted else None
    second = None
    if Part.TABLE2 in wanted:
        found = {row.bus: row for row in rows or ()}
        row = found.get(large) or bus_row(study, large, clearing)
        second = tuple(table_2(row.errors))
    return Reproduction(
        system=system_facts(study),
        clearing=clearing,
        table1=None if rows is None else tuple(rows),
        table2=second,
        table3=table_3(study, clearing) if Part.TABLE3 in wanted else None,
        table3_printed=table_3(study, clearing, kinds=PRINTED) if Part.TABLE3 in wanted else None,
        table4=tuple(table_4(study, clearing)) if Part.TABLE4 in wanted else None,
        verdicts=None if rows is None else tuple(verdicts(rows)),
    )


def _calibrate(study: CaseStudy, result: Reproduction, rows: tuple[BusRow, ...]) -> Reproduction:
    """Add the calibrated thresholds, and Table I with them."""
    with stage_bars() as bars:
        calibration = calibrate_study(study, rows, lambda step: bars.show(*step))
    found = calibrated_study(study, calibration)
    return replace(
        result,
        calibration=calibration,
        system_calibrated=system_facts(found),
        table1=tuple(calibrated_rows(found, rows)),
    )


def _first_table(study: CaseStudy, clearing: Clearing) -> list[BusRow]:
    buses = tuple(published.TABLE_1)
    with stage_bars() as bars:
        return bus_rows(study, buses, clearing, on_done=bars.counter("Table I", len(buses)))


def _figures(study: CaseStudy, part: Part, clearing: Clearing, folder: Path) -> list[Path]:
    """Draw what was asked for; return the files."""
    wanted = _FIGURES if part is Part.ALL else tuple(item for item in _FIGURES if item is part)
    paths = {item: folder / f"{item.value}.png" for item in wanted}
    if Part.FIG3 in paths:
        plot_map(study, paths[Part.FIG3])
    if not paths.keys() - {Part.FIG3}:
        return list(paths.values())
    bus = published.LARGE_DISTURBANCE_BUS
    cleared = published.TABLE_1[bus].cct
    if clearing is Clearing.OWN:
        cleared = critical_clearing_time(study.model, BusFault(bus)).seconds
    events = [BusFault(bus, duration=cleared)]
    runs = {kind: study.run(kind, events) for kind in OURS}
    if Part.FIG2 in paths:
        plot_switches(study, [(kind, runs[kind]) for kind in ADAPTIVE], paths[Part.FIG2])
    for item, kind in zip((Part.FIG4, Part.FIG5), ADAPTIVE, strict=True):
        if item in paths:
            version = kind.value.removeprefix("adaptive_").replace("whole", "unpartitioned")
            plot_rotor_angles(
                study.detailed(events),
                runs[SmallRun.LINEAR].trajectory,
                runs[kind].trajectory,
                f"Fault at bus {bus}, cleared after {cleared:g} s: adaptive, {version}",
                paths[item],
            )
    return list(paths.values())
