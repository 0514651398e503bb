"""Groups of options in the signature of a command."""

from __future__ import annotations

from dataclasses import dataclass
from inspect import signature
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

import gridfold as gf
from gridfold.cli.option_groups import flat, given, refuse


@dataclass(frozen=True)
class Inner:
    depth: Annotated[int | None, typer.Option(help="Depth (m).")] = None


@dataclass(frozen=True, kw_only=True)
class Outer:
    width: Annotated[float, typer.Option()] = 2.0
    inner: Inner
    file_name: Annotated[str | None, typer.Option("--file-name", rich_help_panel="Files")] = None


def command(place: Annotated[str, typer.Argument()], group: Outer, last: bool = False) -> None:
    """Tell what there is."""
    typer.echo(f"{place} {group.width:g} {group.inner.depth} {group.file_name} {last}")


def run(*arguments):
    app = typer.Typer()
    app.command()(flat(command))
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_the_fields_of_groups_are_options_of_the_command():
    result = run("here", "--depth", 3, "--file-name", "a", "--last")
    assert (result.exit_code, result.output) == (0, "here 2 3 a True\n")
    assert run("here").output == "here 2 None None False\n"


def test_the_signature_has_them_in_the_place_of_the_group():
    command_of_its_own = flat(command)
    assert list(signature(command_of_its_own).parameters) == [
        "place", "width", "depth", "file_name", "last",
    ]  # fmt: skip
    assert command_of_its_own.__doc__ == "Tell what there is."


def test_an_option_that_groups_share_is_an_error_of_the_programmer():
    def twice(one: Outer, two: Inner) -> None: ...

    with pytest.raises(ValueError, match="duplicate parameter name: 'depth'"):
        flat(twice)


def test_what_is_given_is_named_as_it_is_typed():
    group = Outer(inner=Inner(depth=0), file_name="a")
    assert given(group) == ["--width", "--depth", "--file-name"]
    assert given(Inner()) == []


def test_an_option_without_effect_is_refused():
    refuse(given(Inner()), "anything")
    with pytest.raises(gf.OptionError, match="--depth has no effect on the sea"):
        refuse(given(Inner(depth=1)), "the sea")
