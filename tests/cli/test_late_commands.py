"""Start, help, completion and renamed options of the command."""

from __future__ import annotations

import inspect
import subprocess
import sys
from importlib import import_module

import pytest

from gridfold.cli.app import COMMANDS
from gridfold.cli.completion import case_sources


@pytest.mark.parametrize("name", COMMANDS)
def test_the_line_in_the_list_is_the_first_one_of_the_command(name):
    late = COMMANDS[name]
    function = getattr(import_module(f"gridfold.cli.{late.module}"), name.replace("-", "_"))
    assert inspect.getdoc(function).splitlines()[0] == late.line


def test_the_package_and_its_help_load_nothing_that_takes_long():
    code = (
        "import contextlib, io, sys, gridfold\n"
        "sys.argv = ['gridfold', '--help']\n"
        "from gridfold.cli import main\n"
        "with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):\n"
        "    main()\n"
        "assert 'Simulate a disturbance' in said.getvalue()\n"
        "print([name for name in ('numpy', 'numba', 'scipy', 'pandas') if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_run_loads_neither_tables_nor_pictures_nor_studies():
    code = (
        "import sys, gridfold.cli.run\n"
        "names = ('pandas', 'pyarrow', 'matplotlib', 'plotly', 'gridfold.study', 'powerio')\n"
        "print([name for name in names if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_options_of_the_release_before_are_accepted_and_told(command):
    code, out, err = command("cct", "npcc", "--buses", "99999", "--workers=2")
    assert code == 2
    assert "--workers is called --jobs now" in err
    assert "99999" in err
    assert out == ""
    _, _, err = command("reduce", "npcc", "--save", "x.npz", "--order", "none")
    assert "--save is called --out now" in err


def test_a_name_that_is_none_of_a_command_is_refused(command):
    code, _, err = command("simulat", "npcc")
    assert code == 2
    assert "No such command 'simulat'" in err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("gridfold eig", ["eigenvalues"]),
        ("gridfold simulate --model pap", ["paper", "paper-whole"]),
        ("gridfold info npcc-", ["npcc-pst"]),
        ("gridfold cct npcc --job", ["--jobs"]),
        ("gridfold cct npcc --work", []),
    ],
)
def test_the_shell_completes(words, expected, command, monkeypatch):
    monkeypatch.setenv("_GRIDFOLD_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    _, out, _ = command()
    assert out.split() == expected


def test_files_of_networks_and_folders_are_completed(tmp_path, monkeypatch):
    for name in ("grid.RAW", "grid.dyr", "grid.m", "notes.txt", ".hidden.raw"):
        (tmp_path / name).touch()
    (tmp_path / "cases").mkdir()
    monkeypatch.chdir(tmp_path)
    assert case_sources("") == ["npcc", "npcc-pst", "cases/", "grid.RAW", "grid.m"]
    assert case_sources("g") == ["grid.RAW", "grid.m"]
    (tmp_path / "cases" / "deep.mat").touch()
    assert case_sources("cases/") == ["cases/deep.mat"]
    assert case_sources("nowhere/") == []
