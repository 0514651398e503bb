"""Runs a worker, counts how inputs end, keeps those that end badly, and replaces it where it dies."""

from __future__ import annotations

import ast
import hashlib
import os
import select
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from fuzz.targets import TARGETS
from fuzz.worker import COMMAND_LIMIT

CORPUS = Path(__file__).parent / "corpus"
#: Seconds without a word after which a worker is given up; it watches its own time, unless compiled
#: code does not come back. The first answer may take a compilation.
_SILENCE, _BEGIN = COMMAND_LIMIT + 20, 300


@dataclass
class Tally:
    """How many inputs ended how, and the most memory (MiB) that the process had."""

    inputs: int = 0
    refused: int = 0
    read: int = 0
    traceback: int = 0
    hang: int = 0
    crash: int = 0
    peak: int = 0

    @property
    def figures(self) -> tuple[int, ...]:
        """In the order of the table."""
        return (
            self.inputs,
            self.refused,
            self.read,
            self.traceback,
            self.hang,
            self.crash,
            self.peak,
        )

    @property
    def bad(self) -> int:
        """Inputs that ended neither in a result nor in a refusal."""
        return self.traceback + self.hang + self.crash

    def count(self, outcome: str, peak: int = 0) -> None:
        """One more input."""
        self.inputs += 1
        setattr(self, outcome, getattr(self, outcome) + 1)
        self.peak = max(self.peak, peak)

    def add(self, other: Tally) -> None:
        """The inputs of another tally as well."""
        for name, value in vars(other).items():
            mine = getattr(self, name)
            setattr(self, name, max(mine, value) if name == "peak" else mine + value)


class Campaign:
    """Inputs made from one seed; of those that end badly in one place the first is kept."""

    def __init__(self, seed: int, end: float, corpus: Path | None = None):
        self.seed, self.end, self.corpus = seed, end, corpus
        self.bad: list[str] = []
        self._seen: set[str] = set()
        self._process: subprocess.Popen[bytes] | None = None
        self._text = b""

    def __enter__(self) -> Campaign:
        return self

    def __exit__(self, *error: object) -> None:
        self._stop()

    def run(self, name: str, tally: Tally, last: int) -> None:
        """Feed a reader up to the input with the number `last`, unless the time is over before."""
        while tally.inputs < last and time.monotonic() < self.end:
            self._ask(f"{name} {tally.inputs} {last}")
            while (words := self._answer()) and words[0] == "start":
                ended = self._answer()
                if not ended:
                    break
                tally.count(ended[1], int(ended[2]) // 1024)
                if ended[1] not in ("refused", "read"):
                    self._keep(name, tally.inputs - 1, ended[1], " ".join(ended[3:]))
                if time.monotonic() > self.end:
                    self._stop()
                    return
            if not words or words[0] == "start":
                code = self._stop()
                tally.count("crash" if code else "hang")
                self._keep(name, tally.inputs - 1, "crash", f"'exit code {code}'")

    def _keep(self, name: str, number: int, outcome: str, message: str) -> None:
        file, content = TARGETS[name].make(self.seed, number)
        place = f"{hashlib.sha256(content).hexdigest()[:10]}-{file.replace('/', '+')}"
        text = f"{name} {number} {outcome}: {place} {ast.literal_eval(message)}"
        self.bad.append(text)
        where = f"{name} {outcome} {message.rpartition(' at ')[2]}"
        if where in self._seen:
            return
        self._seen.add(where)
        print(text, flush=True)
        if self.corpus is not None:
            (self.corpus / name).mkdir(parents=True, exist_ok=True)
            (self.corpus / name / place).write_bytes(content)

    def _ask(self, line: str) -> None:
        if self._process is None:
            path = os.pathsep.join([*sys.path, os.environ.get("PYTHONPATH", "")])
            self._process = subprocess.Popen(
                [sys.executable, "-m", "fuzz.worker", str(self.seed)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": path, "MPLBACKEND": "agg"},
            )
            self._patience = _BEGIN
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n".encode())
        self._process.stdin.flush()

    def _answer(self) -> list[str]:
        """Words of the next line; none if the worker is gone, or silent for too long."""
        assert self._process is not None
        assert self._process.stdout is not None
        stream = self._process.stdout.fileno()
        while b"\n" not in self._text:
            if not select.select([stream], [], [], self._patience)[0]:
                return []
            more = os.read(stream, 65536)
            if not more:
                return []
            self._text += more
        self._patience = _SILENCE
        line, _, self._text = self._text.partition(b"\n")
        return line.decode().split(" ")

    def _stop(self) -> int | None:
        """End the worker; its exit code if it had ended by itself."""
        if self._process is None:
            return None
        try:
            code = self._process.wait(0.5)
        except subprocess.TimeoutExpired:
            code = None
            self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()
        self._process.wait()
        self._process, self._text = None, b""
        return code
