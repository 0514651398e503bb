"""The command, run in this process."""

from __future__ import annotations

import sys

import pytest

from gridfold.cli import main


@pytest.fixture
def command(monkeypatch, capsys):
    """Run ``gridfold ARGUMENTS`` in this process: exit code, standard output, standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["gridfold", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return end.value.code or 0, captured.out, captured.err

    return run
