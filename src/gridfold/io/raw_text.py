"""Numbers, names and ids as they stand in a RAW file that is written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gridfold.io.lost import Lost
from gridfold.io.raw_fields import split_fields

#: Letters of a name, of an id and of a title that PSS/E reads.
_NAME, _ID, _TITLE = 12, 2, 60


def flag(record: Any) -> int:
    """Whether a record is in service."""
    return int(record.in_service)


def real(value: float) -> str:
    """A number that is read back as it is."""
    return repr(float(value))


def reals(*values: float) -> str:
    """Numbers one comma apart."""
    return ",".join(map(real, values))


def title(text: str) -> str:
    """A line of title."""
    return " ".join(text.split())[:_TITLE]


@dataclass(frozen=True)
class Texts:
    """Texts in quotes; what cannot stand there is noted in `lost`."""

    lost: Lost

    def name(self, text: str, record: Any) -> str:
        """A name, of at most twelve letters, of what is called `record` in messages."""
        held = " ".join(text.split())
        if len(held) > _NAME:
            self.lost.add(f"letters of names beyond {_NAME}", record)
            held = held[:_NAME].rstrip()
        written = f"'{held}'"
        if not _is_read(written, held):
            self.lost.add("quotes in names", record)
            written = "'" + held.replace("'", " ").strip() + "'"
        return written

    def identifier(self, text: str, record: Any) -> str:
        """An id of a unit, a load, a shunt or a circuit."""
        if len(text) > _ID:
            self.lost.add(f"ids of more than {_ID} letters, which PSS/E cuts", record)
        return f"'{text}'"


def _is_read(written: str, text: str) -> bool:
    try:
        return split_fields(f"{written},1")[0].text == text
    except ValueError:
        return False
