"""gridfold beside trajectories that PSS/E computed: what is compared, and the limits.

The references are those of the benchmark folder of PowerSimulationsDynamics.jl, a folder a case below
the folder of public cases (GRIDFOLD_CASES); tests and
``benchmarks/peers/compare_psse.py`` share this file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import gridfold as gf
from gridfold.dynamics.device import Device
from gridfold.dynamics.network import LoadModel
from gridfold.grid.events import Event
from gridfold.io.event_records import parse_event
from gridfold.numerics.steppers import Stepper
from gridfold.runs.loading import load_psse

ROOT = Path(__file__).resolve().parents[1]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data")) / "psse"

#: Every event is at this time in s. Samples within AROUND of it lie on either side of it.
EVENT, AROUND = 1.0, 0.0151
#: What PSS/E is compared over, in s, and gridfold's step.
T_END, STEP = 20.0, 0.005

#: Largest difference that is allowed: by kind of column, for others as part of the reference's range.
ALLOWED = {"angle_deg": 0.02, "voltage_deg": 0.02, "voltage_pu": 2e-4, "p_pu": 5e-3, "q_pu": 5e-3}
PART_OF_RANGE = 0.01

#: Outputs of a converter, by bus, on the system base, which is its rating in these cases.
CONVERTER = {"p_pu": "active_power", "q_pu": "reactive_power"}


@dataclass(frozen=True)
class Beside:
    """A case and its event; the frequency (Hz) where PSS/E ran at another one than its file says."""

    name: str
    event: str = "branch-trip branch=101-102 time=1"
    loads: LoadModel | None = None
    frequency_hz: float | None = None
    columns: Mapping[str, str] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return CASES / self.name

    @property
    def events(self) -> Sequence[Event]:
        """The event as gridfold has it."""
        return [parse_event(self.event)]


_TRIP_AT_103 = "branch-trip branch=101-103 time=1"

#: All cases, by name. A column that the source has not named is named here.
STUDIES = {
    study.name: study
    for study in (
        *map(
            Beside,
            ("genrou", "genrou_high_saturation", "genrou_s10_zero", "genroe", "gensal", "gensae"),
        ),
        *map(Beside, ("sexs", "sexs_te_zero", "esac1a")),
        Beside("exst1", "branch-trip branch=1-4:1 time=1"),
        *map(Beside, ("gast", "hygov", "degov", "ieeest", "ieeest_filter")),
        Beside(
            "stab1",
            "set bus=1 parameter=voltage_reference value=1.0472 time=1",
            frequency_hz=60.0,
            columns={"third column of the source": "angle_deg:1:1"},
        ),
        Beside("load_current", loads=LoadModel((0.0, 1.0, 0.0))),
        Beside("load_power", loads=LoadModel((1.0, 0.0, 0.0))),
        Beside("regca1_reecb1_repca1", _TRIP_AT_103),
        Beside("regca1_reference_flag", _TRIP_AT_103),
    )
}


@dataclass(frozen=True)
class Difference:
    """One column of a case: both curves at the reference's times, and where they are compared.

    `times` are in s, (n_times,); `kept` are the samples that lie away from the event.
    """

    case: str
    column: str
    times: NDArray[np.float64]
    reference: NDArray[np.float64]
    ours: NDArray[np.float64]
    kept: NDArray[np.bool_]

    @property
    def kind(self) -> str:
        """What the column is, without the unit that it is of."""
        return self.column.partition(":")[0]

    @property
    def range(self) -> float:
        """Largest less least value of the reference away from the event."""
        return float(np.ptp(self.reference[self.kept]))

    @property
    def largest(self) -> float:
        """Largest difference away from the event."""
        return float(np.abs(self.ours - self.reference)[self.kept].max())

    @property
    def allowed(self) -> float:
        """The limit of its kind; where the reference stands still, what its digits are worth."""
        return ALLOWED.get(self.kind, max(PART_OF_RANGE * self.range, 1e-9))

    @property
    def met(self) -> bool:
        """Whether the largest difference is within the limit."""
        return self.largest <= self.allowed


def reference_path(name: str) -> Path:
    """The file with the reference of a case; absent where the public cases are not at hand."""
    return CASES / name / "reference.csv"


def build(study: Beside, changed: Sequence[Device] = ()) -> gf.DetailedModel:
    """The model of a case, with some devices changed."""
    case = load_psse(study.folder / "case.raw", study.folder / "case.dyr").case
    if study.frequency_hz is not None:
        case = replace(case, frequency_hz=study.frequency_hz)
    return gf.build_model(case, loads=study.loads, devices=tuple(changed))


def compare(
    study: Beside, changed: Sequence[Device] = (), stepper: Stepper | None = None
) -> tuple[Difference, ...]:
    """Simulate a case, by Runge-Kutta's method if nothing else is said, and compare all its columns."""
    columns, values = read(study)
    times = values[:, 0]
    end = min(float(times[-1]), T_END)
    model = build(study, changed)
    run = gf.simulate(model, study.events, end, stepper or gf.RungeKutta4(STEP), criterion=None)
    rows = times <= run.times[-1]
    kept = (np.abs(times - EVENT) > AROUND)[rows]
    return tuple(
        Difference(
            study.name,
            column,
            times[rows],
            values[rows, k],
            np.interp(times[rows], run.times, value(run, column)),
            kept,
        )
        for k, column in enumerate(columns)
        if k
    )


def read(study: Beside) -> tuple[list[str], NDArray[np.float64]]:
    """Columns and values of a reference, the time first."""
    head, *lines = reference_path(study.name).read_text(encoding="utf-8").splitlines()
    columns = [study.columns.get(name, name) for name in head.split(",")]
    return columns, np.array([[float(text) for text in line.split(",")] for line in lines])


def value(run: gf.Trajectory, column: str) -> NDArray[np.float64]:
    """What a column of a reference is named after, (n_times,)."""
    name, _, key = column.partition(":")
    if name in ("p_mw", "q_mvar"):
        flows = run.columns(f"flow {key}")
        return run.table(flows)[:, flows.header.index(column)]
    if name.startswith("voltage"):
        voltage = run.bus_voltage([int(key)])[:, 0]
        return np.abs(voltage) if name == "voltage_pu" else np.degrees(np.angle(voltage))
    if name == "angle_deg":
        return run.rotor_angle_deg([key])[:, 0]
    if name in CONVERTER:
        return run.signal(CONVERTER[name], [f"{key}:1"])[:, 0]
    if name in ("slip", "speed_pu"):
        return run.signal("speed", [key])[:, 0] - (name == "slip")
    return run.signal(name, [key])[:, 0]
