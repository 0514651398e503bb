"""The page of the command line, from the commands themselves."""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from inspect import Parameter, getdoc, signature
from pathlib import Path
from typing import Any

from rich.markup import render
from typer.models import ArgumentInfo, OptionInfo

from gridfold.cli.app import COMMANDS
from gridfold.cli.exit_codes import EXIT_CODES
from gridfold.cli.late_commands import function_of

_HEAD = "| Name | Values | Default | Meaning |\n| --- | --- | --- | --- |"
_TYPES = {int: "whole number", float: "number", str: "text", Path: "file"}


@dataclass(frozen=True)
class Command:
    """A command as its help tells it.

    Parameters
    ----------
    name : str
        What stands behind ``gridfold``.
    words : sequence of str
        Paragraphs of its description.
    examples : sequence of str
        Whole command lines.
    panels : dict
        Rows of each group of options, in the order of the help: name, values, default, meaning.
    """

    name: str
    words: Sequence[str]
    examples: Sequence[str]
    panels: dict[str, list[tuple[str, str, str, str]]]


def commands() -> Iterator[Command]:
    """All commands, in the order of the help."""
    for name, late in COMMANDS.items():
        function = function_of(name, late.module)
        words, examples = _description(getdoc(function) or "")
        words += [f"{old} is an older name of {new}." for old, new in late.renamed.items()]
        yield Command(name, words, examples, _panels(function))


def page() -> str:
    """Sections of all commands in Markdown."""
    return "\n".join(_section(command) for command in commands())


def _description(text: str) -> tuple[list[str], list[str]]:
    """Paragraphs and examples of a docstring; exit codes are the same for all commands."""
    words, examples = [], []
    for paragraph in re.split(r"\n\s*\n", _plain(text)):
        head, colon, rest = paragraph.strip().partition(":")
        inside = rest if colon and head in ("Example", "Examples") else paragraph
        if inside.strip().startswith("gridfold "):
            examples += [" ".join(line.split()) for line in inside.strip().splitlines()]
        elif (told := " ".join(inside.split())) and told != EXIT_CODES:
            words.append(told)
    return words, examples


def _panels(function: Callable[..., None]) -> dict[str, list[tuple[str, str, str, str]]]:
    panels: dict[str, list[tuple[str, str, str, str]]] = {"Arguments": [], "Options": []}
    for parameter in signature(function, eval_str=True).parameters.values():
        kind, info = typing.get_args(parameter.annotation)
        if not info.hidden:
            place = "Arguments" if isinstance(info, ArgumentInfo) else "Options"
            row = _row(parameter, kind, info)
            panels.setdefault(info.rich_help_panel or place, []).append(row)
    return {title: rows for title, rows in panels.items() if rows}


def _row(parameter: Parameter, kind: Any, info: Any) -> tuple[str, str, str, str]:
    names = [parameter.name.upper()]
    if isinstance(info, OptionInfo):
        # Of an option in an annotation Typer takes the first name for its default.
        given = [name for name in (info.default, *info.param_decls) if isinstance(name, str)]
        names = given or ["--" + parameter.name.replace("_", "-")]
    if isinstance(kind, types.UnionType):
        kind = next(one for one in typing.get_args(kind) if one is not type(None))
    words = _escaped(_plain(info.help or ""))
    if typing.get_origin(kind) is list:
        (kind,) = typing.get_args(kind)
        words += "" if "repeated" in words else " May be repeated."
    values = _escaped(info.metavar) if info.metavar else _values(kind, info.min)
    return ", ".join(f"`{name}`" for name in names), values, _default(parameter, info), words


def _values(kind: Any, low: float | None) -> str:
    if kind is bool:
        return ""
    if issubclass(kind, Enum):
        return " / ".join(f"`{member.value}`" for member in kind)
    return _TYPES[kind] if low is None else f"{_TYPES[kind]} ≥ {low:g}"


def _default(parameter: Parameter, info: Any) -> str:
    if isinstance(info.show_default, str):
        return _escaped(info.show_default)
    value = parameter.default
    if value is Parameter.empty:
        return "required"
    if value is None or value is False:
        return ""
    if isinstance(value, Enum):
        return f"`{value.value}`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _section(command: Command) -> str:
    parts = [f"## `gridfold {command.name}`", *map(_escaped, command.words)]
    if command.examples:
        parts.append("\n".join(["```bash", *command.examples, "```"]))
    for title, rows in command.panels.items():
        lines = "\n".join("| " + " | ".join(row) + " |" for row in rows)
        parts.append(f"**{title}**\n\n{_HEAD}\n{lines}")
    return "\n\n".join(parts) + "\n"


def _plain(text: str) -> str:
    """Without the markup that colours the terminal."""
    return render(text).plain


def _escaped(text: str) -> str:
    return re.sub(r"([|*_<\[\]])", r"\\\1", " ".join(text.split()))
