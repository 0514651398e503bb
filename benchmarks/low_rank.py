"""Reduction of large external areas by sparse factors: seconds, errors and memory.

The Polish grid is read from ``polish/Data_POLISH.mat`` in the folder of public cases
(GRIDFOLD_CASES). ``--dense`` reduces its dense matrices as well, which takes minutes.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from chain import OFFSET, chain
from numpy.typing import NDArray
from report import ROOT, Goal, Section, Table, machine, one_thread, write

from gridfold import Partition, build_model, load_case, partition
from gridfold.dynamics.unit_limits import touched_held
from gridfold.equivalents.area_bases import PORT_TOLERANCE
from gridfold.numerics.modal_form import modal_form
from gridfold.partition.areas import study_buses
from gridfold.partition.port_area import interface_weights, linearize_ports
from gridfold.partition.ports import find_ports
from gridfold.reduction import BalancedTruncation, Reduction
from gridfold.reduction.base import COMPRESSION
from gridfold.reduction.krylov import compress
from gridfold.systems import DescriptorSystem

SOURCE = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
FILE = SOURCE / "polish" / "Data_POLISH.mat"
ZONE, COPIES = 5, (4, 64)

#: Study area of NPCC and, in the second copy, of the chains: New England.
STUDY_AREA = range(1, 37)

#: Frequencies in rad/s at which transfer matrices are compared.
FREQUENCIES = np.geomspace(1e-2, 100, 60)

#: The shortest of so many runs counts.
REPETITIONS = 3

#: Seconds off line that should be enough.
GOALS = {"Polish grid, zone 5": 6.0, "chain of 64": 60.0}


@dataclass(frozen=True)
class Outcome:
    """What one system gave; errors are in parts of the largest value.

    `hankel` is the worst error of a Hankel singular value against the dense way, None if that was not
    asked for; `memory` the peak of the process in GB before the dense way began.
    """

    states: int
    ports: int
    kept: int
    linearize: tuple[float, float]
    compress: tuple[float, float]
    balance: tuple[float, float]
    modes: tuple[float, float]
    order: int
    bound: float
    transfer: float
    memory: float
    hankel: float | None = None
    dense_seconds: float | None = None

    def seconds(self, clock: int) -> float:
        """All that is done off line: elapsed (0) or of the processor (1)."""
        return sum(
            part[clock] for part in (self.linearize, self.compress, self.balance, self.modes)
        )


def systems() -> dict[str, Callable[[], Partition]]:
    """Partitions by name; the Polish grid only where its file is."""

    def copies(count: int) -> Partition:
        return partition(
            build_model(chain(load_case("npcc"), count)), [OFFSET + bus for bus in STUDY_AREA]
        )

    def polish() -> Partition:
        model = build_model(load_case(FILE))
        return partition(model, study_buses(model.case, zones=[ZONE]))

    found: dict[str, Callable[[], Partition]] = {
        "NPCC": lambda: partition(build_model(load_case("npcc")), STUDY_AREA)
    }
    if FILE.is_file():
        found[f"Polish grid, zone {ZONE}"] = polish
    return found | {f"chain of {n}": lambda n=n: copies(n) for n in COPIES}


def clocked(action: Callable[[], object]) -> tuple[float, float]:
    """Shortest seconds of `action`: elapsed, and of the processor."""
    times = []
    for _ in range(REPETITIONS):
        began = time.perf_counter(), time.process_time()
        action()
        times.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    elapsed, worked = np.min(times, axis=0)
    return float(elapsed), float(worked)


def area_of(parts: Partition) -> DescriptorSystem:
    """The external area behind its ports, linearized anew."""
    model = parts.model
    ports = find_ports(model, parts.external_units, parts.study_buses)
    smooth = touched_held(model, model.x0, ports.units)
    return linearize_ports(ports, smooth, model.x0, interface_weights(model, ports)).system


def reduced(system: DescriptorSystem, dense: bool = False) -> Reduction:
    """Balanced to the default bound, by sparse factors or from dense matrices."""
    whole = system.dense() if dense else system
    return BalancedTruncation(PORT_TOLERANCE).reduce(whole, np.zeros(system.n))


def outcome(parts: Partition, dense: bool) -> Outcome:
    """Reduce the external area, step by step."""
    linearize = clocked(lambda: area_of(parts))
    system = area_of(parts)
    small = compress(system, COMPRESSION).system
    alone = clocked(lambda: compress(area_of(parts), COMPRESSION))
    found = reduced(system)
    both = clocked(lambda: reduced(area_of(parts)))
    told = Outcome(
        states=system.n,
        ports=system.m // 2,
        kept=small.n,
        linearize=linearize,
        compress=(alone[0] - linearize[0], alone[1] - linearize[1]),
        balance=(both[0] - alone[0], both[1] - alone[1]),
        modes=clocked(lambda: modal_form(found.system.a)),
        order=found.order,
        bound=float(found.bound or 0.0),
        transfer=transfer_error(system, small.transfer(1j * FREQUENCIES)),
        memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    )
    return against_dense(told, system, found) if dense else told


def transfer_error(system: DescriptorSystem, small: NDArray[np.complex128]) -> float:
    """Largest error of the transfer matrix of the compressed system, in parts of its largest value."""
    full = system.transfer(1j * FREQUENCIES)
    sizes, errors = (np.linalg.norm(g, 2, axis=(1, 2)) for g in (full, full - small))
    return float(errors.max() / sizes.max())


def against_dense(told: Outcome, system: DescriptorSystem, found: Reduction) -> Outcome:
    """With the worst error of a Hankel singular value, and the seconds of the dense way."""
    began = time.perf_counter()
    expected = reduced(system, dense=True).hankel_values
    seconds = time.perf_counter() - began
    assert expected is not None
    assert found.hankel_values is not None
    values = np.zeros(max(len(expected), len(found.hankel_values)))
    values[: len(expected)] = expected
    values[: len(found.hankel_values)] -= found.hankel_values
    return replace(told, hankel=float(np.abs(values).max() / expected[0]), dense_seconds=seconds)


def apart(name: str, dense: bool) -> Outcome:
    """The outcome for one system, in a process of its own, so that its memory is its own."""
    command = [sys.executable, __file__, "--only", name, *(["--dense"] if dense else [])]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return Outcome(**json.loads(done.stdout))


def rows(found: dict[str, Outcome]) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Two rows for every system: sizes and errors, and seconds."""
    result = []
    for name, told in found.items():
        hankel = "" if told.hankel is None else f"{told.hankel:.1e}"
        sizes = (
            name, str(told.states), str(told.ports), str(told.kept),
            f"{told.order} ({told.bound:.2e})", hankel, f"{told.transfer:.1e}",
            f"{told.memory:.2f}",
        )  # fmt: skip
        steps = (told.linearize, told.compress, told.balance, told.modes)
        texts = [f"{elapsed:.2f} / {worked:.2f}" for elapsed, worked in steps]
        whole = f"{told.seconds(0):.2f} / {told.seconds(1):.2f}"
        dense = "" if told.dense_seconds is None else f"{told.dense_seconds:.1f}"
        result.append((sizes, (name, *texts, whole, dense)))
    return result


