"""The page of the command line, and every command that the documentation prints."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import typer
from written_commands import commands

from gridfold.cli.app import COMMANDS, app

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    path
    for folder in ("docs", "examples")
    for path in (ROOT / folder).rglob("*.md")
    if not {"_build", "_generated", "generated"} & set(path.parts)
)

sys.path.insert(0, str(ROOT / "docs"))
import command_pages  # noqa: E402

GROUP = typer.main.get_command(app)
TOLD = {command.name: command for command in command_pages.commands()}


def parse(words):
    """Read a command's options as it would, without running it; what is wrong raises."""
    name, *rest = words
    assert name in COMMANDS, f"there is no command {name}"
    GROUP.get_command(None, name).make_context(name, rest)


def test_every_command_is_on_the_page_in_the_order_of_the_help():
    headings = [line for line in command_pages.page().splitlines() if line.startswith("## ")]
    assert headings == [f"## `gridfold {name}`" for name in COMMANDS]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_on_the_page_in_the_group_of_the_help(name):
    expected = {}
    for item in GROUP.get_command(None, name).params:
        if item.hidden or item.name == "help":
            continue
        argument = item.param_type_name == "argument"
        panel = item.rich_help_panel or ("Arguments" if argument else "Options")
        names = [item.name.upper()] if argument else item.opts
        expected.setdefault(panel, []).append(", ".join(f"`{n}`" for n in names))
    found = {title: [row[0] for row in rows] for title, rows in TOLD[name].panels.items()}
    assert found == expected
    assert all(row[3] for rows in TOLD[name].panels.values() for row in rows)


def test_values_and_defaults_are_those_of_the_command():
    rows = {row[0]: row for rows in TOLD["simulate"].panels.values() for row in rows}
    assert rows["`--method`"][1].startswith("`auto` / `rk4` / `abm4` / `trapezoidal`")
    assert rows["`--method`"][2] == "`auto`"
    assert rows["`--t-end`"][1:3] == ("number", "`16`")
    assert rows["`--loads`"][1:3] == (r"z\|raw\|P,I,Z", "`z`")
    assert rows["`CASE`"][2] == "required"
    assert rows["`--retain`"][1] == "whole number ≥ 0"
    assert rows["`--trip-bus`"][1:3] == ("", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_examples_that_it_understands(name):
    examples = commands("```bash\n" + "\n".join(TOLD[name].examples) + "\n```\n")
    assert name in [words[0] for words in examples]
    for words in examples:
        parse(words)


@pytest.mark.parametrize("path", [ROOT / "README.md", *PAGES], ids=lambda path: path.name)
def test_commands_of_a_page_have_options_that_there_are(path):
    for words in commands(path.read_text(encoding="utf-8")):
        if not words[0].startswith("--") and "--help" not in words:
            parse([word for word in words if word != "&"])


@pytest.mark.parametrize("path", [ROOT / "README.md", *PAGES], ids=lambda path: path.name)
def test_options_named_beside_a_command_are_its_own(path):
    """Also where a command is named in a sentence, perhaps without its arguments."""
    text = path.read_text(encoding="utf-8")
    for name, rest in re.findall(r"`gridfold ([a-z][a-z-]*)([^`]*)`", text):
        known = {
            name
            for item in GROUP.get_command(None, name).params
            for name in getattr(item, "opts", ())
        }
        assert set(re.findall(r"(?<!\S)--[a-z-]+", rest)) <= known | {"--help"}, name
