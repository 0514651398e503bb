"""Options that say what a run has to fulfil."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from gridfold.grid.criteria import Criterion
from gridfold.io.criterion_records import load_criteria, parse_criterion

_criteria_option = partial(typer.Option, rich_help_panel="Criteria")


@dataclass(frozen=True)
class CriteriaOptions:
    """What a run has to fulfil."""

    criteria: Annotated[
        Path | None,
        _criteria_option(help="TOML file with \\[\\[criteria]] tables."),
    ] = None
    criterion: Annotated[
        list[str] | None,
        _criteria_option(
            help="Criterion as the name of a preset, such as 'damping at least 3 %', or as "
            '"KIND NAME=VALUE ..."; may be repeated.'
        ),
    ] = None

    def collect(self) -> tuple[Criterion, ...]:
        """All criteria, those of the file first."""
        from_file = () if self.criteria is None else load_criteria(self.criteria)
        return (*from_file, *map(parse_criterion, self.criterion or []))
