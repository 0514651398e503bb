"""How long the demonstration takes when it runs for the first time, and afterwards."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from report import Section, Table, machine, one_thread
from timing import first_and_second

COMMAND = "gridfold demo --out demo"


def measure() -> Section:
    """Time whole processes, with empty and with filled caches."""
    script, *arguments = COMMAND.split()
    title, name = "The first run", "first_run.py"
    try:
        first, second = first_and_second([str(Path(sys.executable).with_name(script)), *arguments])
    except (OSError, subprocess.CalledProcessError) as error:
        return Section(title, name, (), (f"`{COMMAND}` could not be timed: {error}",))
    table = Table(
        f"`{COMMAND}` as a whole process, in seconds:",
        ("", "seconds"),
        [
            ("first time, caches of compiled code and fonts empty", f"{first:.1f}"),
            ("second time", f"{second:.1f}"),
        ],
    )
    return Section(title, name, (table,))


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
