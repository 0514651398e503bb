"""WECC240 with its converters after a bus fault, in gridfold and in ANDES: angles and powers.

Both read the files of :mod:`wecc_files`. Run by ``make bench-peers``, which makes the environments that
ANDES lives in.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from andes_conventions import CONVENTIONS
from both import ENVIRONMENTS, Study, build, call_andes, environments
from numpy.typing import NDArray
from report import Goal, Table, machine, one_thread, write
from wecc_files import write_changed

from gridfold import AngleReference, RungeKutta4, Trajectory, simulate

RAW, DYR = (
    "wecc240/240busWECC_2018_PSS32_fixed_shunts.raw",
    "wecc240/240busWECC_2018_PSS.dyr",
)
BUS, START, DURATION, AFTER = 2408, 0.1, 0.05, 3.0
#: ANDES's step, and gridfold's, s.
THEIRS, OURS = 1 / 240, 1 / 480
#: Samples around a switching that lie on either side of it, and when converters have settled, s.
AROUND, SETTLED = 0.016, 0.25
ANGLE, POWER = 0.5, 0.01


@dataclass(frozen=True)
class Agreement:
    """Differences in degrees and parts of the converters' ratings; `early` is before they settle."""

    angle_rms: float
    angle_worst: float
    angle_largest: float
    active: float
    reactive: float
    early_active: float
    early_reactive: float

    @property
    def row(self) -> tuple[str, ...]:
        """All figures as text."""
        angles = (self.angle_rms, self.angle_worst, self.angle_largest)
        powers = (self.active, self.reactive, self.early_active, self.early_reactive)
        return *(f"{x:.3f}" for x in angles), *(f"{x:.2%}" for x in powers)


HEADS = (
    "as in ANDES", "angle, RMS", "RMS, worst machine", "angle, largest",
    "P", "Q", "P, early", "Q, early",
)  # fmt: skip


def compare(theirs: dict[str, Any], run: Trajectory) -> Agreement:
    """Angles against the centre of inertia and their own start; powers by the converters' ratings."""
    times = theirs["times"]
    known = {str(unit) for unit in run.model.machines}
    live = [k for k, name in enumerate(theirs["names"]) if str(name) in known]
    names, inertia = theirs["names"][live], theirs["inertia"][live]
    far = np.degrees(theirs["angles"][:, live])
    near = _at(
        times, run, run.rotor_angle_deg([str(name) for name in names], AngleReference.SYNCHRONOUS)
    )
    error = _moved(near, inertia) - _moved(far, inertia)
    by_machine = np.sqrt(np.mean(error**2, axis=0))
    units = [str(name) for name in theirs["converters"]]
    ratings = {str(g.key): g.base_mva / run.model.case.base_mva for g in run.model.case.generators}
    rating = np.array([ratings[unit] for unit in units])
    active = np.abs(_at(times, run, run.signal("active_power", units)) - theirs["active"]) / rating
    reactive = (
        np.abs(_at(times, run, run.signal("reactive_power", units)) - theirs["reactive"]) / rating
    )
    cleared = START + DURATION
    smooth = np.minimum(np.abs(times - START), np.abs(times - cleared)) > AROUND
    late, early = times > cleared + SETTLED, smooth & (times <= cleared + SETTLED)
    return Agreement(
        angle_rms=float(np.sqrt(np.mean(error**2))),
        angle_worst=float(by_machine.max()),
        angle_largest=float(np.abs(error).max()),
        active=float(active[late].max()),
        reactive=float(reactive[late].max()),
        early_active=float(active[early].max()),
        early_reactive=float(reactive[early].max()),
    )


def _at(
    times: NDArray[np.float64], run: Trajectory, values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Columns of a run at other times."""
    return np.column_stack([np.interp(times, run.times, column) for column in values.T])


def _moved(angles: NDArray[np.float64], inertia: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles against the centre of inertia, less their start."""
    relative = angles - (angles @ inertia / inertia.sum())[:, None]
    return np.asarray(relative - relative[0])


def measure(home: Path) -> tuple[Table, Agreement]:
    """Run ANDES once, gridfold as it is and with ANDES's convention of torque."""
    t_end = START + DURATION + AFTER
    with TemporaryDirectory() as folder:
        raw, dyr = write_changed(*Study("WECC240", RAW, DYR, BUS).paths, Path(folder))
        study = Study("WECC240", str(raw), str(dyr), BUS, START, DURATION)
        theirs = call_andes(home, study, [f"--t-end={t_end}", f"--step={THEIRS!r}"])
        found = {}
        for name in list(CONVENTIONS)[:2]:
            model = build(study, CONVENTIONS[name])
            run = simulate(model, [study.fault], t_end, RungeKutta4(OURS), criterion=None)
            found[name] = compare(theirs, run)
    rows = [(name, *one.row) for name, one in found.items()]
    caption = (
        f"{len(theirs['converters'])} converters and {len(run.model.machines)} machines; a fault at "
        f"bus {BUS} for {DURATION * 1e3:g} ms, and {AFTER:g} s after it. Angles in degrees, powers "
        f"over the rating, from {SETTLED:g} s after the clearing on and, as *early*, before:"
    )
    return Table(caption, HEADS, rows), next(iter(found.values()))


def main() -> str:
    """Measure and write the page; a message if something is absent."""
    missing = [path for path in Study("", RAW, DYR, BUS).paths if not path.is_file()]
    if missing:
        return f"{missing[0]} is absent; GRIDFOLD_CASES names the folder of public cases"
    homes = environments()
    if not homes:
        return f"there is no ANDES in {ENVIRONMENTS}; `make bench-peers` installs it"
    version, home = list(homes.items())[-1]
    table, asis = measure(home)
    goals = (
        Goal("angles, degrees RMS", asis.angle_rms, ANGLE),
        Goal("active power of converters, percent of the rating", 100 * asis.active, 100 * POWER),
        Goal(
            "reactive power of converters, percent of the rating", 100 * asis.reactive, 100 * POWER
        ),
    )
    parts = (
        "# WECC240 in gridfold and ANDES",
        f"{machine()} ANDES {version}. All of it: `make bench-peers`.",
        table,
        Table("Goals:", ("figure", "measured", "goal", "verdict"), [goal.row for goal in goals]),
    )
    write("wecc240.md", *parts)
    return "\n\n".join(map(str, parts))


if __name__ == "__main__":
    one_thread()
    print(main())
