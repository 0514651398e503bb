"""Commands that are imported when they are called: help and completion need names and one line each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup


@dataclass(frozen=True)
class Late:
    """Where a command is, and what the list of commands says of it.

    Parameters
    ----------
    module : str
        Module of :mod:`gridfold.cli`, which has a function of the command's name.
    line : str
        First line of that function's docstring.
    renamed : mapping
        Options that were called otherwise in the release before: old name to new name. They are
        accepted, told on standard error, and not listed.
    """

    module: str
    line: str
    renamed: Mapping[str, str] = field(default_factory=dict)


def late_group(commands: Mapping[str, Late]) -> type[TyperGroup]:
    """A group of `commands`, as the class that Typer asks for."""

    class LateGroup(TyperGroup):
        def __init__(self, **attributes: Any):
            super().__init__(**attributes)
            self.commands = {
                name: TyperCommand(name, help=late.line) for name, late in commands.items()
            }

        def get_command(self, ctx: Any, cmd_name: str) -> Any:
            return _load(cmd_name, commands[cmd_name].module) if cmd_name in commands else None

        def resolve_command(self, ctx: Any, args: list[str]) -> Any:
            name, command, rest = super().resolve_command(ctx, args)
            return name, command, _renamed(rest, commands[name].renamed) if name else rest

        def format_help(self, ctx: Any, formatter: Any) -> None:
            self._outline().format_help(ctx, formatter)

        def shell_complete(self, ctx: Any, incomplete: str) -> Any:
            return self._outline().shell_complete(ctx, incomplete)

        def _outline(self) -> TyperGroup:
            """The group with commands that are no more than a name and a line."""
            return TyperGroup(
                name=self.name,
                commands=dict(self.commands),
                params=self.params,
                help=self.help,
                epilog=self.epilog,
                rich_markup_mode=self.rich_markup_mode,
            )

    return LateGroup


def function_of(name: str, module: str) -> Callable[..., None]:
    """The function of a command, with the fields of its groups of options as parameters."""
    from gridfold.cli.option_groups import flat

    return flat(getattr(import_module(f"gridfold.cli.{module}"), name.replace("-", "_")))


def _load(name: str, module: str) -> Any:
    single = typer.Typer(rich_markup_mode="rich", add_completion=False)
    single.command(name)(function_of(name, module))
    return typer.main.get_command(single)


def _renamed(args: Sequence[str], renamed: Mapping[str, str]) -> list[str]:
    """Arguments with the present names of options."""
    result: list[str] = []
    for place, argument in enumerate(args):
        if argument == "--":
            return [*result, *args[place:]]
        name, equals, value = argument.partition("=")
        if name in renamed:
            typer.echo(
                f"{name} is called {renamed[name]} now; the next release knows it no more", err=True
            )
            name = renamed[name]
        result.append(name + equals + value)
    return result
