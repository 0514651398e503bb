"""A study that is killed (SIGKILL) at random moments and resumed until it is done.

``python benchmarks/kill_and_resume.py [KILLS]``: every contingency must have one row, equal to that of
an undisturbed run apart from times of the machine.
"""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from report import Section, Table, machine, one_thread, write

from gridfold.io.study_store import FILE, StudyStore
from gridfold.study.summary import WALL

KILLS = 500
SEED = 2026
#: Faults at every bus, with so many clearing times each: more than the kills leave time for.
DURATIONS_MS = range(10, 160, 4)
BUSES = range(1, 141)
#: Longest time (s) that a process lives on after its first result.
LONGEST_LIFE = 0.25

STUDY = """schema = 1
name = "kill and resume"
[contingencies]
csv = "faults.csv"
[model]
kind = "detailed"
[run]
t_end = 2.0
[outputs]
curves = true
"""


def write_study(folder: Path) -> Path:
    """The study and its table of faults."""
    rows = ["name,kind,bus,duration"]
    rows += [
        f"bus {bus} for {ms} ms,bus-fault,{bus},{ms / 1000}" for ms in DURATIONS_MS for bus in BUSES
    ]
    (folder / "faults.csv").write_text("\n".join(rows) + "\n")
    path = folder / "study.toml"
    path.write_text(STUDY)
    return path


def command(study: Path, out: Path) -> list[str]:
    """The command line that begins the study, or goes on with it."""
    gridfold = [sys.executable, "-m", "gridfold", "run", str(study), "--out", str(out)]
    return [*gridfold, "--resume"] if (out / FILE).exists() else gridfold


def count(out: Path) -> int:
    """Results that are there."""
    if not (out / FILE).exists():
        return 0
    with StudyStore.read(out) as store:
        return len(store.done())


def disturb(study: Path, out: Path, kills: int, chance: random.Random) -> tuple[int, int, int]:
    """Kill and resume: kills while it worked, kills before its first result, rows at the end of it."""
    working = before = 0
    while working + before < kills:
        with subprocess.Popen(
            command(study, out), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        ) as process:
            early = chance.random() < 0.1
            life = chance.uniform(0.0, 3.0) if early else chance.uniform(0.0, LONGEST_LIFE)
            there = count(out)
            while not early and process.poll() is None and count(out) == there:
                time.sleep(0.01)
            time.sleep(life)
            process.send_signal(signal.SIGKILL)
            said = process.communicate()[1]
            if process.returncode not in (0, -signal.SIGKILL):
                raise SystemExit(f"the study ended with {process.returncode}: {said.decode()}")
        if process.returncode == 0:
            break
        now = count(out)
        working, before = working + (now > there), before + (now == there)
        if (working + before) % 50 == 0:
            print(f"{working + before} kills, {now} rows", flush=True)
    return working, before, count(out)


def rows(out: Path) -> pd.DataFrame:
    """All results without times of the machine."""
    with StudyStore.read(out) as store:
        frame = store.frame()
    return frame[[name for name in frame if not name.startswith(WALL)]]


def measure(kills: int, folder: Path) -> Section:
    """Kill, resume, and compare with an undisturbed run."""
    study = write_study(folder)
    chance = random.Random(SEED)
    out, calm = folder / "disturbed", folder / "calm"
    working, before, reached = disturb(study, out, kills, chance)
    subprocess.run(command(study, out), check=True, stdout=subprocess.DEVNULL)
    subprocess.run(command(study, calm), check=True, stdout=subprocess.DEVNULL)
    disturbed, undisturbed = rows(out), rows(calm)
    pd.testing.assert_frame_equal(disturbed, undisturbed)
    total = len(BUSES) * len(DURATIONS_MS)
    numbers = disturbed["number"].tolist()
    if numbers != list(range(1, total + 1)):
        raise SystemExit(f"{len(numbers)} rows for {total} contingencies")
    facts: Sequence[tuple[str, str]] = (
        ("kills", str(working + before)),
        ("of these after at least one new result", str(working)),
        ("contingencies", str(total)),
        ("done when the last kill came", str(reached)),
        ("contingencies with exactly one row", str(len(set(numbers)))),
        ("rows that differ from the undisturbed run", "0"),
    )
    remark = (
        "NPCC, detailed model, 2 s, two threads. Nine in ten processes are killed within "
        f"{LONGEST_LIFE:g} s of their first result, one in ten within 3 s of their start."
    )
    return Section(
        "Kill and resume",
        f"kill_and_resume.py {kills}",
        (Table(remark, ("what", "figure"), facts),),
    )


if __name__ == "__main__":
    one_thread()
    scratch = Path(tempfile.mkdtemp(prefix="gridfold-kill-"))
    try:
        wanted = int(sys.argv[1]) if len(sys.argv) > 1 else KILLS
        write("kill_and_resume.md", measure(wanted, scratch), machine())
    finally:
        shutil.rmtree(scratch)
