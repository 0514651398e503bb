"""CPU time of gridfold and ANDES beside the error of each against its own finest run."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from both import FINE, T_TIMED, TIMED, Error, Outcome, Study, difference, run_andes, run_gridfold
from report import Table

from gridfold import AdamsBashforthMoulton4, ImplicitTrapezoidal, RungeKutta4

REPETITIONS = 3
OURS = "gridfold"

STEPPERS = {
    "RK 4, 10 ms": RungeKutta4(0.01),
    "RK 4, 5 ms": RungeKutta4(0.005),
    "ABM 4, 20 ms": AdamsBashforthMoulton4(0.02),
    "ABM 4, 10 ms": AdamsBashforthMoulton4(0.01),
    "ABM 4, 5 ms": AdamsBashforthMoulton4(0.005),
    "trapezoidal, 10 ms": ImplicitTrapezoidal(0.01),
}

#: Steps and tolerances of ANDES; None is its own, which is 1e-4.
SETTINGS: dict[str, tuple[float, float | None]] = {
    "1/30 s": (1 / 30, None),
    "10 ms": (0.01, None),
    "10 ms, tolerance 1e-6": (0.01, 1e-6),
    "5 ms, tolerance 1e-6": (0.005, 1e-6),
}

#: Largest errors in degrees that times are compared at; beyond DIVERGES an error is no figure.
ALLOWED = (np.inf, 0.2, 0.1)
DIVERGES = 1000.0

_FIRST = """
import both, times
outcome = both.run_gridfold(both.TIMED[{k}], both.T_TIMED, times.STEPPERS["RK 4, 10 ms"])
print(outcome.setup_seconds, outcome.simulation_seconds)
"""

Key = tuple[str, str]
Errors = Mapping[Key, Error]
Runs = dict[Key, list[Outcome]]


class Pair(NamedTuple):
    """The fastest setting of each tool, and ANDES's time over ours: simulation, and with set-up."""

    theirs: Key
    ours: Key
    simulation: float
    whole: float


def timed_runs(study: Study, homes: Mapping[str, Path]) -> Runs:
    """Every setting of both tools in turn, by tool and setting; gridfold once before, untimed."""
    actions: dict[Key, Callable[[], Outcome]] = {}
    for name, stepper in STEPPERS.items():
        actions[OURS, name] = lambda s=stepper: run_gridfold(study, T_TIMED, s)
        actions[OURS, name]()
    for version, home in homes.items():
        for name, (step, tolerance) in SETTINGS.items():
            actions[f"ANDES {version}", name] = lambda h=home, s=step, t=tolerance: run_andes(
                h, study, T_TIMED, s, t
            )
    found: Runs = {key: [] for key in actions}
    for _ in range(REPETITIONS):
        for key, action in actions.items():
            found[key].append(action())
    return found


def own_errors(study: Study, runs: Runs, fine: Mapping[tuple[str, Study], Outcome]) -> Errors:
    """Errors of each run against the same tool at the finest step."""
    references = {f"ANDES {version}": run for (version, of), run in fine.items() if of == study}
    references[OURS] = run_gridfold(study, T_TIMED, RungeKutta4(FINE))
    return {key: difference(outcomes[0], references[key[0]]) for key, outcomes in runs.items()}


def time_table(study: Study, runs: Runs, errors: Errors) -> Table:
    """CPU seconds and errors of every setting."""
    rows = []
    for key, outcomes in runs.items():
        error = errors[key]
        small = error.largest < DIVERGES
        texts = (f"{error.largest:.3f}", f"{error.rms:.3f}") if small else ("diverges", "")
        setup = _least_median([outcome.setup_seconds for outcome in outcomes])
        rows.append((*key, setup, _least_median(_simulation(outcomes)), *texts))
    return Table(
        f"{study}, {T_TIMED:g} s simulated: CPU seconds (least / median of {REPETITIONS}), errors "
        "against the same tool at 1 ms in degrees:",
        ("tool", "step", "set-up", "simulation", "largest", "RMS"),
        rows,
    )


def best_pair(runs: Runs, errors: Errors, allowed: float) -> Pair | None:
    """ANDES's fastest run within an error, and gridfold's fastest that is no less accurate."""
    theirs = _fastest([key for key in runs if key[0] != OURS], runs, errors, allowed)
    if theirs is None:
        return None
    allowed = errors[theirs].largest
    ours = _fastest([key for key in runs if key[0] == OURS], runs, errors, allowed)
    if ours is None:
        return None
    pairs = list(zip(runs[theirs], runs[ours], strict=True))
    alone = [a.simulation_seconds / b.simulation_seconds for a, b in pairs]
    whole = [a.seconds / b.seconds for a, b in pairs]
    return Pair(theirs, ours, float(np.median(alone)), float(np.median(whole)))


def _fastest(keys: list[Key], runs: Runs, errors: Errors, allowed: float) -> Key | None:
    """The setting with the least median among those whose largest error is allowed."""
    good = [key for key in keys if errors[key].largest <= min(allowed, DIVERGES)]
    return min(good, key=lambda key: np.median(_simulation(runs[key])), default=None)


def _simulation(outcomes: list[Outcome]) -> list[float]:
    return [outcome.simulation_seconds for outcome in outcomes]


def _least_median(seconds: list[float]) -> str:
    return f"{min(seconds):.3f} / {np.median(seconds):.3f}"


def ratio_table(pairs: Mapping[tuple[str, float], Pair | None]) -> Table:
    """How many times longer ANDES takes, by case and largest error."""
    rows = [
        (
            case,
            "any" if np.isinf(allowed) else f"at most {allowed:g}",
            ", ".join(pair.theirs),
            pair.ours[1],
            f"{pair.simulation:.0f}",
            f"{pair.whole:.0f}",
        )
        for (case, allowed), pair in pairs.items()
        if pair is not None
    ]
    return Table(
        "Time of ANDES over time of gridfold, medians of the ratios within a repetition. For each "
        "largest error (degrees) the fastest run of ANDES, and the fastest of gridfold that is no "
        "less accurate:",
        ("case", "error", "fastest of ANDES", "gridfold", "simulation", "with set-up"),
        rows,
    )


def first_in_process() -> str:
    """What a new process adds: gridfold's compiled code is loaded from the disk."""
    here, seconds = Path(__file__).parent, []
    paths = os.pathsep.join(map(str, (here, here.parent)))
    for k in range(len(TIMED)):
        for _ in range(2):  # the first fills the cache
            done = subprocess.run(
                [sys.executable, "-c", _FIRST.format(k=k)],
                env=os.environ | {"PYTHONPATH": paths},
                check=True,
                capture_output=True,
                text=True,
            )
        seconds.append(tuple(map(float, done.stdout.split())))
    words = [
        f"{study.case} {setup:.2f} s for the set-up and {run:.2f} s for the simulation"
        for study, (setup, run) in zip(TIMED, seconds, strict=True)
    ]
    return (
        "Set-up is reading the files, the power flow and the start values. ANDES runs in a new "
        "process each time, with its generated code on the disk; importing is not counted. gridfold "
        "repeats in one process. The first run in a new process, with compiled code on the disk and "
        "RK 4 at 10 ms, takes " + ", ".join(words) + "."
    )
