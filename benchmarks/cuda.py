"""Runs on an NVIDIA GPU against runs on one core: how far apart they are, and how many a second.

Run it on a machine with a GPU: ``make test-cuda``. Without one it ends with a word and code 2.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np
from report import Goal, Section, Table, machine, one_thread, write

import gridfold as gf
from gridfold.numerics.cuda_device import simulated, why_no_gpu
from gridfold.runs.batch import simulate_batch
from gridfold.runs.cuda import simulate_on_gpu
from gridfold.runs.trajectory import Trajectory

PAGE = "cuda.md"
#: Degrees that rotor angles may be apart, and NPCC runs a second with their figures at hand.
APART, RATE = 1e-8, 10_000
RUNS = 20_000
T_END = 16.0


def disturbances(case: gf.Case, count: int) -> list[Sequence[gf.Event]]:
    """Faults at all buses and lines with clearing times of their own, and trips of machines."""
    found: list[Sequence[gf.Event]] = [
        [gf.MachineTrip(unit.bus, unit.id, 0.1)] for unit in case.generators if unit.in_service
    ]
    lines = [branch for branch in case.branches if branch.in_service]
    k = 0
    while len(found) < count:
        duration = 0.05 + 0.01 * (k // len(case.buses) % 30)
        bus, line = case.buses[k % len(case.buses)], lines[k % len(lines)]
        name = f"{line.from_bus}-{line.to_bus}:{line.circuit}"
        found.append([gf.BusFault(bus.number, 0.1, duration)])
        found.append([gf.BusFault(bus.number, 0.1, duration), gf.BranchTrip(name, 0.1 + duration)])
        k += 1
    return found[:count]


def apart(model: gf.DetailedModel, events: list[Sequence[gf.Event]]) -> float:
    """The largest difference of a rotor angle in degrees; both have the same ends."""
    there, largest = dict(simulate_on_gpu(model, events, T_END)), 0.0
    for number, alone in simulate_batch(model, events, T_END):
        run = there[number]
        assert isinstance(run, Trajectory), run
        assert isinstance(alone, Trajectory), alone
        assert (run.status, len(run.times)) == (alone.status, len(alone.times)), events[number]
        difference = np.abs(run.rotor_angle_deg() - alone.rotor_angle_deg())
        largest = max(largest, float(np.nanmax(difference)))
    return largest


def measure() -> Section:
    """NPCC: what differs over a sample, and the rate over many."""
    from numba import cuda

    model = gf.build_model(gf.load_case("npcc"))
    gpu = cuda.get_current_device().name
    gpu = gpu.decode() if isinstance(gpu, bytes) else gpu
    difference = apart(model, disturbances(model.case, 256))
    many = disturbances(model.case, RUNS)
    began = time.perf_counter()
    count = sum(isinstance(run, Trajectory) for _, run in simulate_on_gpu(model, many, T_END))
    rate = count / (time.perf_counter() - began)
    table = Table(
        f"NPCC, runs of 16 s by rk4 at 10 ms on one {gpu}, networks and trajectories included.",
        ("runs", "a second", "from the CPU, degrees"),
        [(str(count), f"{rate:.0f}", f"{difference:.1e}")],
    )
    goals = (
        Goal("degrees between GPU and CPU", difference, APART),
        Goal("seconds for a run on the GPU", 1 / rate, 1 / RATE),
    )
    return Section("Runs on a GPU", "cuda.py", (table,), goals=goals)


def main() -> Section:
    """Measure and write the page."""
    section = measure()
    write(PAGE, section, machine())
    return section


if __name__ == "__main__":
    reason = "the simulator is no GPU" if simulated() else why_no_gpu()
    if reason is not None:
        print(f"runs on a GPU are not measured: {reason}", file=sys.stderr)
        raise SystemExit(2)
    one_thread()
    print(main())
