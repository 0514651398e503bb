"""Fields of one line of a PSS/E RAW file, as PSS/E's free format has them.

Fields are separated by blanks, tabs and at most one comma; nothing between two commas, or before the
first one, is a field left blank. What follows a ``/`` is a comment. Texts may stand in quotes, and
names may have quotes within: ``'O'NEIL ~1'``. A quote ends a text where a separator follows it.
Numbers may have Fortran's exponent D.
"""

from __future__ import annotations

import re
from typing import NamedTuple

_ITEM = re.compile(r"\s*(?:(?P<comma>,)|(?P<end>/)|(?P<quote>['\"])|(?P<bare>[^\s,/]+))")
_WITH_COMMAS = re.compile(r"\s*[^\s,/'\"]*\s*,")
_ENDS = r"\s*(?:[,/]|$)"
_NUMBER_FOLLOWS = r"\s+[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?(?:[\s,/]|$)"
_TEXT_FOLLOWS = r"\s+['\"]"
_FORTRAN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))[dD]([+-]?\d+)")
#: Stands for a quote within a text in lines that are handed on; a code point for private use.
INNER_QUOTE = "\ue000"


class Field(NamedTuple):
    """A field: its text without quotes, and whether it had some."""

    text: str = ""
    quoted: bool = False

    @property
    def blank(self) -> bool:
        """Whether nothing was written: an empty text in quotes is a blank field too."""
        return not self.text.strip()

    @property
    def written(self) -> str:
        """The field as it may stand in a line of commas."""
        if not self.quoted:
            return self.text
        return "'" + self.text.replace("'", INNER_QUOTE) + "'"


def split_fields(line: str) -> list[Field]:
    """Fields of a line; raises :class:`ValueError` where a quote is not closed."""
    fields: list[Field] = []
    expected, position = True, 0
    while found := _ITEM.match(line, position):
        position = found.end()
        if found.lastgroup == "end":
            break
        if found.lastgroup == "comma":
            if expected:
                fields.append(Field())
            expected = True
            continue
        if found.lastgroup == "quote":
            text, position = _quoted(line, position, found["quote"])
            fields.append(Field(text, quoted=True))
        else:
            fields.append(Field(found["bare"]))
        expected = False
    return fields


def _quoted(line: str, start: int, quote: str) -> tuple[str, int]:
    """The text that begins at `start`, and the position behind its closing quote."""
    followers = [_ENDS, _NUMBER_FOLLOWS]
    if not _WITH_COMMAS.match(line):
        followers.append(_TEXT_FOLLOWS)
    closing = re.compile(f"{quote}(?=(?:{'|'.join(followers)}))").search(line, start)
    if closing is None:
        raise ValueError(f"a quote is not closed: {line[start - 1 :][:40]}")
    return line[start : closing.start()].replace(2 * quote, quote), closing.end()


def is_integer(text: str) -> bool:
    """Whether a field is written as a whole number, without a point."""
    return re.fullmatch(r"[+-]?\d+", text) is not None


def as_number(text: str) -> float | None:
    """Value of a field; None if it is no number."""
    try:
        return float(plain_number(text))
    except ValueError:
        return None


def plain_number(text: str) -> str:
    """A number with E for the exponent D of Fortran; any other text as it is."""
    return _FORTRAN.sub(r"\1E\2", text) if _FORTRAN.fullmatch(text) else text


def plain_real(text: str) -> str:
    """The same of a number with a point: what may be a text otherwise stays, such as ``1D2``."""
    return plain_number(text) if "." in text else text
