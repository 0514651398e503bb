"""The report of a study: one page that needs no network.

The page is `page/page.html`; the figures are drawn in the browser, from the record of the study alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gridfold.io.study_store import StudyStore
from gridfold.report.filled_page import filled_page, write_page
from gridfold.report.study_record import study_record


def write_report(store: StudyStore, path: Path) -> None:
    """Write the report of a study as one HTML file.

    Parameters
    ----------
    store : StudyStore
        The results; the study may be unfinished.
    path : Path
        The page; a file that is there is replaced.

    Raises
    ------
    OutputError
        The page cannot be written, or the store cannot be read.
    """
    write_page(page(study_record(store)), path)


def page(record: dict[str, Any]) -> str:
    """The page of the record of a study."""
    return filled_page("page", f"{record['study']}: contingency study", record)
