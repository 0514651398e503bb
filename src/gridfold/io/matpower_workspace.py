"""What is known within a MATPOWER file at one of its statements: tables, names of numbers, columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from gridfold.io.matlab_text import Kind, Token
from gridfold.io.matlab_values import CONSTANTS, NotLiteralError, Table, number, operand, table
from gridfold.io.matpower_columns import COLUMN_LISTS, DEFINED_CONSTANTS

_SCALINGS = ("*", ".*", "/", "./")
_MOST_COLUMNS = 100
_LONGEST_INDEX = 20  # tokens of an element such as mpc.bus(1, BASE_KV)


@dataclass
class Workspace:
    """The struct by its name in the file, its base power and tables, and variables that are numbers."""

    struct: str = "mpc"
    base_mva: float | None = None
    tables: dict[str, Table] = field(default_factory=dict)
    names: dict[str, float] = field(default_factory=lambda: dict(CONSTANTS))

    def define_constants(self) -> None:
        """Know all columns by their names, as after ``define_constants``."""
        self.names |= DEFINED_CONSTANTS

    def forget(self, names: Iterable[str]) -> None:
        """Know no longer what these variables are."""
        for name in names:
            self.names.pop(name, None)

    def bind(self, left: Sequence[Token], right: Sequence[Token]) -> None:
        """Keep a number, or names of columns; what else a variable may be is not known."""
        bound = [token.text for token in left if token.kind is Kind.NAME]
        value = self._value(right) if len(left) == 1 else None
        self.forget(bound)
        if left and left[0].text == "[" and len(right) == 1 and right[0].text in COLUMN_LISTS:
            self.names |= dict(zip(bound, COLUMN_LISTS[right[0].text], strict=False))
        elif value is not None and bound:
            self.names[bound[0]] = value

    def table(self, tokens: Sequence[Token]) -> Table:
        """A literal table; raises :class:`NotLiteralError`."""
        return table(self._resolved(tokens), self.names)

    def scale(self, name: str, index: Sequence[Token], right: Sequence[Token]) -> None:
        """Multiply or divide whole columns, as in ``mpc.bus(:, PD) = mpc.bus(:, PD) / 1e3``.

        Raises
        ------
        NotLiteralError
            It is anything else.
        """
        same = [self.struct, ".", name, *(token.text for token in index)]
        sign = right[len(same)].text if len(right) > len(same) else ""
        if [token.text for token in right[: len(same)]] != same or sign not in _SCALINGS:
            raise NotLiteralError
        factor = operand(self._resolved(right[len(same) + 1 :]), self.names)
        divided = "/" in sign
        if (divided and factor == 0) or name not in self.tables:
            raise NotLiteralError
        self.tables[name] = _scaled(self.tables[name], self._columns(index), factor, divided)

    def _columns(self, index: Sequence[Token]) -> list[int]:
        """Columns of ``(:, 3)`` or ``(:, [PD, QD])``, counted from 0."""
        if [token.text for token in index[:3]] != ["(", ":", ","] or index[-1].text != ")":
            raise NotLiteralError
        found = [cell for row in table(index[3:-1], self.names).rows for cell in row]
        if not all(cell in range(1, _MOST_COLUMNS) for cell in found):
            raise NotLiteralError
        return [int(column) - 1 for column in found]

    def _value(self, tokens: Sequence[Token]) -> float | None:
        try:
            return number(self._resolved(tokens), self.names)
        except NotLiteralError:
            return None

    def _resolved(self, tokens: Sequence[Token]) -> list[Token]:
        """The tokens with ``mpc.baseMVA`` and elements such as ``mpc.bus(1, BASE_KV)`` as numbers."""
        done: list[Token] = []
        at = 0
        while at < len(tokens):
            value, used = None, 0
            if tokens[at].text == self.struct:
                value, used = self._field(tokens[at : at + _LONGEST_INDEX])
            if value is None:
                done.append(tokens[at])
                at += 1
            else:
                done.append(Token(Kind.NUMBER, repr(value), tokens[at].line, tokens[at].spaced))
                at += used
        return done

    def _field(self, tokens: Sequence[Token]) -> tuple[float | None, int]:
        """The number that these tokens begin with, and how many of them tell it."""
        texts = [token.text for token in tokens]
        if texts[1:3] == [".", "baseMVA"] and texts[3:4] != ["("]:
            return self.base_mva, 3
        if texts[1:2] != ["."] or texts[3:4] != ["("] or ")" not in texts:
            return None, 0
        end = texts.index(")")
        return self._element(texts[2], tokens[4:end]), end + 1

    def _element(self, name: str, index: Sequence[Token]) -> float | None:
        """The number at ``row, column`` of a table; None if there is no such."""
        comma = next((at for at, token in enumerate(index) if token.text == ","), len(index))
        try:
            row, column = (number(part, self.names) for part in (index[:comma], index[comma + 1 :]))
        except NotLiteralError:
            return None
        rows = self.tables[name].rows if name in self.tables else ()
        if row not in range(1, len(rows) + 1) or column not in range(1, len(rows[0]) + 1):
            return None
        return rows[int(row) - 1][int(column) - 1]


def _scaled(found: Table, columns: Sequence[int], factor: float, divided: bool) -> Table:
    width = len(found.rows[0]) if found.rows else 0
    if len(set(columns)) < len(columns) or any(column >= width for column in columns):
        raise NotLiteralError
    rows = (
        tuple(
            (cell / factor if divided else cell * factor) if k in columns else cell
            for k, cell in enumerate(row)
        )
        for row in found.rows
    )
    return Table(tuple(rows), found.lines)
