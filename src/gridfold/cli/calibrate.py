"""The command that calibrates thresholds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import Annotated, Any

import typer

from gridfold.cli.console import (
    StageBars,
    out,
    say_basis,
    say_doubts,
    say_method,
    speaks_to_people,
    stage_bars,
    write_json_option,
)
from gridfold.cli.exit_codes import ExitCode
from gridfold.cli.option_groups import given, refuse
from gridfold.cli.options import (
    AngleNormOptions,
    AreaOptions,
    CaseOptions,
    CouplingOptions,
    JobsOption,
    JsonOption,
    ReductionOptions,
    RunOptions,
)
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.calibrate import Calibration, Threshold, ThresholdKind, check_runs
from gridfold.equivalents.calibrate import calibrate as run_calibration
from gridfold.equivalents.contingency_errors import AngleError, Contingency
from gridfold.equivalents.saved import reducer_record
from gridfold.errors import OptionError
from gridfold.grid.events import BusFault, Event
from gridfold.grid.selection import select_buses
from gridfold.grid.selection_text import as_ranges
from gridfold.io.event_places import any_name, numbering
from gridfold.io.event_records import event_record, parse_event
from gridfold.partition import Partition, couple, partition
from gridfold.reduction import Reducer
from gridfold.report.plain import PlainTable
from gridfold.runs.basis import basis_of
from gridfold.runs.clearing import critical_clearing_times
from gridfold.runs.clearing.rows import place_of
from gridfold.runs.method import Choice


class ThresholdChoice(Enum):
    """Thresholds by name."""

    COLUMN_NORM = "column-norm"
    PARTITIONED = "partitioned"
    WHOLE = "whole"


_KINDS = {choice: ThresholdKind[choice.name] for choice in ThresholdChoice}


def calibrate(
    source: CaseOptions,
    area: AreaOptions,
    runs: RunOptions,
    boundary: CouplingOptions,
    norm: AngleNormOptions,
    reduction: ReductionOptions,
    buses: Annotated[
        str | None,
        typer.Option(
            help="Buses with a fault, cleared at its own critical clearing time.",
            show_default="those of the study area, unless there is an --event",
        ),
    ] = None,
    event: Annotated[
        list[str] | None,
        typer.Option(help='Contingency as "KIND NAME=VALUE ..."; each --event is one of its own.'),
    ] = None,
    limit: Annotated[float, typer.Option(help="Limit of the RMS rotor-angle errors (deg).")] = 6.0,
    threshold: Annotated[
        list[ThresholdChoice] | None,
        typer.Option(help="What to calibrate; may be repeated.", show_default="all three"),
    ] = None,
    jobs: JobsOption = None,
    json: JsonOption = None,
) -> None:
    """Find the thresholds with which all rotor-angle errors in the study area stay below a limit.

    Exit code 1: a threshold was not found, because even its lowest value does not satisfy.

    Example: gridfold calibrate npcc --study-buses 1-36 --buses 1-36 --limit 6
    """
    what = [_KINDS[choice] for choice in threshold or ThresholdChoice]
    if set(what) == {ThresholdKind.WHOLE}:
        refuse(given(boundary) + given(reduction), "the threshold of the whole system")
    refuse(["--weights"] if reduction.weights else [], "the models of the paper")
    reducer = reduction.settings.build(ported=False)
    for text in event or []:
        parse_event(text, any_name)
    model = source.build()
    number = numbering(model.case)
    events = [parse_event(text, number) for text in event or []]
    study = area.find(model.case, source.case)
    faulted: Sequence[int] = [] if events else sorted(study)
    if buses is not None:
        faulted = select_buses(buses, model.case, "--buses", study)
    method = runs.choose(model)
    parts = partition(model, study)
    check_runs(parts, len(faulted) + len(events), runs.t_end, method.stepper)
    with stage_bars() as bars:
        result = run_calibration(
            parts,
            [*_critical(model, faulted, runs, method, jobs, bars), *events],
            runs.t_end,
            method.stepper,
            reducer,
            limit_deg=limit,
            what=what,
            column_norm=norm.given(couple(parts)),
            criterion=runs.criterion,
            workers=jobs,
            on_progress=lambda step: bars.show(*step),
            coupling=boundary.coupling or BoundaryCoupling.EXACT,
        )
    write_json_option(json, _record(parts, result, reducer) | method.record())
    if speaks_to_people(json):
        _print(result)
        say_basis(basis_of(model))
        say_method(method.reason)
        say_doubts(method.doubts)
    if any(found.value is None for found in result.thresholds.values()):
        raise typer.Exit(ExitCode.FAILED)


def _critical(
    model: DetailedModel,
    buses: Sequence[int],
    runs: RunOptions,
    method: Choice,
    jobs: int | None,
    bars: StageBars,
) -> list[Event]:
    """Faults at buses with their critical clearing times."""
    if not buses:
        return []
    times = critical_clearing_times(
        model,
        [BusFault(bus) for bus in buses],
        jobs,
        bars.counter("clearing times", len(buses)),
        longest=min(2.0, runs.t_end / 2),
        t_end=runs.t_end,
        stepper=method.stepper,
        criterion=runs.criterion,
    )
    if times.failed:
        first = times.failed[0]
        where = place_of(first.fault)
        raise OptionError(f"{where}: the clearing time cannot be found: {first.reason}")
    return [item.fault for item in times]


def _print(result: Calibration) -> None:
    table = PlainTable(title="Thresholds", title_justify="left")
    for name in ("threshold of", "value", "worst error", "the value before failed at", "runs", "s"):
        table.add_column(name, overflow="fold")
    for found in result.thresholds.values():
        table.add_row(
            found.kind.value,
            _value(result, found),
            _error(found.worst),
            _error(found.binding) if found.binding else "(the first value satisfies)",
            str(found.runs),
            f"{found.seconds:.1f}",
        )
    out.print(table)
    kept = ", ".join(map(str, result.kept)) or "none"
    out.print(f"Kept nonlinear with {result.column_norm:g} p.u.: {kept}.")
    count = result.detailed_runs - len(result.left_out)
    out.print(
        f"Limit {result.limit_deg:g} degrees RMS; {count} contingencies; {result.seconds:.1f} s."
    )
    for item in result.left_out:
        text = f"Left out, {item.status.value}: {_text(item.contingency)}"
        out.print(text, style="yellow")


def _value(result: Calibration, found: Threshold) -> str:
    if found.value is None:
        return "none: even the lowest fails"
    if found.kind is ThresholdKind.COLUMN_NORM:
        return f"{found.value:g} p.u., {result.coupling.siemens(found.value):g} S"
    return f"{found.value:g} degrees"


def _error(error: AngleError | None) -> str:
    if error is None:
        return ""
    ended = not math.isfinite(error.rms_deg)
    size = error.status.value if ended else f"{error.rms_deg:.2f} degrees"
    return f"{size}, machine {error.unit}, {_text(error.contingency)}"


def _text(contingency: Contingency) -> str:
    """A contingency as one would type it, without what is as by default."""
    texts = []
    for item in contingency:
        record = event_record(item)
        kind = record.pop("kind")
        usual = {name: getattr(type(item), name, None) for name in record}
        told = [f"{name}={value}" for name, value in record.items() if value != usual[name]]
        texts.append(" ".join([kind, *told]))
    return "; ".join(texts)


def _record(parts: Partition, result: Calibration, reducer: Reducer) -> dict[str, Any]:
    siemens = result.coupling.siemens
    thresholds = {}
    for choice, kind in _KINDS.items():
        found = result.thresholds.get(kind)
        if found is None:
            continue
        record: dict[str, Any] = {"value": found.value}
        if kind is ThresholdKind.COLUMN_NORM:
            record["siemens_at_20_kv"] = None if found.value is None else siemens(found.value)
        thresholds[choice.value] = record | {
            "binding": None if found.binding is None else _error_record(found.binding),
            "errors": [_error_record(error) for error in found.errors],
            "runs": found.runs,
            "seconds": found.seconds,
        }
    case = parts.model.case
    return {
        "case": case.name,
        "fingerprint": case.fingerprint,
        **basis_of(parts.model).record(),
        "study_buses": as_ranges(parts.study_buses),
        "limit_deg": result.limit_deg,
        "column_norm": result.column_norm,
        "coupling": result.boundary.value,
        "reducer": reducer_record(reducer),
        "kept": [str(unit) for unit in result.kept],
        "thresholds": thresholds,
        "left_out": [
            {"events": _events(item.contingency), "status": item.status.value}
            for item in result.left_out
        ],
        "detailed_runs": result.detailed_runs,
        "seconds": result.seconds,
    }


def _error_record(error: AngleError) -> dict[str, Any]:
    return {
        "events": _events(error.contingency),
        "unit": str(error.unit),
        "rms_deg": error.rms_deg if math.isfinite(error.rms_deg) else None,
        "status": error.status.value,
    }


def _events(contingency: Contingency) -> list[dict[str, Any]]:
    return [event_record(event) for event in contingency]
