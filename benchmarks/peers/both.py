"""The same disturbance on the same files, simulated by gridfold and by ANDES."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from report import ROOT

from gridfold import AngleReference, BusFault, DetailedModel, build_model, simulate
from gridfold.dynamics.device import Device
from gridfold.numerics.steppers import Stepper
from gridfold.runs.loading import load_psse

CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
ENVIRONMENTS = ROOT / ".venv-peers"
ANDES_SCRIPT = Path(__file__).with_name("andes_run.py")


@dataclass(frozen=True)
class Study:
    """A bus fault on a case: files below the folder of public cases, times in s, reactance in p.u."""

    case: str
    raw: str
    dyr: str
    bus: int
    start: float = 0.1
    duration: float = 0.1
    reactance: float = 1e-4

    def __str__(self) -> str:
        return f"{self.case}, bus {self.bus}"

    @property
    def paths(self) -> tuple[Path, Path]:
        """The RAW and the DYR file."""
        return (CASES / self.raw).resolve(), (CASES / self.dyr).resolve()

    @property
    def fault(self) -> BusFault:
        """The fault as an event of gridfold."""
        return BusFault(self.bus, self.start, self.duration, reactance=self.reactance)


NPCC = ("npcc_curent", "npcc/npcc_curent.raw", "npcc/npcc_curent.dyr")
KUNDUR = ("kundur", "kundur/kundur.raw", "kundur/kundur_full.dyr")
FAULTS = (Study(*NPCC, bus=3), Study(*NPCC, bus=71), Study(*KUNDUR, bus=8))

#: The faults that are timed, and the seconds that are simulated then.
TIMED, T_TIMED = (FAULTS[0], FAULTS[2]), 10.0

#: Runs that others are measured against: step (s), and tolerance of Newton's method in ANDES.
FINE, TIGHT = 0.001, 1e-8


@dataclass(frozen=True)
class Outcome:
    """Angles against the centre of inertia in degrees (n_times, n_machines), and CPU seconds."""

    names: tuple[str, ...]
    times: NDArray[np.float64]
    angles: NDArray[np.float64]
    setup_seconds: float
    simulation_seconds: float

    @property
    def seconds(self) -> float:
        """Set-up and simulation together."""
        return self.setup_seconds + self.simulation_seconds


@dataclass(frozen=True)
class Error:
    """What two outcomes differ by in degrees: at the start, at most, RMS, RMS of the worst machine."""

    start: float
    largest: float
    rms: float
    worst: float

    def __str__(self) -> str:
        return f"{self.largest:.3f} / {self.rms:.3f}"


def difference(rough: Outcome, fine: Outcome, t_end: float = np.inf) -> Error:
    """Difference at the times of `rough` up to `t_end`; `fine` is interpolated there."""
    rows = rough.times <= t_end
    columns = [fine.names.index(name) for name in rough.names]
    there = [np.interp(rough.times[rows], fine.times, fine.angles[:, k]) for k in columns]
    error = rough.angles[rows] - np.transpose(there)
    by_machine = np.sqrt(np.mean(error**2, axis=0))
    return Error(
        start=float(np.abs(error[0]).max()),
        largest=float(np.abs(error).max()),
        rms=float(np.sqrt(np.mean(error**2))),
        worst=float(by_machine.max()),
    )


# ANDES.


def environments() -> dict[str, Path]:
    """Folders of the environments with ANDES, by version."""
    homes = sorted(command.parents[1] for command in ENVIRONMENTS.glob("*/bin/andes"))
    return {home.name: home for home in homes}


def run_andes(
    home: Path, study: Study, t_end: float, step: float, tolerance: float | None = None
) -> Outcome:
    """Simulate with ANDES in a process of its own."""
    numbers = [f"--t-end={t_end}", f"--step={step!r}"]
    if tolerance is not None:
        numbers.append(f"--tolerance={tolerance}")
    found = call_andes(home, study, numbers)
    if not found["completed"]:
        raise RuntimeError(f"ANDES {found['version']} has not completed {study} at {step} s")
    angles, inertia = np.rad2deg(found["angles"]), found["inertia"]
    return Outcome(
        names=tuple(map(str, found["names"])),
        times=found["times"],
        angles=angles - (angles @ inertia / inertia.sum())[:, None],
        setup_seconds=float(found["setup_seconds"]),
        simulation_seconds=float(found["simulation_seconds"]),
    )


def andes_eigenvalues(home: Path, study: Study) -> NDArray[np.complex128]:
    """Eigenvalues at the operating point, from ANDES."""
    return np.asarray(call_andes(home, study, ["--eigenvalues"])["eigenvalues"])


def call_andes(home: Path, study: Study, options: Sequence[str]) -> dict[str, Any]:
    """Run the script; the generated code of ANDES lies in its environment, as its home."""
    raw, dyr = study.paths
    numbers = [
        f"--bus={study.bus}",
        f"--start={study.start}",
        f"--duration={study.duration}",
        f"--reactance={study.reactance}",
    ]
    with TemporaryDirectory() as folder:
        out = Path(folder) / "run.npz"
        command = [home / "bin" / "python", ANDES_SCRIPT, out, raw, dyr, *numbers, *options]
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        done = subprocess.run(
            command, env=environment | {"HOME": str(home)}, cwd=folder, capture_output=True
        )
        if done.returncode:
            raise RuntimeError(f"ANDES failed on {study}:\n{done.stderr.decode()}")
        with np.load(out) as archive:
            return dict(archive)


# gridfold.


def build(study: Study, changed: Sequence[Device] = ()) -> DetailedModel:
    """Read the files and build the model, with some devices changed."""
    return build_model(load_psse(*study.paths).case, devices=tuple(changed))


def run_gridfold(
    study: Study, t_end: float, stepper: Stepper, changed: Sequence[Device] = ()
) -> Outcome:
    """Read, build and simulate with gridfold, in this process."""
    began = time.process_time()
    model = build(study, changed)
    ready = time.process_time()
    run = simulate(model, [study.fault], t_end, stepper, criterion=None)
    done = time.process_time()
    return Outcome(
        names=tuple(map(str, model.machines)),
        times=run.times,
        angles=run.rotor_angle_deg(None, AngleReference.CENTRE_OF_INERTIA),
        setup_seconds=ready - began,
        simulation_seconds=done - ready,
    )
