"""Studies that are killed (SIGKILL) at work and resumed until they are done.

``python benchmarks/kill_and_resume.py [KILLS]``: threads, processes and a local cluster, with the
detailed model and a reduced one. A kill counts if a new result was there. Every contingency must
have one row, equal to that of an undisturbed run apart from times of the machine, and no process may
be left.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
from report import Section, Table, machine, one_thread, write

from gridfold.io.study_repair import check_store
from gridfold.io.study_store import FILE, StudyStore
from gridfold.study.summary import WALL

KILLS = 500
SEED = 2026
#: Longest time (s) that a process lives on after its first result.
LONGEST_LIFE = 0.5
#: Time (s) within which the workers of a killed process have to be gone.
PATIENCE = 30.0
#: Contingencies of a study; another one is begun when all are done and there are kills left.
BUSES, DURATIONS_MS = range(1, 37), range(10, 90, 10)

STUDY = """schema = 1
name = "kill and resume"
[study_area]
areas = "1"
[contingencies]
csv = "faults.csv"
line_faults = "1-9"
clearing_time = 0.05
[model]
{model}
[check]
sample = 0
[run]
t_end = {t_end}
"""
MODELS = {
    "detailed": ('kind = "detailed"', 4.0),
    "adaptive": ('kind = "adaptive"\norder = 20\nretain = 3\nangle_deg = 20', 4.0),
}
WORKERS = {
    "threads": (),
    "processes": ("--workers", "processes"),
    "local cluster": ("--cluster", "local"),
}


@dataclass
class Tally:
    """What came of the kills of one arrangement."""

    kills: int = 0
    too_early: int = 0
    studies: int = 0
    contingencies: int = 0
    before: int = 0
    differing: int = 0
    orphans: int = 0
    damage: list[str] = field(default_factory=list)

    def row(self, workers: str, model: str) -> tuple[str, ...]:
        counts = (self.kills, self.too_early, self.studies, self.contingencies, self.before)
        return (workers, model, *map(str, (*counts, self.differing, self.orphans)))


def write_study(folder: Path, model: str) -> Path:
    """The study and its table of faults."""
    text, t_end = MODELS[model]
    rows = ["name,kind,bus,duration"]
    rows += [
        f"bus {bus} for {ms} ms,bus-fault,{bus},{ms / 1000}" for ms in DURATIONS_MS for bus in BUSES
    ]
    (folder / "faults.csv").write_text("\n".join(rows) + "\n")
    path = folder / "study.toml"
    path.write_text(STUDY.format(model=text, t_end=t_end))
    return path


def command(study: Path, out: Path, how: tuple[str, ...]) -> list[str]:
    """The command line that begins the study, or goes on with it."""
    gridfold = [sys.executable, "-m", "gridfold", "run", str(study), "--out", str(out), *how]
    return [*gridfold, "--resume"] if (out / FILE).exists() else gridfold


def count(out: Path) -> int:
    """Results that are there."""
    if not (out / FILE).exists():
        return 0
    with closing(sqlite3.connect(out / FILE, timeout=60)) as connection:
        return int(connection.execute("SELECT count(*) FROM result").fetchone()[0])


def below(pid: int) -> set[int]:
    """All processes that a process has started, and these."""
    found = set()
    for file in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, file.read_text().split()):
            found |= {child} | below(child)
    return found


def left_over(pids: set[int]) -> int:
    """How many of the processes are still there after a while; they are ended then."""
    end = time.monotonic() + PATIENCE
    while (left := {pid for pid in pids if is_alive(pid)}) and time.monotonic() < end:
        time.sleep(0.02)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    return len(left)


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def kill_once(line: list[str], out: Path, chance: random.Random, tally: Tally) -> bool:
    """Run until some time after the next result, and kill; false if the study ended before."""
    there = count(out)
    with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        while process.poll() is None and count(out) == there:
            time.sleep(0.01)
        time.sleep(chance.uniform(0.0, LONGEST_LIFE))
        children = below(process.pid)
        process.send_signal(signal.SIGKILL)
        said = process.communicate()[1]
    if process.returncode not in (0, -signal.SIGKILL):
        raise SystemExit(f"the study ended with {process.returncode}: {said.decode()}")
    tally.orphans += left_over(children)
    if process.returncode == 0:
        return False
    hit = count(out) > there
    tally.kills += hit
    tally.too_early += not hit
    return True


def disturb(
    folder: Path, workers: str, model: str, kills: int, chance: random.Random, tally: Tally
) -> None:
    """One study: begun, killed until it is done or there were kills enough, ended, compared."""
    folder.mkdir()
    study, how = write_study(folder, model), WORKERS[workers]
    out, calm = folder / "disturbed", folder / "calm"
    line = command(study, out, how)
    # The same beginning for both: the costs of the rungs are measured once.
    going = kill_once(line, out, chance, tally)
    shutil.copytree(out, calm)
    clear(calm)
    while going and tally.kills < kills:
        going = kill_once(command(study, out, how), out, chance, tally)
    tally.before += count(out)
    quiet = {"check": True, "stdout": subprocess.DEVNULL}
    subprocess.run(command(study, out, how), **quiet)
    subprocess.run(command(study, calm, ()), **quiet)
    tally.studies += 1
    disturbed, undisturbed = rows(out), rows(calm)
    with StudyStore.read(out) as store:
        total = len(store.contingencies())
    if disturbed.index.tolist() != list(range(1, total + 1)):
        raise SystemExit(f"{len(disturbed)} rows for {total} contingencies")
    same = (disturbed == undisturbed) | (disturbed.isna() & undisturbed.isna())
    tally.differing += int((~same.all(axis=1)).sum())
    tally.contingencies += total
    tally.damage += [str(item) for item in check_store(out).damage]
    shutil.rmtree(folder)


def clear(out: Path) -> None:
    """Take all results out of a store."""
    with StudyStore.resume(out) as store, store.connection:
        for table in ("curves", "result"):
            store.connection.execute(f"DELETE FROM {table}")


def rows(out: Path) -> pd.DataFrame:
    """All results without times of the machine."""
    with StudyStore.read(out) as store:
        frame = store.frame().set_index("number")
    return frame[[name for name in frame if not name.startswith(WALL)]]


def measure(kills: int, folder: Path) -> Section:
    """Kill, resume, and compare in all arrangements."""
    chance, found = random.Random(SEED), []
    pairs = [(workers, model) for model in MODELS for workers in WORKERS]
    for k, (workers, model) in enumerate(pairs):
        wanted = (k + 1) * kills // len(pairs) - k * kills // len(pairs)
        tally = Tally()
        while tally.kills < wanted:
            name = f"{k}-{tally.studies}"
            disturb(folder / name, workers, model, wanted, chance, tally)
        found.append(tally.row(workers, model))
        print(*found[-1], *tally.damage, sep="; ", flush=True)
        if tally.damage:
            raise SystemExit(f"damaged: {tally.damage[0]}")
    heads = (
        "workers", "model", "kills at work", "kills before it", "studies", "contingencies",
        "rows there when last killed", "rows that differ", "processes left",
    )  # fmt: skip
    remark = (
        f"NPCC, runs of {MODELS['detailed'][1]:g} s, two workers. A process is killed within "
        f"{LONGEST_LIFE:g} s of its first result; the kill counts as at work if that was there. Each "
        "contingency has one row at the end, compared with an undisturbed run on threads; all stores "
        "are whole. Two contingencies that lose a line lead to one topology: they go out together."
    )
    return Section("Kill and resume", f"kill_and_resume.py {kills}", (Table(remark, heads, found),))


if __name__ == "__main__":
    one_thread()
    scratch = Path(tempfile.mkdtemp(prefix="gridfold-kill-"))
    try:
        wanted = int(sys.argv[1]) if len(sys.argv) > 1 else KILLS
        write("kill_and_resume.md", measure(wanted, scratch), machine())
    finally:
        shutil.rmtree(scratch)
