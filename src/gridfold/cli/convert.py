"""The command that writes a case in another form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gridfold.cli.console import out
from gridfold.cli.options import CaseOptions
from gridfold.editing.editor import EDITED
from gridfold.editing.saving import write_case
from gridfold.errors import OptionError


def convert(
    source: CaseOptions,
    target: Annotated[
        Path | None,
        typer.Argument(
            help="What is written: a folder, NAME.raw (with NAME.dyr beside it), or NAME.dyr."
        ),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what is there already.")
    ] = False,
) -> None:
    """Write a case as a folder of tables or as files of PSS/E, with edits if any.

    What the files cannot hold of the case is told.

    Examples: gridfold convert grid.raw grid.dyr my-grid

              gridfold convert my-grid heavy.raw --edits heavy.toml
    """
    if target is None:  # without dynamic data the target stands in their place
        source, target = replace(source, dyr=None), source.dyr
    if target is None:
        raise OptionError("say what is written: gridfold convert SOURCE TARGET")
    case = source.load()
    lost = write_case(case, target, overwrite=overwrite, devices=source.device_models)
    counts = f"{len(case.buses)} buses, {len(case.devices)} devices"
    out.print(f"{target}: {case.name}, {counts}")
    for line in case.notices:
        if line.startswith(EDITED):
            out.print(line)
    for line in lost:
        out.print(f"not in the file: {line}", style="yellow")
