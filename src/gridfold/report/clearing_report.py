"""The report of a clearing-time map: one page that needs no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gridfold.io.clearing_store import ClearingStore
from gridfold.report.clearing_record import clearing_record
from gridfold.report.filled_page import filled_page, write_page


def write_clearing_report(record: dict[str, Any], path: Path) -> None:
    """Write the report of a record of :func:`clearing_record` as one HTML file.

    Raises
    ------
    OutputError
        The page cannot be written.
    """
    title = f"{record['case']}: critical clearing times"
    write_page(filled_page("clearing", title, record), path)


def write_report_of_folder(folder: Path, path: Path) -> None:
    """The same of the folder of a map, finished or not."""
    store = ClearingStore.read(folder)
    write_clearing_report(clearing_record(store.identity, store.rows()), path)
