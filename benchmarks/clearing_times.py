"""Critical clearing times of the study area of NPCC beside the published ones."""

from __future__ import annotations

import os
import sys
import time

import numpy as np
from numpy.typing import NDArray
from published import CRITICAL_CLEARING_TIMES, SOURCE
from report import ROOT, Section, Table, machine, one_thread, write
from timing import first_and_second

from gridfold import (
    BusFault,
    SynchronismCriterion,
    build_model,
    critical_clearing_times,
    load_case,
)

BUSES = tuple(CRITICAL_CLEARING_TIMES)
PAPER = np.array(list(CRITICAL_CLEARING_TIMES.values()))

#: What a fresh process runs to be timed: the clearing times of one case.
_ALONE = (
    "import sys; sys.path.insert(0, {!r}); import clearing_times as c; c.clearing_times('npcc')"
)


def clearing_times(case_name: str) -> NDArray[np.float64]:
    """Critical clearing time in seconds of a fault at each bus of the study area."""
    model = build_model(load_case(case_name))
    faults = [BusFault(bus, start=0.0, duration=0.1) for bus in BUSES]
    return np.array([found.seconds for found in critical_clearing_times(model, faults)])


def measure() -> Section:
    """Find and time the clearing times of both cases."""
    first, second = first_and_second(
        [sys.executable, "-c", _ALONE.format(str(ROOT / "benchmarks"))],
    )
    clearing_times("npcc")
    began = time.perf_counter()
    found = {"npcc": clearing_times("npcc")}
    warm = time.perf_counter() - began
    found["npcc-pst"] = clearing_times("npcc-pst")
    remarks = (
        *(_summary(name, times) for name, times in found.items()),
        "A clearing time is the largest multiple of 0.01 s after which no machine loses synchronism "
        f"within 16 s. Synchronism counts as lost with {SynchronismCriterion()}; this is checked at "
        "every step of 0.01 s (Runge-Kutta 4).",
        f"The 36 clearing times of npcc take {warm:.1f} s on {os.cpu_count()} threads. As a process "
        f"of its own: {first:.1f} s the first time, with everything to be compiled, and {second:.1f} "
        "s from then on.",
    )
    return Section("Critical clearing times", "clearing_times.py", (_table(found),), remarks)


def _table(found: dict[str, NDArray[np.float64]]) -> Table:
    heads = ["bus", "paper"]
    columns = [[str(bus) for bus in BUSES], [f"{seconds:.2f}" for seconds in PAPER]]
    for name, times in found.items():
        heads += [name, "difference"]
        columns += [[f"{t:.2f}" for t in times], [_signed(d) for d in times - PAPER]]
    caption = f"Seconds; paper: {SOURCE}."
    return Table(caption, tuple(heads), list(zip(*columns, strict=True)))


def _summary(name: str, times: NDArray[np.float64]) -> str:
    difference = times - PAPER
    size = np.abs(difference)
    equal, near = int((size < 0.001).sum()), int((size < 0.011).sum())
    rms, worst = float(np.sqrt(np.mean(difference**2))), _signed(difference[np.argmax(size)])
    return (
        f"{name}: {equal} of {len(BUSES)} equal, {near} within 0.01 s, RMS difference {rms:.4f} s, "
        f"largest difference {worst} s."
    )


def _signed(seconds: float) -> str:
    return "0" if abs(seconds) < 0.001 else f"{seconds:+.2f}"


def main() -> Section:
    """Measure, and write the page."""
    section = measure()
    write("cct.md", "# Critical clearing times of NPCC", section, machine())
    return section


if __name__ == "__main__":
    one_thread()
    print(main(), machine(), sep="\n\n")
