"""The data card: where samples come from, what is in them, and how they were checked."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from gridfold.dynamics.model import build_model
from gridfold.errors import GridfoldError
from gridfold.io.sample_store import CURVES, SAMPLES, SampleStore
from gridfold.runs.method import choose_stepper
from gridfold.sampling.draw import filling
from gridfold.sampling.rows import INFEASIBLE, data_columns, labels
from gridfold.sampling.work import Sampler, counted
from gridfold.study.prepare import Prepared
from gridfold.study.solve import Task, solve
from gridfold.version import __version__

if TYPE_CHECKING:
    import pandas as pd

#: Packages that results may depend on.
_PACKAGES = ("numpy", "scipy", "numba")
#: Labels of which the largest difference is told where a sample is run anew.
_COMPARED = ("largest_separation_deg", "nadir_hz", "lowest_voltage", "damping_ratio")


def write_card(sampler: Sampler, store: SampleStore) -> None:
    """Write the card of what is there; samples are run anew where all are there."""
    record = card(sampler, store)
    store.write_card("\n".join(_lines(record)) + "\n", record)


def card(sampler: Sampler, store: SampleStore) -> dict[str, Any]:
    """The card, ready for JSON."""
    plan, frame = sampler.work.plan, store.frame()
    case, settings = sampler.prepared.model.case, store.identity["settings"]
    complete = len(frame) == plan.samples
    return {
        "name": plan.name,
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "grid": {
            "case": case.name,
            "fingerprint": case.fingerprint,
            "buses": len(case.buses),
            "branches": len(case.branches),
            "units": len(case.generators),
            "load_model": settings["load_model"],
            "models": dict(sorted(Counter(record.model for record in case.devices).items())),
        },
        "run": {key: settings[key] for key in ("method", "step", "method_reason")}
        | {"t_end": plan.run.t_end, **vars(plan.run.criterion)},
        "versions": {
            "gridfold": __version__,
            "sources": store.identity["sources"],
            "python": platform.python_version(),
            **{name: version(name) for name in _PACKAGES},
        },
        "files": store.identity["files"],
        "plan": plan.content(),
        "samples": {
            "wanted": plan.samples,
            "made": len(frame),
            **counted(_records(frame, ("status", "stable"))),
        },
        "infeasible_reasons": _reasons(frame),
        "columns": _columns(sampler, frame),
        "validation": {
            "validated": settings["validated"],
            "replacements": settings["replacements"],
            "warnings": settings["warnings"],
            "run_anew": _run_anew(sampler, frame) if complete else None,
        },
    }


def _records(frame: pd.DataFrame, columns: Sequence[str]) -> list[dict[str, Any]]:
    """Some columns of rows; what does not apply is None."""
    chosen = frame[list(columns)].astype(object)
    values = chosen.where(chosen.notna(), None).to_numpy().tolist()
    return [dict(zip(columns, row, strict=True)) for row in values]


def _reasons(frame: pd.DataFrame) -> dict[str, int]:
    """Beginnings of the reasons for which samples are infeasible, the most frequent first."""
    if not len(frame):
        return {}
    reasons = frame["reason"][frame["status"] == INFEASIBLE]
    return dict(Counter(reason.partition(";")[0][:120] for reason in reasons).most_common(10))


def _columns(sampler: Sampler, frame: pd.DataFrame) -> list[dict[str, Any]]:
    """What each column says, and between which values it lies."""
    found = []
    for name, column in data_columns(dict(sampler.work.plan.drawn)).items():
        record: dict[str, Any] = {
            "name": name,
            "role": column.role,
            "unit": column.unit,
            "meaning": column.meaning,
        }
        if column.kind in (int, float) and len(frame) and frame[name].notna().any():
            values = frame[name].astype("Float64").dropna()
            record |= {"lowest": float(values.min()), "highest": float(values.max())}
        found.append(record)
    return found


def _run_anew(sampler: Sampler, frame: pd.DataFrame) -> dict[str, Any]:
    """Some samples run anew from their cases alone, at the time step and at half of it."""
    plan = sampler.work.plan
    ran = frame[frame["stable"].notna()]
    count = min(plan.check.samples, len(ran))
    places = np.unique(np.linspace(0, len(ran) - 1, count).round().astype(int)).tolist()
    rows = filling(plan)
    apart: dict[str, float] = dict.fromkeys(_COMPARED, 0.0)
    finer: dict[str, float] = dict.fromkeys(_COMPARED, 0.0)
    same = stable = 0
    for there in _records(ran.iloc[places], ("number", "status", "stable", *_COMPARED)):
        number = int(there["number"])
        again, half = _single(sampler, number, rows[number - 1])
        same += again["status"] == there["status"]
        stable += half["stable"] == there["stable"]
        _widen(apart, there, again)
        if half["stable"] and there["stable"]:
            _widen(finer, there, half)
    return {
        "samples": len(places),
        "same_status": int(same),
        "largest_difference": apart,
        "same_verdict_at_half_step": int(stable),
        "largest_difference_of_stable_at_half_step": finer,
    }


def _widen(largest: dict[str, float], first: Mapping[str, Any], second: Mapping[str, Any]) -> None:
    """Take up how far two rows of labels are apart."""
    for name in largest:
        values = first[name], second[name]
        if None not in values:
            largest[name] = max(largest[name], abs(float(values[0]) - float(values[1])))


def _single(
    sampler: Sampler, number: int, row: np.ndarray[Any, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Labels of a sample whose model is built from its case, at the time step and at half of it."""
    drawn = sampler.draw(number, row)
    base = sampler.prepared.model
    try:
        model = build_model(
            sampler.case(drawn),
            devices=sampler.work.offline.devices,
            on_limit=base.on_limit,
            loads=base.loads,
        )
    except GridfoldError as error:
        lost = {"status": INFEASIBLE, "stable": None, "reason": str(error)}
        return {**dict.fromkeys(_COMPARED), **lost}, {**dict.fromkeys(_COMPARED), **lost}
    ready = replace(sampler.prepared, model=model, intact={model.state: model})
    task = Task(drawn.contingency, check=False)
    return labels(solve(ready, task).figures), labels(solve(_halved(ready), task).figures)


