"""Values of MATLAB's literal expressions: numbers, tables of numbers, lists of strings.

What is no literal, such as a call of a function, raises :class:`NotLiteralError`. Names stand for
numbers that the caller knows. In brackets a space separates, as in MATLAB: ``[1 -2]`` are two numbers,
``[1 - 2]`` is one.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gridfold.io.matlab_text import Kind, Row, Token

#: Numbers that have a name in MATLAB and Octave.
CONSTANTS = {
    **dict.fromkeys(("Inf", "inf"), math.inf),
    **dict.fromkeys(("NaN", "nan"), math.nan),
    "pi": math.pi,
    "true": 1.0,
    "false": 0.0,
}
#: Functions of a number that may stand in an expression.
FUNCTIONS: Mapping[str, Callable[[float], float]] = {"sqrt": math.sqrt}
_SUMS: Mapping[str, Callable[[float, float], float]] = {"+": operator.add, "-": operator.sub}
_PRODUCTS: Mapping[str, Callable[[float, float], float]] = {
    "*": operator.mul,
    ".*": operator.mul,
    "/": operator.truediv,
    "./": operator.truediv,
}
_POWERS = ("^", ".^")
_DEEPEST = 50


class NotLiteralError(Exception):
    """The expression is no literal; says why, where there is more to say."""


@dataclass(frozen=True)
class Table:
    """A table of numbers, and the line of each row."""

    rows: tuple[Row, ...]
    lines: tuple[int, ...]


def number(tokens: Sequence[Token], names: Mapping[str, float]) -> float:
    """Value of an expression of numbers."""
    parser = _Parser(tokens, names)
    value = parser.sum()
    parser.finish()
    return value


def operand(tokens: Sequence[Token], names: Mapping[str, float]) -> float:
    """Value of what one ``*`` or ``/`` is followed by: a number, a power, an expression in brackets."""
    parser = _Parser(tokens, names)
    value = parser.signed()
    parser.finish()
    return value


def table(tokens: Sequence[Token], names: Mapping[str, float]) -> Table:
    """A table between brackets, transposed by a quote behind it, or a single number.

    Raises
    ------
    NotLiteralError
        It is anything else, or its rows are not of the same length.
    """
    if not tokens or tokens[0].text != "[":
        value = number(tokens, names)
        return Table(((value,),), (tokens[0].line,))
    parser = _Parser(tokens, names)
    found = parser.matrix()
    if parser.take("'", ".'"):
        found = _transposed(found)
    parser.finish()
    return found


def strings(tokens: Sequence[Token]) -> tuple[str, ...]:
    """The strings between braces, whatever separates them."""
    inner = [token for token in tokens[1:-1] if token.kind is not Kind.NEWLINE]
    braced = len(tokens) > 1 and tokens[0].text == "{" and tokens[-1].text == "}"
    if not braced or any(t.kind is not Kind.STRING and t.text not in (",", ";") for t in inner):
        raise NotLiteralError
    return tuple(token.text for token in inner if token.kind is Kind.STRING)


def _transposed(found: Table) -> Table:
    columns = tuple(zip(*found.rows, strict=True))
    return Table(columns, found.lines[:1] * len(columns))


class _Parser:
    """Recursive descent over tokens; `within` counts brackets in which a space separates."""

    def __init__(self, tokens: Sequence[Token], names: Mapping[str, float]):
        self.tokens, self.names = tokens, names
        self.position, self.depth, self.spaces_separate = 0, 0, False

    def next(self) -> Token | None:
        return self.tokens[self.position] if self.position < len(self.tokens) else None

    def take(self, *texts: str) -> Token | None:
        """The next token if it is one of these symbols."""
        token = self.next()
        if token is None or token.kind is not Kind.SYMBOL or token.text not in texts:
            return None
        self.position += 1
        return token

    def finish(self) -> None:
        if self.next() is not None:
            raise NotLiteralError

    def operator(self, *texts: str) -> Token | None:
        """The next token if it is one of these between two operands, not the sign of another number."""
        token = self.next()
        if token is not None and self.spaces_separate and token.spaced and token.text in _SUMS:
            after = self.tokens[self.position + 1 : self.position + 2]
            if after and not after[0].spaced:
                return None
        return self.take(*texts)

    def sum(self) -> float:
        value = self.product()
        while sign := self.operator(*_SUMS):
            value = _SUMS[sign.text](value, self.product())
        return value

    def product(self) -> float:
        value = self.signed()
        while sign := self.operator(*_PRODUCTS):
            value = _calculated(_PRODUCTS[sign.text], value, self.signed())
        return value

    def signed(self) -> float:
        """A power with its signs: ``-2^2`` is -4."""
        sign = self.signs()
        value = self.operand()
        while self.operator(*_POWERS):
            exponent = self.signs()
            value = _calculated(operator.pow, value, exponent * self.operand())
        return sign * value

    def signs(self) -> float:
        sign = 1.0
        while token := self.take("+", "-"):
            sign = -sign if token.text == "-" else sign
        return sign

    def operand(self) -> float:
        token = self.next()
        if token is None or self.depth > _DEEPEST:
            raise NotLiteralError
        self.position += 1
        if token.kind is Kind.NUMBER:
            return float(token.text.lower().replace("d", "e"))
        if token.kind is Kind.NAME and token.text in self.names:
            return self.names[token.text]
        if token.kind is Kind.NAME and token.text in FUNCTIONS and self.take("("):
            return _calculated(FUNCTIONS[token.text], self.bracketed())
        if token.kind is Kind.SYMBOL and token.text == "(":
            return self.bracketed()
        raise NotLiteralError

    def bracketed(self) -> float:
        before, self.spaces_separate = self.spaces_separate, False
        self.depth += 1
        value = self.sum()
        if not self.take(")"):
            raise NotLiteralError
        self.depth -= 1
        self.spaces_separate = before
        return value

    def matrix(self) -> Table:
        """Rows up to the bracket that closes them."""
        self.take("[")
        self.spaces_separate = True
        rows: list[Row] = []
        lines: list[int] = []
        while not self.take("]"):
            token = self.next()
            if token is None:
                raise NotLiteralError
            if token.kind is Kind.ROWS:
                self.position += 1
                rows += token.rows
                lines += [token.line] * len(token.rows)
            elif token.kind is Kind.NEWLINE or token.text == ";":
                self.position += 1
            else:
                lines.append(token.line)
                rows.append(self.row())
        self.spaces_separate = False
        _check_lengths(rows, lines)
        return Table(tuple(rows), tuple(lines))

    def row(self) -> Row:
        """Numbers up to the end of the row; a comma may follow the last one."""
        cells = [self.sum()]
        while (token := self.next()) is not None:
            if token.kind in (Kind.NEWLINE, Kind.ROWS) or token.text in (";", "]"):
                break
            comma = self.take(",")
            if not comma and not token.spaced:
                raise NotLiteralError
            token = self.next()
            if comma and token and (token.kind is Kind.NEWLINE or token.text in (";", "]")):
                break
            cells.append(self.sum())
        return tuple(cells)


def _calculated(function: Callable[..., float], *numbers: float) -> float:
    try:
        value = function(*numbers)
    except (ArithmeticError, ValueError) as error:
        raise NotLiteralError(str(error)) from None
    if isinstance(value, complex):
        raise NotLiteralError("a number is complex")
    return value


def _check_lengths(rows: Sequence[Row], lines: Sequence[int]) -> None:
    for row, line in zip(rows, lines, strict=True):
        if len(row) != len(rows[0]):
            raise NotLiteralError(
                f"its row in line {line} has {len(row)} numbers, the first one {len(rows[0])}"
            )
