"""The statements of a MATLAB or Octave file, as tokens with their lines; nothing is run.

Comments, also in blocks between ``%{`` and ``%}``, are left out, and lines that ``...`` continues are
joined. Lines of plain numbers within brackets, of which large tables consist, are read at once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto

Row = tuple[float, ...]


class Kind(Enum):
    """What a token is: ``ROWS`` are rows of numbers, ``NEWLINE`` the end of a line in brackets."""

    NUMBER = auto()
    NAME = auto()
    STRING = auto()
    SYMBOL = auto()
    NEWLINE = auto()
    ROWS = auto()


@dataclass(frozen=True)
class Token:
    """A token: `spaced` says whether space stands before it, `rows` are those of ``ROWS``."""

    kind: Kind
    text: str
    line: int
    spaced: bool = False
    rows: tuple[Row, ...] = ()

    def __str__(self) -> str:
        if self.kind is Kind.STRING:
            return "'" + self.text.replace("'", "''") + "'"
        return self.text


@dataclass(frozen=True)
class Statement:
    """A statement without the mark that ends it; `complete` unless a bracket stays open."""

    tokens: tuple[Token, ...]
    complete: bool = True

    @property
    def line(self) -> int:
        """Line on which it begins, counted from 1."""
        return self.tokens[0].line

    def __str__(self) -> str:
        """Its first line, or the beginning of it."""
        shown = [token for token in self.tokens[:_SHOWN] if token.line == self.line]
        text = " ".join("".join(" " * token.spaced + str(token) for token in shown).split())
        if len(text) <= _SHOWN and len(shown) == len(self.tokens):
            return text
        return f"{text[:_SHOWN].rstrip()} ..."


_SHOWN = 60
_BLOCK_BEGIN, _BLOCK_END = re.compile(r"\s*[%#]\{\s*"), re.compile(r"\s*[%#]\}\s*")
_COMMENT = re.compile(r"[%#]")
_PLAIN = re.compile(r"[0-9.eE+\- \t;,]+")
_TOKEN = re.compile(
    r"""(?P<space>[ \t\f\v]+)
    | (?P<continued>\.\.\..*)
    | (?P<comment>[%#].*)
    | (?P<number>(?:\d+(?:\.(?![*/\\^'.])\d*)?|\.\d+)(?:[eEdD][+-]?\d+)?)
    | (?P<name>[A-Za-z_]\w*)
    | (?P<double>"(?:[^"\\]|\\.|"")*")
    | (?P<symbol>[=~!<>]=|&&|\|\||\.[*/\\^']|.)""",
    re.VERBOSE,
)
_SINGLE = re.compile(r"'((?:[^']|'')*)'")
_OPEN, _CLOSE = {"(": ")", "[": "]", "{": "}"}, {")", "]", "}"}
_KEYWORDS = {"case", "if", "elseif", "while", "for", "switch", "return", "end"}


def statements(text: str) -> Iterator[Statement]:
    """The statements of `text` in their order."""
    tokens: list[Token] = []
    brackets: list[str] = []
    continued = False
    for number, line in enumerate(_without_blocks(re.split(r"\r\n|\n|\r", text)), start=1):
        if brackets == ["["] and not continued and (rows := _plain_rows(line)):
            tokens.append(Token(Kind.ROWS, "...", number, True, rows))
            continue
        first, continued = True, False
        for token in _tokens(line, number, tokens, brackets):
            if token.text == _CONTINUED and token.kind is Kind.SYMBOL:
                continued = True
                break
            if not brackets and token.kind is Kind.SYMBOL and token.text in (";", ","):
                if tokens:
                    yield Statement(tuple(tokens))
                tokens.clear()
                continue
            _follow(token, brackets)
            tokens.append(Token(token.kind, token.text, number, token.spaced or first))
            first = False
        if continued:
            continue
        if brackets:
            tokens.append(Token(Kind.NEWLINE, "", number, True))
        elif tokens:
            yield Statement(tuple(tokens))
            tokens.clear()
    if tokens:
        yield Statement(tuple(tokens), complete=not brackets)


_CONTINUED = "..."


def _without_blocks(lines: Sequence[str]) -> Iterator[str]:
    """The lines, those of comments in blocks empty; blocks may lie in one another."""
    depth = 0
    for line in lines:
        if _BLOCK_BEGIN.fullmatch(line):
            depth += 1
            yield ""
        elif depth:
            depth -= _BLOCK_END.fullmatch(line) is not None
            yield ""
        else:
            yield line


def _plain_rows(line: str) -> tuple[Row, ...]:
    """Rows of numbers that need no thought; none if there is anything else."""
    body = _COMMENT.split(line, maxsplit=1)[0]
    if not _PLAIN.fullmatch(body):
        return ()
    try:
        return tuple(_plain_row(part) for part in body.split(";") if part.strip())
    except ValueError:
        return ()


def _plain_row(text: str) -> Row:
    if "," not in text:
        return tuple(map(float, text.split()))
    return tuple(float(cell) for part in text.split(",") for cell in part.split() or [part])


def _tokens(
    line: str, number: int, before: Sequence[Token], brackets: Sequence[str]
) -> Iterator[Token]:
    """Tokens of a line; `before` and `brackets` are kept up by the caller while they are taken."""
    position, spaced = 0, False
    while position < len(line):
        if line[position] == "'" and not _is_transpose(spaced or not position, before, brackets):
            string = _SINGLE.match(line, position)
            if string:
                yield Token(Kind.STRING, string[1].replace("''", "'"), number, spaced)
                position, spaced = string.end(), False
                continue
        match = _TOKEN.match(line, position)
        if match is None or match.lastgroup == "comment":
            return
        position = match.end()
        if match.lastgroup == "space":
            spaced = True
            continue
        yield _token(match, number, spaced)
        spaced = False


def _token(match: re.Match[str], number: int, spaced: bool) -> Token:
    text = match[0]
    match match.lastgroup:
        case "number":
            return Token(Kind.NUMBER, text, number, spaced)
        case "name":
            return Token(Kind.NAME, text, number, spaced)
        case "double":
            return Token(Kind.STRING, text[1:-1], number, spaced)
        case "continued":
            return Token(Kind.SYMBOL, _CONTINUED, number, spaced)
    return Token(Kind.SYMBOL, text, number, spaced)


def _is_transpose(spaced: bool, before: Sequence[Token], brackets: Sequence[str]) -> bool:
    """Whether a quote after these tokens transposes; else it begins a string."""
    if not before or before[-1].kind in (Kind.NEWLINE, Kind.ROWS):
        return False
    last = before[-1]
    if spaced and (brackets and brackets[-1] != "("):
        return False
    if last.kind is Kind.NAME:
        return last.text not in _KEYWORDS
    return last.kind in (Kind.NUMBER, Kind.STRING) or last.text in (*_CLOSE, "'", ".'")


def _follow(token: Token, brackets: list[str]) -> None:
    if token.kind is not Kind.SYMBOL:
        return
    if token.text in _OPEN:
        brackets.append(token.text)
    elif brackets and token.text == _OPEN[brackets[-1]]:
        brackets.pop()