def _halved(ready: Prepared) -> Prepared:
    """The same at half the time step, without clearing times."""
    before = ready.method.stepper
    stepper = choose_stepper(ready.model, before.name, before.step / 2).stepper
    method = replace(ready.method, stepper=stepper)
    times = ready.study.clearing_times.model_copy(update={"wanted": False})
    study = ready.study.model_copy(update={"clearing_times": times})
    return replace(ready, method=method, study=study)


def _lines(record: Mapping[str, Any]) -> Iterator[str]:
    """The card as Markdown."""
    grid, run, samples, plan = (record[key] for key in ("grid", "run", "samples", "plan"))
    yield f"# {record['name']}"
    yield ""
    yield (
        f"{samples['made']:,} of {samples['wanted']:,} samples of transient stability on the grid "
        f"{grid['case']}: an operating point and a fault each, with labels from a simulation of "
        f"{run['t_end']:g} s. Made by gridfold {record['versions']['gridfold']}, {record['made']}."
    )
    yield from ("", "## Samples", "", "| | |", "|---|---|")
    for kind in ("stable", "unstable", "infeasible", "failed"):
        yield f"| {kind} | {samples[kind]:,} |"
    yield ""
    yield (
        f"Seed {plan['seed']}, {plan['filling'].replace('_', ' ')}. What is drawn for a sample follows "
        "from the seed and its number. An infeasible sample has no operating point: no solution of the "
        "power flow, or a machine beyond a limit; it is a row without labels, with the reason."
    )
    if record["infeasible_reasons"]:
        yield from ("", "| Infeasible because | Samples |", "|---|---|")
        for reason, count in record["infeasible_reasons"].items():
            yield f"| {_cell(reason)} | {count:,} |"
    yield from ("", "## Grid and models", "")
    yield f"{grid['buses']:,} buses, {grid['branches']:,} branches, {grid['units']:,} units; "
    yield f"loads: {grid['load_model']}. SHA-256 of the data: `{grid['fingerprint']}`."
    yield from ("", "| Model | Units |", "|---|---|")
    for model, count in grid["models"].items():
        yield f"| {_cell(model)} | {count:,} |"
    yield ""
    yield f"Integration: {run['method']} at {run['step']:g} s ({run['method_reason']})."
    yield from (
        "",
        "## Columns",
        "",
        f"Parquet files in `{SAMPLES}/`, curves in `{CURVES}/` if kept.",
    )
    yield from (
        "",
        "| Column | Role | Unit | Meaning | Lowest | Highest |",
        "|---|---|---|---|---|---|",
    )
    for column in record["columns"]:
        ends = (f"{column[end]:.6g}" if end in column else "" for end in ("lowest", "highest"))
        cells = (f"`{column['name']}`", column["role"], column["unit"], column["meaning"], *ends)
        yield f"| {' | '.join(cells)} |"
    yield from ("", "## Validation", "")
    yield from _validation(record["validation"])
    yield from ("", "## Versions", "", "| | |", "|---|---|")
    for name, text in record["versions"].items():
        yield f"| {name} | `{text}` |"


def _validation(found: Mapping[str, Any]) -> Iterator[str]:
    if found["validated"]:
        yield "Every record of the grid that acts has the model that its files ask for."
    else:
        yield "Not validated: some dynamic data were replaced or left out, see `card.json`."
    anew = found["run_anew"]
    if not anew or not anew["samples"]:
        yield "No sample was run anew."
        return
    count = anew["samples"]
    yield ""
    yield (
        f"{count} samples were run anew, each model built from its case alone: "
        f"{anew['same_status']} of {count} end alike. At half the time step "
        f"{anew['same_verdict_at_half_step']} of {count} have the same verdict."
    )
    yield from (
        "",
        "| Largest difference of | Run anew | Stable, at half the step |",
        "|---|---|---|",
    )
    half = anew["largest_difference_of_stable_at_half_step"]
    for name, value in anew["largest_difference"].items():
        yield f"| `{name}` | {value:.2g} | {half[name]:.2g} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
