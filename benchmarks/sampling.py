"""Samples of NPCC with a power flow each: rate, and what kills at work leave.

``python benchmarks/sampling.py [SAMPLES]``: a data set is made by two processes, killed (SIGKILL) three
times at work and resumed. Every sample must be there once, equal to that of an undisturbed run.
"""

from __future__ import annotations

import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from report import Goal, Section, Table, machine, one_thread, write

from gridfold.io.sample_store import SampleStore

SAMPLES, KILLS, WORKERS = 2000, 3, 2
#: Samples of a chunk: some are there when a short run is killed.
CHUNK = 50
#: Samples that two cores should make in ten minutes.
WANTED, LIMIT_S = 20_000, 600.0

PLAN = """schema = 1
name = "NPCC, faults everywhere"
samples = {samples}
seed = 2026
chunk = {chunk}
[[load]]
where = "area:1"
factor = {{ uniform = [0.9, 1.1] }}
[[load]]
where = "all except area:1"
factor = {{ normal = [1.0, 0.04], within = [0.88, 1.12] }}
[[generation]]
where = "area:1"
change_mw = {{ uniform = [-300, 300] }}
[[parameter]]
parameter = "inertia"
factor = {{ uniform = [0.7, 1.0] }}
[faults]
bus_faults = "all"
line_faults = "all"
clearing_time = {{ uniform = [0.02, 0.25] }}
[check]
samples = 5
"""


def command(plan: Path, out: Path) -> list[str]:
    """The command line that begins the data set, or goes on with it."""
    line = [sys.executable, "-m", "gridfold", "sample", str(plan), "--out", str(out)]
    line += ["--workers", "processes", "--jobs", str(WORKERS)]
    return [*line, "--resume"] if (out / "plan.json").exists() else line


def cpu_seconds() -> float:
    """Seconds on a core that processes below this one have taken."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def parts(out: Path) -> int:
    """Chunks that are there."""
    return len(list(out.glob("samples/part-*.parquet")))


def kill_once(plan: Path, out: Path, until: int) -> float:
    """Run until so many chunks are there, and kill; the seconds that took."""
    began = time.monotonic()
    with subprocess.Popen(command(plan, out), stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and parts(out) < until:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
    if process.returncode != -signal.SIGKILL:
        raise SystemExit(f"the command ended with {process.returncode} before the kill")
    return time.monotonic() - began


def measure(samples: int, folder: Path) -> Section:
    """Make the data twice, with and without kills, and compare."""
    plan = folder / "plan.toml"
    plan.write_text(PLAN.format(samples=samples, chunk=CHUNK))
    killed, calm = folder / "killed", folder / "calm"
    chunks, seconds, there = -(-samples // CHUNK), 0.0, []
    for k in range(1, KILLS + 1):
        seconds += kill_once(plan, killed, k * chunks // (KILLS + 1))
        there.append(parts(killed) * CHUNK)
    began = time.monotonic()
    subprocess.run(command(plan, killed), check=True, stdout=subprocess.DEVNULL)
    seconds += time.monotonic() - began
    before, began = cpu_seconds(), time.monotonic()
    subprocess.run(command(plan, calm), check=True, stdout=subprocess.DEVNULL)
    alone = time.monotonic() - began
    cores = (cpu_seconds() - before) / alone
    first, second = SampleStore.read(killed).frame(), SampleStore.read(calm).frame()
    if first["number"].tolist() != list(range(1, samples + 1)):
        raise SystemExit(f"{len(first)} rows, {first['number'].nunique()} numbers of {samples}")
    same = (first == second) | (first.isna() & second.isna())
    differing = int((~same.fillna(False).all(axis=1)).sum())
    counts = first["status"].value_counts()
    row = (
        f"{samples:,}", f"{alone:.0f}", f"{samples / alone:.1f}", f"{cores:.2f}",
        f"{cores * alone / samples * 1e3:.0f}", f"{seconds:.0f}",
        ", ".join(map(str, there)), str(differing),
        ", ".join(f"{count:,} {status}" for status, count in counts.items()),
    )  # fmt: skip
    print(*row, sep="; ")
    heads = (
        "samples", "seconds", "samples a second", "cores that it had", "core ms a sample",
        "seconds with kills", "rows there at the kills",
        "rows that differ", "status",
    )  # fmt: skip
    remark = (
        "NPCC, two processes, runs of 16 s in detail, a power flow for each sample; timed "
        f"from the command's start to its end. Killed {KILLS} times at work and resumed: every sample "
        "is there once."
    )
    goals = (
        Goal(f"{WANTED:,} samples at this rate (s)", WANTED * alone / samples, LIMIT_S, 0),
        Goal(
            f"{WANTED:,} samples on {WORKERS} whole cores, by the cores' time (s)",
            WANTED * cores * alone / samples / WORKERS,
            LIMIT_S,
            0,
        ),
    )
    table = Table(remark, heads, (row,))
    return Section("Samples", f"sampling.py {samples}", (table,), goals=goals)


if __name__ == "__main__":
    one_thread()
    scratch = Path(tempfile.mkdtemp(prefix="gridfold-sampling-"))
    try:
        wanted = int(sys.argv[1]) if len(sys.argv) > 1 else SAMPLES
        write("sampling.md", measure(wanted, scratch), machine())
    finally:
        shutil.rmtree(scratch)
