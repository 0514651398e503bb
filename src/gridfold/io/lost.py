"""What a file cannot hold of a case, told by kind."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Lost:
    """Collects what is not in a file, and of which records."""

    records: dict[str, list[str]] = field(default_factory=dict)

    def add(self, what: str, record: Any = "") -> None:
        """Note something; `record` is whose it is, if it is that of a record."""
        self.records.setdefault(what, []).extend([str(record)] if record != "" else [])

    @property
    def lines(self) -> tuple[str, ...]:
        """A line for each kind, with the number of records and the first of them."""
        return tuple(
            f"{what}: {records[0]}" + (f" and {len(records) - 1} more" if records[1:] else "")
            if records
            else what
            for what, records in self.records.items()
        )
