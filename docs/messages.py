"""Messages of gridfold as they stand in its sources, to hold the page about them against."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import gridfold
from gridfold import errors

#: What stands for a name or number in a text of the sources.
HOLE = "\0"
_SOURCES = Path(gridfold.__file__).parent
_ERRORS = {
    name
    for name, found in vars(errors).items()
    if isinstance(found, type) and issubclass(found, errors.GridfoldError)
}


@dataclass(frozen=True)
class Message:
    """The text of an exception in the sources.

    Parameters
    ----------
    where : str
        File and line.
    text : str
        The text, a `HOLE` for each value in it.
    """

    where: str
    text: str


def texts() -> set[str]:
    """Every text in the sources of gridfold."""
    return {
        text
        for path in _files()
        for node in ast.walk(_tree(path))
        if (text := _text(node)) is not None
    }


def raised() -> Iterator[Message]:
    """The first argument of every exception of gridfold that is raised, where it is a text."""
    for path in _files():
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                name, text = ast.unparse(node.exc.func), _text(node.exc.args[0])
                if name in _ERRORS and text is not None:
                    where = path.relative_to(_SOURCES).as_posix()
                    yield Message(f"{where}:{node.lineno}", text)


def families(page: str) -> list[str]:
    """Messages that the page explains: the code in the terms of its definitions."""
    terms = re.findall(r"^(`.*`)\n: ", page, re.MULTILINE)
    return [family for term in terms for family in re.findall(r"`([^`]+)`", term)]


def pattern(family: str) -> re.Pattern[str]:
    """What messages of a family look like; ``...`` stands for anything."""
    parts = [re.escape(part) for part in family.split("...") if part]
    return re.compile(".*".join(parts), re.DOTALL)


def letters(text: str) -> int:
    """How many letters there are."""
    return sum(map(str.isalpha, text))


def _files() -> list[Path]:
    return sorted(_SOURCES.rglob("*.py"))


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _text(node: ast.AST) -> str | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        parts = (v.value if isinstance(v, ast.Constant) else HOLE for v in node.values)
        return "".join(map(str, parts))
    return None
