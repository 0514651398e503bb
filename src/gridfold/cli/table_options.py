"""Options that write rows of results as tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gridfold.cli.console import err
from gridfold.cli.study import output_option
from gridfold.errors import OptionError
from gridfold.io.results import write_csv, write_parquet
from gridfold.io.spreadsheet import formula_cells, without_formulas

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class TableOptions:
    """Tables that are written of all rows."""

    csv: Annotated[Path | None, output_option(help="Write all rows as CSV.")] = None
    csv_safe: Annotated[
        bool,
        output_option("--csv-safe", help="Put ' before texts that a spreadsheet would run."),
    ] = False
    parquet: Annotated[Path | None, output_option(help="Write all rows as Parquet.")] = None

    def __post_init__(self) -> None:
        if self.csv_safe and self.csv is None:
            raise OptionError("--csv-safe says how --csv writes; give --csv too")

    def write(self, frame: pd.DataFrame, notes: Mapping[str, Any]) -> None:
        """Write the tables that were asked for; `notes` go beside or into them."""
        if self.csv is not None:
            formulas = formula_cells(frame)
            write_csv(self.csv, without_formulas(frame) if self.csv_safe else frame, notes)
            self._tell_formulas(formulas)
        if self.parquet is not None:
            write_parquet(self.parquet, frame, notes)

    def _tell_formulas(self, count: int) -> None:
        if not count:
            return
        cells = "1 text" if count == 1 else f"{count} texts"
        if self.csv_safe:
            err.print(
                f"{self.csv}: {cells} that a spreadsheet would run as formulas begin with ' now"
            )
        else:
            err.print(
                f"warning: {self.csv}: a spreadsheet would run {cells} as formulas; --csv-safe "
                "defuses them",
                style="yellow",
            )
