"""Commands about the results of a study: show, report, check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gridfold.cli.console import err, out, write_json_option
from gridfold.cli.exit_codes import ExitCode
from gridfold.cli.options import JsonOption
from gridfold.cli.study import StudyFolder
from gridfold.cli.table_options import TableOptions
from gridfold.errors import OptionError
from gridfold.io.clearing_store import holds_clearing_times
from gridfold.io.study_repair import check_store, repair_store
from gridfold.io.study_store import StudyStore
from gridfold.report.clearing_report import write_report_of_folder
from gridfold.report.result_tables import result_tables
from gridfold.report.study_report import write_report
from gridfold.report.study_tables import (
    count_line,
    damage_lines,
    study_counts,
    study_facts,
)
from gridfold.report.tables import facts_table

_CHECK_HELP = """Read all of a study's results and say which are whole.

With --repair the folder gets a new file with those that are, the damaged one stays beside it, and
gridfold run --resume does the others anew.

Example: gridfold check study.results --repair

Exit codes: 0 all is whole, or repaired; 1 something is damaged; 2 nothing can be read.
"""


def show(
    folder: StudyFolder,
    sort: Annotated[
        str | None, typer.Option(help="Column to sort by.", show_default="number")
    ] = None,
    descending: Annotated[bool, typer.Option("--descending", help="The largest first.")] = False,
    where: Annotated[
        str | None,
        typer.Option(help="Condition in SQL, such as 'stable = 0 AND lowest_voltage < 0.8'."),
    ] = None,
    columns: Annotated[
        str, typer.Option(help="Columns of the table, by commas; all: every one.")
    ] = "",
    limit: Annotated[int, typer.Option(min=1, help="Rows of the table.")] = 40,
    *,
    tables: TableOptions,
    json: JsonOption = None,
) -> None:
    """Show the results of a study, also while it runs.

    Example:

      gridfold show study.results --where "stable = 1" --sort lowest_voltage
    """
    with StudyStore.read(folder) as store:
        _warn_of_damage(store)
        frame = store.frame(where, sort, descending)
        about, counts = store.identity, study_counts(store)
        if json != "-":
            out.print(facts_table(study_facts(store)))
        chosen = [name.strip() for name in columns.split(",") if name.strip()]
        if unknown := [name for name in chosen if name not in (*store.columns, "all")]:
            known = ", ".join(store.columns)
            raise OptionError(f"there is no column {unknown[0]!r}; there are: {known}")
        wanted = list(store.columns) if chosen == ["all"] else chosen
    told = ("gridfold", "sources", "case", "fingerprint", "files", "study", "settings")
    notes = {key: about[key] for key in told if key in about} | {"counts": counts.record()}
    tables.write(frame, notes)
    if json is not None:
        rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
        write_json_option(json, notes | {"results": rows})
    if json != "-":
        for table in result_tables(frame, limit, out.width, wanted):
            out.print(table)
        out.print(count_line(len(frame), limit, counts))


def report(
    folder: StudyFolder,
    file: Annotated[
        Path | None, typer.Option("--out", help="The page.", show_default="FOLDER/report.html")
    ] = None,
) -> None:
    """Write the report of a study or of clearing times: one page that needs no network.

    Examples: gridfold report study.results --out monday.html

              gridfold report npcc.cct
    """
    target = folder / "report.html" if file is None else file
    if holds_clearing_times(folder):
        write_report_of_folder(folder, target)
    else:
        with StudyStore.read(folder) as store:
            write_report(store, target)
            _warn_of_damage(store)
    out.print(f"{target} is written")


def check(
    folder: StudyFolder,
    repair: Annotated[
        bool, typer.Option("--repair", help="Keep what is whole; the rest is done anew.")
    ] = False,
    json: JsonOption = None,
) -> None:
    """Read all of a study's results and say which are whole."""
    found = check_store(folder)
    record = {
        "contingencies": found.contingencies,
        "results": found.results,
        "unsealed": found.unsealed,
        "damage": [{"what": d.what, "why": d.why, "number": d.number} for d in found.damage],
    }
    mended = repair_store(folder) if repair and found.damage else None
    if mended is not None:
        record["repaired"] = {"kept": mended.kept, "damaged_file": str(mended.damaged_file)}
    write_json_option(json, record)
    if json != "-":
        facts = {
            "Whole": f"{found.results} results of {found.contingencies} contingencies",
            "Damaged": str(len(found.damage)) if found.damage else "nothing",
        }
        if found.unsealed:
            facts["Unsealed"] = (
                f"{found.unsealed} results are of a version that sealed none: a changed digit in them "
                "cannot be told"
            )
        if mended is not None:
            facts["Repaired"] = (
                f"{mended.kept} results are kept; gridfold run --resume does the rest"
            )
            facts["Damaged file"] = str(mended.damaged_file)
        out.print(facts_table(facts))
        for line in damage_lines(found.damage, folder):
            out.print(line, style="yellow")
    raise typer.Exit(ExitCode.FAILED if found.damage and mended is None else ExitCode.COMPLETED)


check.__doc__ = _CHECK_HELP


def _warn_of_damage(store: StudyStore) -> None:
    for line in damage_lines(store.damage, store.folder):
        err.print(f"warning: {line}", style="yellow")
