"""The statements of a MATPOWER file: those that give tables are taken, all others are suspect.

What a statement does to another variable plays no part. What could change the case and is not
understood is refused with its line: calls, appended rows, single elements, second assignments,
branches and loops.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from gridfold.io.matlab_text import Kind, Statement, Token
from gridfold.io.matlab_values import FUNCTIONS, NotLiteralError, Table, strings
from gridfold.io.matpower_workspace import Workspace

#: Tables of the network that are read.
TABLES = ("bus", "gen", "branch", "dcline", "storage")
_BESIDE = {  # fields that no power flow depends on
    "version", "gencost", "dclinecost", "areas", "genfuel", "gentype", "reserves", "if", "iflims",
    "softlims", "order", "om", "success", "et", "iterations", "f", "userfcn", "A", "l", "u", "N",
    "fparm", "H", "Cw", "z0", "zl", "zu", "name", "casename", "source", "description",
}  # fmt: skip
_OTHER_NETWORKS = {  # of three phases, of direct current, of switches
    "bus3p", "line3p", "xfmr3p", "shunt3p", "load3p", "gen3p", "buslink", "busdc", "convdc",
    "branchdc", "switch", "ne_branch", "svc", "load", "shunt",
}  # fmt: skip
_PASSED_OVER = {"disp", "fprintf", "printf", "warning", "clc", "format", "more"}
_DANGEROUS = {"eval", "evalin", "evalc", "assignin", "run", "load", "source", "global", "error"}
_BLOCKS = {
    "if", "for", "parfor", "while", "do", "switch", "try", "unwind_protect", "function", "classdef",
}  # fmt: skip
_BLOCK_ENDS = {
    "end", "endif", "endfor", "endparfor", "endwhile", "until", "endswitch", "end_try_catch",
    "end_unwind_protect", "endfunction",
}  # fmt: skip
_EMPTY_TABLES = (["[", "]"], ["{", "}"])
_EMPTY_STRUCTS = (["struct"], ["struct", "(", ")"], *_EMPTY_TABLES)


@dataclass
class StatementReader:
    """Takes one statement after the other.

    `refused` has line and words of each statement that could change the case, `unread` the fields that
    are not known by their lines, `faults` what makes the file unreadable. `is_version_1` tells that the
    header promises tables by themselves, as in version 1 of the format.
    """

    workspace: Workspace = field(default_factory=Workspace)
    bus_names: tuple[str, ...] = ()
    refused: list[tuple[int, str]] = field(default_factory=list)
    unread: dict[int, str] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    is_version_1: bool = False
    _given: dict[str, int] = field(default_factory=dict)
    _ended: bool = False

    def read(self, found: Iterator[Statement]) -> None:
        """Take all statements up to the return."""
        for position, statement in enumerate(found):
            first = statement.tokens[0].text if statement.tokens[0].kind is Kind.NAME else ""
            if not statement.complete:
                self.faults.append(f"line {statement.line}: a bracket of this statement stays open")
            elif first == "function" and position == 0:
                self._header(statement)
            elif first == "return":
                return
            elif first in ("end", "endfunction") and not self._ended:
                self._ended = True
            elif first in _BLOCKS:
                self._block(statement, found)
            elif self._ended:
                self._refuse(statement, "follows the end of the function")
            else:
                self._take(statement)

    def _refuse(self, statement: Statement, why: str) -> None:
        self.refused.append((statement.line, f'"{statement}" {why}'))

    def _header(self, statement: Statement) -> None:
        """Take the name of the struct from ``function mpc = name``."""
        texts = [token.text for token in statement.tokens]
        results = texts[1 : texts.index("=")] if "=" in texts else []
        results = [text for text in results if text not in ("[", "]", ",")]
        if len(results) == 1:
            self.workspace.struct = results[0]
        else:
            self.is_version_1 = "bus" in results

    def _block(self, statement: Statement, rest: Iterator[Statement]) -> None:
        """A branch, a loop or a function up to its end; refused if it could change the case."""
        inside, depth = list(statement.tokens), 1
        while depth and (following := next(rest, None)) is not None:
            first = following.tokens[0]
            if first.kind is Kind.NAME:
                depth += (first.text in _BLOCKS) - (first.text in _BLOCK_ENDS)
            inside += following.tokens
        names = _names(inside)
        if names & {self.workspace.struct, "return", "function", *_DANGEROUS}:
            self._refuse(statement, f"and what follows up to line {inside[-1].line}")
        self.workspace.forget(names)

    def _take(self, statement: Statement) -> None:
        struct, names = self.workspace.struct, _names(statement.tokens)
        left, right = _sides(statement.tokens)
        within = any(token.text == "=" for token in (statement.tokens if right is None else right))
        if names & _DANGEROUS or (within and struct in names):
            self._refuse(statement, "could change the case")
        elif right is None or _is_command(left):
            self._command(statement)
        elif struct in _names(left):
            self._assign(statement, left, right)
        else:
            self.workspace.bind(left, right)

    def _command(self, statement: Statement) -> None:
        """A statement without an assignment."""
        first = statement.tokens[0]
        alone = len(statement.tokens) == 1
        if first.text == "define_constants" and alone:
            self.workspace.define_constants()
        elif first.text in _PASSED_OVER or first.kind is Kind.NUMBER:
            return
        elif first.text != self.workspace.struct or not alone:
            self._refuse(statement, "could change the case")

    def _assign(self, statement: Statement, left: Sequence[Token], right: Sequence[Token]) -> None:
        """An assignment to the struct, or to something within it."""
        texts, value = [token.text for token in left], [token.text for token in right]
        if len(left) == 1 and not self._given and value in _EMPTY_STRUCTS:
            return
        if texts[1:2] != ["."] or len(left) < 3 or left[2].kind is not Kind.NAME:
            self._refuse(statement, "is not one literal table")
        elif texts[2] in (*TABLES, "baseMVA", "bus_name"):
            self._known(statement, texts[2], left[3:], right)
        elif texts[2] in _OTHER_NETWORKS and value not in _EMPTY_TABLES:
            self._refuse(statement, "is of a kind that gridfold has no model for")
        elif texts[2] not in _BESIDE | _OTHER_NETWORKS:
            self.unread.setdefault(statement.line, f"{self.workspace.struct}.{texts[2]}")

    def _known(
        self, statement: Statement, name: str, index: Sequence[Token], right: Sequence[Token]
    ) -> None:
        """An assignment to a field that counts, or to columns of it."""
        try:
            if index:
                self.workspace.scale(name, index, right)
            elif name in self._given:
                line = self._given[name]
                self._refuse(statement, f"is a second assignment, after that in line {line}")
            else:
                self._given[name] = statement.line
                self._keep(name, right)
        except NotLiteralError as error:
            why = f": {error}" if str(error) else ""
            self._refuse(statement, f"is {'not evaluated' if index else 'not literal'}{why}")

    def _keep(self, name: str, right: Sequence[Token]) -> None:
        if name == "baseMVA":
            self.workspace.base_mva = _single(self.workspace.table(right))
        elif name == "bus_name":
            self.bus_names = strings(right)
        else:
            self.workspace.tables[name] = self.workspace.table(right)


def _names(tokens: Sequence[Token]) -> set[str]:
    """Names in these tokens that are no fields of a struct."""
    before = (None, *tokens)
    return {
        token.text
        for last, token in zip(before, tokens, strict=False)
        if token.kind is Kind.NAME and not (last and last.text == "." and last.kind is Kind.SYMBOL)
    }


def _sides(tokens: Sequence[Token]) -> tuple[Sequence[Token], Sequence[Token] | None]:
    """What stands left and right of the ``=`` outside brackets; right is None if there is none."""
    depth = 0
    for at, token in enumerate(tokens):
        if token.kind is Kind.SYMBOL:
            depth += (token.text in ("(", "[", "{")) - (token.text in (")", "]", "}"))
            if token.text == "=" and depth == 0 and at:
                return tokens[:at], tokens[at + 1 :]
    return tokens, None


def _is_command(left: Sequence[Token]) -> bool:
    """Whether this begins with two words, as in ``clear mpc``, or binds the name of a function."""
    words = [token.kind is Kind.NAME for token in left[:2]]
    return words == [True, True] or any(token.text in FUNCTIONS for token in left)


def _single(found: Table) -> float:
    if [len(row) for row in found.rows] != [1]:
        raise NotLiteralError("it is not one number")
    return found.rows[0][0]
