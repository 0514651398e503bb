"""Small stores of studies, written without a simulation."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gridfold.grid.criteria import Criterion, LeastDamping, VoltageDip, VoltageRecovery
from gridfold.io.study_store import Result, StudyStore
from gridfold.runs.criteria import Finding, Verdict
from gridfold.study.judged import judged_figures
from gridfold.study.study_file import Study
from gridfold.study.summary import Figures, column_types

#: Would end the record's script, be an element, or markup of Plotly, if it were not escaped.
WICKED = "</script><b>wicked</b> & <a href='http://127.0.0.1/'>x</a>"
#: Machines of the study area.
UNITS = ("1:1", "2:1", WICKED)

SETTINGS: dict[str, Any] = {
    "model": "adaptive",
    "method": "rk4",
    "step": 0.01,
    "method_reason": "asked for",
    "study_buses": "1-2",
    "machines": 3,
    "states": 27,
    "warnings": ["a warning"],
    "validated": True,
    "load_model": "z",
    "replacements": [],
    "unsupported": [],
    "limits_moved": [],
    "case_notices": [],
    "column_norm": 1.0,
    "angle_deg": 67.0,
    "kept": ["3:1"],
    "tie_lines": 1,
    "external_machines": 1,
    "order": 5,
    "bound": 1e-5,
}
REPLACED = {
    "validated": False,
    "replacements": [
        {
            "model": "GENTRA",
            "outcome": "replaced by a classical machine",
            "records": 2,
            "first": "3:1",
            "active_mw": 10.0,
            "share": 0.25,
            "of": "generation",
        }
    ],
}


def new_store(folder: Path, count: int = 4, case: str = "npcc", **settings: Any) -> StudyStore:
    """A store of faults at buses 1, 2, 3, ...; the fourth has a name that needs escaping."""
    identity = {
        "gridfold": "0.1.0",
        "case": case,
        "fingerprint": "f" * 64,
        "study_hash": "0" * 64,
        "study": Study(name="two <areas>").content(),
        "settings": SETTINGS | settings,
        "map": grid(),
    }
    return StudyStore.create(
        folder, identity, [fault(number) for number in range(1, count + 1)], column_types()
    )


def finish(store: StudyStore) -> None:
    """Note the end of a run."""
    last = {"workers": "1 thread", "machine": "Linux", "python": "3.11", "numpy": "2.0"}
    store.tell("last_run", last | {"finished": "2026-01-01T00:00:00+00:00"})


def fault(number: int) -> dict[str, Any]:
    """A contingency."""
    event = {"kind": "bus-fault", "bus": number, "start": 0.0, "duration": 0.1}
    event |= {"resistance": 0.0, "reactance": 0.0, "trip_bus": False}
    name = f"bus {number}" if number != 4 else f"bus 4 {WICKED}"
    return {"number": number, "name": name, "kind": "bus fault", "events": [event]}


def grid() -> dict[str, Any]:
    """Five buses in a row; the first two are the study area."""
    buses = [
        {"number": k, "name": f"B{k}", "x": float(k), "y": 0.0, "study": k < 3, "machine": k < 4}
        for k in range(1, 6)
    ]
    return {"geographic": False, "buses": buses, "branches": [[k, k + 1] for k in range(1, 5)]}


def stable(number: int, separation: float, checked: bool = False, **further: Any) -> Result:
    """A contingency that keeps synchronism."""
    figures = Figures(
        status="completed",
        stable=True,
        ended_at=2.0,
        critical_machine="1:1",
        largest_separation_deg=separation,
        lowest_voltage=0.9,
        detailed_s=0.1,
        linear_s=1.9,
        notices='[[0.0, "fault"]]',
        **further,
    )
    row = asdict(figures)
    if checked:
        row |= {"checked": "completed", "error_rms_deg": 1.25, "error_largest_deg": 2.5}
        row["error_machine"] = "2:1"
    return Result(number, row, curves(checked))


def unstable(number: int, separation: float) -> Result:
    """A contingency that loses synchronism."""
    figures = Figures(
        status="lost synchronism",
        stable=False,
        ended_at=0.5,
        reason="lost synchronism: rotor_angle:2:1 at 0.5 s",
        critical_machine="2:1",
        largest_separation_deg=separation,
        notices="[]",
    )
    return Result(number, asdict(figures), curves(checked=False) | watched())


def failed(number: int, reason: str = "the model does not start") -> Result:
    """A contingency that could not be simulated."""
    return Result(number, asdict(Figures(status="failed", reason=reason)))


def curves(checked: bool) -> dict[str, Any]:
    """Sines, with a machine that is out of service from the middle on."""
    times = np.linspace(0, 2, 41).astype(np.float32)
    angles = np.stack([30 * np.sin(4 * times + k) for k in range(len(UNITS))], axis=1)
    angles[20:, 2] = np.nan
    found: dict[str, Any] = {
        "run_times": times,
        "run_angles": angles.astype(np.float32),
        "units": np.array(UNITS),
        "switch_times": np.array([0.0, 0.1]),
        "switch_models": np.array(["detailed", "retained"]),
        "switch_reasons": np.array(["fault on", "within the threshold"]),
    }
    if checked:
        for name in ("detailed", "linear"):
            found |= {f"{name}_times": times, f"{name}_angles": found["run_angles"] + 1}
        found["error"] = np.full(len(times), 1.5, np.float32)
    return found


def watched() -> dict[str, Any]:
    """A flow of 1000 MW, two voltages, the second of a bus without one, and an interface."""
    times = np.linspace(0, 2, 41).astype(np.float32)
    values = np.stack([500 * times, 0.9 + 0.05 * times, np.full(41, np.nan), -3 * times])
    return {
        "watched_names": np.array(
            ["p_mw:1-2", "voltage_pu:7", "voltage_pu:9", f"interface_mw:{WICKED}"]
        ),
        "watched_values": values.astype(np.float32),
        "watched_times": times,
        "watched_left_out": np.array(4),
    }


def legend_study(folder: Path) -> StudyStore:
    """A finished study: of the first one twelve curves of two kinds each were watched, then one."""
    times = np.linspace(0, 2, 41).astype(np.float32)

    def of(names: list[str]) -> dict[str, Any]:
        return {
            "watched_names": np.array(names),
            "watched_values": np.outer(np.arange(1.0, len(names) + 1), times).astype(np.float32),
            "watched_times": times,
            "watched_left_out": np.array(0),
        }

    many = [f"p_mw:{k}-2002:1" for k in range(1001, 1013)]
    many += [f"voltage_pu:{k}" for k in range(1001, 1013)]
    store = new_store(folder, 7)
    for result, names in ((unstable(1, 200.0), many), (unstable(2, 190.0), ["voltage_pu:1007"])):
        store.add([result._replace(curves={**result.curves, **of(names)})])
    store.add([stable(number, 30.0 + number) for number in range(3, 8)])
    finish(store)
    return store


def small_study(folder: Path) -> StudyStore:
    """A finished study: a stable one that is checked, two unstable ones, a failed one, one more."""
    store = new_store(folder, 5)
    store.add(
        [
            stable(1, 40.0, checked=True, critical_clearing_time=0.12, clearing_time_bounded=True),
            unstable(2, 200.0),
            failed(3),
            unstable(4, 210.0),
            stable(5, 50.0, critical_clearing_time=0.2, clearing_time_bounded=False),
        ]
    )
    finish(store)
    return store


#: Criteria of :func:`judged_study`.
ASKED: tuple[Criterion, ...] = (
    VoltageRecovery(0.9, 1.0),
    LeastDamping(3.0),
    VoltageDip(0.7, name=WICKED),
)


def findings(voltage: float, damping: float | None) -> tuple[Finding, ...]:
    """What the criteria say of a run with a lowest voltage (p.u.), and a damping in %."""
    back, least, dip = ASKED
    share = (voltage - 0.7) / 0.7
    verdict = Verdict.VIOLATED if voltage < 0.7 else Verdict.KEPT
    took = "s", "voltage_pu:5", "bus 5", 0.42, "bus 5 is back after 0.32 s"
    low = "p.u.", "voltage_pu:5", "bus 5", 0.1, f"lowest voltage {voltage:g} p.u. at bus 5"
    damped = Finding(least, Verdict.OPEN, told="the run ended at 0.5 s: lost synchronism")
    if damping is not None:
        seen = Verdict.VIOLATED if damping < 3 else Verdict.KEPT
        margin = damping - 3
        damped = Finding(
            least, seen, damping, 3.0, margin, margin / 3, "%", told="machine 1:1 swings"
        )
    return (
        Finding(back, Verdict.KEPT, 0.32, 1.0, 0.68, 0.68, *took),
        damped,
        Finding(dip, verdict, voltage, 0.7, voltage - 0.7, share, *low, notes=("a note",)),
    )


def decided() -> dict[str, Any]:
    """A machine outside the study area that was lost, and the voltage of a bus."""
    times = np.linspace(0, 2, 41).astype(np.float32)
    angles = np.stack([30 * np.sin(4 * times), 10 * times, 90 * times + 5], axis=1)
    return {
        "run_angles": angles.astype(np.float32),
        "units": np.array(["1:1", "2:1", "9:1"]),
        "units_outside": np.array(["9:1"]),
        "decided_names": np.array(["voltage_pu:5", "speed_pu:9:1"]),
        "decided_values": np.stack([0.6 + 0.2 * times, 1 + 0.05 * times]).astype(np.float32),
        "decided_times": times,
        "limit_names": np.array(["voltage_pu", "speed_pu"]),
        "limit_values": np.array([0.9, 1.12]),
    }


def judged_study(folder: Path) -> StudyStore:
    """A study with criteria: the machine that decided no. 2 lies outside the study area."""
    store = new_store(folder, 4)
    lost = unstable(2, 200.0)
    figures = lost.figures | {"critical_machine": "9:1", "largest_angle_deg": 185.0}
    figures |= {"reason": "lost synchronism: rotor_angle:9:1 at 0.5 s"}
    kept, still = findings(0.9, 5.0), findings(0.65, 2.9)
    first, third = stable(1, 60.0, checked=True), stable(3, 40.0)
    checked = {"checked_violated": str(ASKED[1]), "error_damping_ratio": 0.002}
    store.add(
        [
            first._replace(figures=first.figures | judged_figures(kept) | checked),
            lost._replace(
                figures=figures | judged_figures(findings(0.5, None)),
                curves={**lost.curves, **decided()},
            ),
            third._replace(figures=third.figures | judged_figures(still, error_deg=1.0)),
            failed(4),
        ]
    )
    finish(store)
    return store


def large_study(folder: Path, count: int) -> StudyStore:
    """Many contingencies with long names, each with criteria; none has curves."""
    identity = {"gridfold": "0.1.0", "case": "other", "fingerprint": "f" * 64}
    identity |= {"study": Study(name="large").content(), "settings": SETTINGS, "map": grid()}
    listed = [fault(number) for number in range(1, count + 1)]
    for item in listed:
        item["name"] = f"line {1000 + item['number']}-{2000 + item['number']}:1 at the far end"
    store = StudyStore.create(folder, identity | {"study_hash": "0" * 64}, listed, column_types())
    rows = []
    for number in range(1, count + 1):
        row = stable(number, 40.0 + number / 100)
        found = findings(0.65 if number % 7 == 0 else 0.9, 2.0 if number % 11 == 0 else 5.0)
        rows.append(Result(number, row.figures | judged_figures(found)))
    store.add(rows)
    finish(store)
    return store
