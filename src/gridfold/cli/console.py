"""What all commands share: terminals, progress bars, options as text."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from gridfold.cli.exit_codes import ExitCode
from gridfold.io.results import write_json
from gridfold.report.plain import PlainConsole, visible
from gridfold.report.tables import basis_facts, doubt_lines, facts_table
from gridfold.runs.basis import Basis
from gridfold.systems.status import Status

out = PlainConsole(highlight=False)
err = PlainConsole(stderr=True, highlight=False)


def exit_code(status: Status, violated: bool = False) -> ExitCode:
    """Exit code that tells how a run ended, and whether one that was completed violates a criterion."""
    if violated and status is Status.COMPLETED:
        return ExitCode.VIOLATED
    return {
        Status.COMPLETED: ExitCode.COMPLETED,
        Status.LOST_SYNCHRONISM: ExitCode.LOST_SYNCHRONISM,
        Status.OFF_SPEED: ExitCode.LOST_SYNCHRONISM,
    }.get(status, ExitCode.FAILED)


def write_json_option(path: str | None, data: Mapping[str, Any] | list[Any]) -> None:
    """Write JSON to a file, or to standard output for ``-``."""
    if path == "-":
        sys.stdout.write(json.dumps(data, indent=2, allow_nan=False) + "\n")
    elif path is not None:
        write_json(Path(path), data)


def speaks_to_people(json_path: str | None) -> bool:
    """Whether tables go to standard output: not if JSON goes there."""
    return json_path != "-"


def say_method(reason: str | None) -> None:
    """Tell which integration rule was chosen, and why."""
    out.print(f"Method {reason}", style="dim")


def say_doubts(doubts: Sequence[str]) -> None:
    """Tell what speaks against the time step."""
    for doubt in doubts:
        out.print(f"warning: {doubt}", style="yellow")


def say_model(name: str, reason: str | None) -> None:
    """Tell which model was chosen, and why; nothing where the user chose it."""
    if reason is not None:
        out.print(f"Model {name}: {reason}", style="dim")


def say_approximate(columns: Sequence[str]) -> None:
    """Tell which columns are about what a reduced model stands for."""
    if columns:
        others = f" and {len(columns) - 1:,} more columns lie" if len(columns) > 1 else " lies"
        out.print(
            f"{columns[0]}{others} outside the study area, for which a reduced model stands: "
            "approximate (--model detailed is exact there).",
            style="yellow",
        )


def say_basis(basis: Basis, doubts: int = 1) -> None:
    """Tell what a result rests on beside the data, and whether that is validated.

    Of the kinds of doubts about data the first few are shown.
    """
    for line in (*basis.warnings, *doubt_lines(basis.data_doubts, doubts)):
        out.print(f"warning: {line}", style="yellow")
    out.print(facts_table(basis_facts(basis)))
    if not basis.validated:
        text = f"not validated: {'; '.join(basis.reasons)}"
        out.print(text, style="bold yellow")


class QuietProgress(Progress):
    """Bars that print nothing where they are disabled; before rich 15 they end in an empty line."""

    def stop(self) -> None:
        """End the display, if there is one."""
        if not self.disable:
            super().stop()


@contextmanager
def count_bar(what: str) -> Iterator[Callable[[bool, int, int, str], None]]:
    """A bar of counts with the time left on standard error; silent where that is no terminal.

    What it yields shows whether the work is being prepared, how many of `what` are done, of how many,
    and a text.
    """
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.fields[counts]}", markup=False),
        TimeRemainingColumn(),
    )
    with QuietProgress(*columns, console=err, transient=True, disable=not err.is_terminal) as bars:
        task = bars.add_task("preparing", total=None, counts="")

        def show(preparing: bool, done: int, total: int, counts: str) -> None:
            bars.update(
                task,
                description="off-line work" if preparing else what,
                total=total or None,
                completed=done,
                counts="" if preparing else counts,
            )

        yield show


class StageBars:
    """Progress bars, one for each stage."""

    def __init__(self, progress: Progress):
        self.progress = progress
        self._tasks: dict[str, TaskID] = {}

    def show(self, stage: str, done: int, total: int) -> None:
        """Show how many steps of a stage are done."""
        if stage not in self._tasks:
            self._tasks[stage] = self.progress.add_task(visible(stage), total=total)
        self.progress.update(self._tasks[stage], completed=done, total=total)

    def counter(self, stage: str, total: int) -> Callable[[object], None]:
        """Show a stage; what is returned is called after each of its steps."""
        self.show(stage, 0, total)
        return lambda _: self.progress.advance(self._tasks[stage])


@contextmanager
def stage_bars() -> Iterator[StageBars]:
    """Bars on standard error that vanish at the end; nothing if that is not a terminal."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with QuietProgress(
        *columns, console=err, transient=True, disable=not err.is_terminal
    ) as progress:
        yield StageBars(progress)
