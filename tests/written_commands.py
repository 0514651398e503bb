"""Commands as pages of the documentation and readmes print them, and running them in this process."""

from __future__ import annotations

import re
import shlex
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO

import pytest

from gridfold.cli import main


@dataclass(frozen=True)
class Ended:
    """A command that was run: what it was, how it ended, and what it wrote."""

    arguments: tuple[str, ...]
    code: int
    out: str
    err: str


def blocks(text: str, language: str) -> list[str]:
    """All blocks of code in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def commands(text: str) -> list[tuple[str, ...]]:
    """Arguments of each ``gridfold`` in the shell blocks of a page."""
    found = []
    for block in blocks(text, "bash"):
        for line in block.replace("\\\n", " ").splitlines():
            words = words_of(line)
            while words:
                end = next((k for k, word in enumerate(words) if word in ("&&", "|")), len(words))
                if words[:1] == ["gridfold"]:
                    found.append(tuple(words[1:end]))
                words = words[end + 1 :]
    return found


def words_of(line: str) -> list[str]:
    """A line as a shell splits it, with && and | as words, without its comment."""
    reader = shlex.shlex(line, posix=True, punctuation_chars=True)
    reader.whitespace_split = True
    return list(reader)


def ended(arguments: tuple[str, ...]) -> Ended:
    """Run ``gridfold ARGUMENTS`` here."""
    out, err = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setenv("MPLBACKEND", "agg")
        patch.setattr(sys, "argv", ["gridfold", *arguments])
        with pytest.raises(SystemExit) as end:
            main()
    return Ended(arguments, int(end.value.code or 0), out.getvalue(), err.getvalue())
