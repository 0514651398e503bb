"""The pages for those who come from other programs: every command and all Python on them runs."""

from __future__ import annotations

import re
from pathlib import Path
from shutil import copyfile

import pytest
from written_commands import blocks, ended, words_of

import gridfold as gf
from gridfold.cli.app import COMMANDS

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs" / "howto").glob("coming-from-*.md"))
EXAMPLE = ROOT / "examples" / "psse_study"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the files that the pages speak of."""
    for suffix in ("raw", "dyr"):
        copyfile(EXAMPLE / f"two_areas.{suffix}", tmp_path / f"grid.{suffix}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def commands_in(text):
    """Commands in the cells of the tables, in their order, without those that stand for a page."""
    found = [tuple(words_of(code)[1:]) for code in re.findall(r"`(gridfold [^`]+)`", text)]
    return [words for words in found if len(words) > 1 and words[0] != "warm-up"]


def test_there_are_three_pages_that_name_their_sources():
    assert [page.stem for page in PAGES] == [
        "coming-from-andes",
        "coming-from-psid",
        "coming-from-psse",
    ]
    for page in PAGES:
        assert re.search(r"^Sources: ", page.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_of_the_page_runs(page, folder):
    commands = commands_in(page.read_text(encoding="utf-8"))
    assert len(commands) > 7
    assert {words[0] for words in commands} <= set(COMMANDS)
    for words in commands:
        run = ended(words)
        assert run.code == 0, f"{' '.join(words)}: {run.err}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_of_the_page_runs(page, folder):
    (python,) = blocks(page.read_text(encoding="utf-8"), "python")
    names: dict = {}
    exec(python, names)
    assert names["run"].status is gf.Status.COMPLETED