def section(found: dict[str, Outcome]) -> Section:
    """The page's tables, and how they are made."""
    both = rows(found)
    errors = "worst Hankel error", "transfer error", "GB"
    sizes = Table(
        "Sizes and errors; errors in parts of the largest value:",
        ("grid", "external states", "ports", "k", "order (bound)", *errors),
        [first for first, _ in both],
    )
    steps = "linearize", "compress", "balance", "modal form", "all"
    seconds = Table(
        "Seconds, elapsed / of the processor:",
        ("grid", *steps, "dense way, elapsed"),
        [second for _, second in both],
    )
    remark = (
        "The external area behind its ports is linearized, compressed to k states with the same "
        f"transfer matrix to {COMPRESSION:g} of its size, balanced to the default bound "
        f"{PORT_TOLERANCE:g}, and brought to modal form. Seconds are the shortest of {REPETITIONS} "
        "runs; compression and balancing are differences of two of these. The dense way forms all "
        "matrices of the area. Transfer matrices of the full and the compressed area are compared "
        f"at {len(FREQUENCIES)} frequencies from {FREQUENCIES[0]:g} to {FREQUENCIES[-1]:g} rad/s. "
        "GB is the largest memory of the process without the dense way."
    )
    goals = tuple(
        Goal(f"{name}, seconds off line", found[name].seconds(0), limit)
        for name, limit in GOALS.items()
        if name in found
    )
    return Section("Sparse factors", "low_rank.py", (sizes, seconds), (remark,), goals)


def main() -> None:
    """Measure one system, as JSON, or all, as a page."""
    dense, known = "--dense" in sys.argv, systems()
    if "--only" in sys.argv:
        name = sys.argv[sys.argv.index("--only") + 1]
        print(json.dumps(asdict(outcome(known[name](), dense))))
        return
    small = ("NPCC", f"chain of {COPIES[0]}")
    wanted = {name: name in small or (dense and name.startswith("Polish")) for name in known}
    found = section({name: apart(name, compared) for name, compared in wanted.items()})
    write("low_rank.md", "# Large areas by sparse factors", machine(), found)
    print(found, machine(), sep="\n\n")


if __name__ == "__main__":
    one_thread()
    main()
