"""Commands that simulate."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from gridfold.cli.choice import ModelChoice, StudyArea
from gridfold.cli.console import (
    EXIT_CODES,
    AngleDegOption,
    AngleLimitOption,
    CaseArgument,
    ColumnNormOption,
    EndOption,
    JsonOption,
    LongestAboveOption,
    Method,
    MethodOption,
    ModelKind,
    ModelOption,
    OrderOption,
    ReducedFileOption,
    StepOption,
    StudyAreasOption,
    StudyBusesOption,
    StudyZonesOption,
    ToleranceOption,
    exit_code,
    make_stepper,
    out,
    speaks_to_people,
    write_json_option,
)
from gridfold.cli.outcome import Disturbance, ranked
from gridfold.dynamics.model import build_model
from gridfold.dynamics.network import NetworkBackend
from gridfold.errors import OptionError
from gridfold.grid.events import BusFault, Event
from gridfold.io.case_folder import load_case
from gridfold.io.event_records import load_events, parse_event
from gridfold.report.plots import plot_trajectory
from gridfold.report.style import check_format
from gridfold.report.tables import (
    case_facts,
    facts_table,
    model_facts,
    notice_table,
    run_facts,
    swing_table,
)
from gridfold.studies.clearing_time import critical_clearing_time
from gridfold.studies.simulate import simulate as run_simulation
from gridfold.studies.summary import Summary, summarize
from gridfold.studies.synchronism import SynchronismCriterion
from gridfold.studies.trajectory import Trajectory
from gridfold.systems.status import Status

#: Machines with the largest errors that a picture shows in colour.
_DRAWN = 6

_SIMULATE_HELP = f"""Simulate a disturbance on the detailed or a reduced model of CASE.

Examples:

  gridfold simulate npcc --fault-bus 3 --fault-start 0 --fault-duration 0.2 --csv out.csv

  gridfold simulate npcc --event "branch-fault branch=3-2 duration=0.1" --plot run.png

  gridfold simulate npcc --events events.toml --t-end 20 --method abm4 --json -

  gridfold simulate npcc --fault-bus 3 --model adaptive --study-buses 1-36 --compare

{EXIT_CODES}
"""


def demo(
    folder: Annotated[Path, typer.Option("--out", help="Folder for the results.")] = Path(
        "gridfold-demo"
    ),
) -> None:
    """Simulate a three-phase fault at bus 3 of the built-in NPCC system, print and draw it."""
    began = time.perf_counter()
    model = build_model(load_case("npcc"))
    out.print(facts_table(case_facts(model.case) | model_facts(model, _residual(model))))
    fault = BusFault(bus=3, start=1.0, duration=0.2)
    run = run_simulation(model, [fault], t_end=16.0)
    critical = critical_clearing_time(model, BusFault(bus=3))
    summary = summarize(run)
    out.print()
    out.print(notice_table(run))
    _print_run(run, summary)
    out.print(facts_table({"Critical clearing time": f"{critical.seconds:g} s for this fault"}))
    run.to_csv(folder / "bus3.csv")
    plot_trajectory(run, folder / "bus3.png")
    out.print()
    files = {"Curves": str(folder / "bus3.csv"), "Picture": str(folder / "bus3.png")}
    out.print(facts_table(files | {"All of it took": f"{time.perf_counter() - began:.1f} s"}))


def simulate(
    case: CaseArgument,
    fault_bus: Annotated[int | None, typer.Option(help="Bus with a three-phase fault.")] = None,
    fault_start: Annotated[
        float | None, typer.Option(help="Time of that fault (s).", show_default="0")
    ] = None,
    fault_duration: Annotated[
        float | None, typer.Option(help="Its duration (s).", show_default="0.1")
    ] = None,
    fault_resistance: Annotated[
        float | None, typer.Option(help="Its resistance (p.u.).", show_default="0")
    ] = None,
    fault_reactance: Annotated[
        float | None, typer.Option(help="Its reactance (p.u.).", show_default="0")
    ] = None,
    trip_bus: Annotated[
        bool, typer.Option("--trip-bus", help="Cleared by tripping the bus.")
    ] = False,
    event: Annotated[
        list[str] | None, typer.Option(help='Event as "KIND NAME=VALUE ..."; may be repeated.')
    ] = None,
    events: Annotated[
        Path | None, typer.Option(help="TOML file with \\[\\[event]] tables.")
    ] = None,
    t_end: EndOption = 16.0,
    step: StepOption = None,
    method: MethodOption = Method.RK4,
    angle_limit: AngleLimitOption = 180.0,
    no_watch: Annotated[
        bool, typer.Option("--no-watch", help="Go on after loss of synchronism.")
    ] = False,
    network: Annotated[NetworkBackend, typer.Option(help="Network solver.")] = NetworkBackend.AUTO,
    model: ModelOption = ModelKind.DETAILED,
    study_buses: StudyBusesOption = None,
    study_areas: StudyAreasOption = None,
    study_zones: StudyZonesOption = None,
    column_norm: ColumnNormOption = None,
    tolerance: ToleranceOption = None,
    order: OrderOption = None,
    angle_deg: AngleDegOption = None,
    longest_above: LongestAboveOption = None,
    reduced: ReducedFileOption = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Errors against a detailed run of the same.")
    ] = False,
    csv: Annotated[Path | None, typer.Option(help="Write the curves as CSV.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Write the curves as Parquet.")] = None,
    npz: Annotated[Path | None, typer.Option(help="Write all states as a NumPy archive.")] = None,
    signals: Annotated[str, typer.Option(help="Further columns, such as field_voltage.")] = "",
    plot: Annotated[list[Path] | None, typer.Option(help="Draw the run (.png or .svg).")] = None,
    json: JsonOption = None,
) -> None:
    """Simulate a disturbance."""
    began = time.perf_counter()
    fault = {
        "start": fault_start,
        "duration": fault_duration,
        "resistance": fault_resistance,
        "reactance": fault_reactance,
        "trip_bus": trip_bus or None,
    }
    happenings = _bus_fault(fault_bus, fault) + _events(event, events)
    stepper = make_stepper(method, step)
    criterion = None if no_watch else SynchronismCriterion(angle_limit)
    for picture in plot or []:
        check_format(picture)
    area = StudyArea(study_buses, study_areas, study_zones)
    choice = ModelChoice(
        model, area, column_norm, order, tolerance, angle_deg, longest_above, reduced
    )
    if compare and model is ModelKind.DETAILED:
        raise OptionError("--compare needs a reduced model, see --model")
    grid = build_model(load_case(case), backend=network)
    ready = time.perf_counter()
    task = Disturbance(grid, happenings, t_end, stepper, criterion)
    result = task.solve(choice.build(grid, case), compare)
    run, comparison = result.run, result.comparison
    names = [name.strip() for name in signals.split(",") if name.strip()]
    _write(run, csv, parquet, npz, names)
    worst = [] if comparison is None else ranked(comparison)[:_DRAWN]
    for picture in plot or []:
        plot_trajectory(run, picture, [error.unit for error in worst], result.detailed)
    summary = summarize(run)
    record = _run_record(run, summary, ready - began + run.setup_seconds)
    write_json_option(json, record | result.record())
    if speaks_to_people(json):
        out.print(notice_table(run))
        _print_run(run, summary)
        result.show()
    raise typer.Exit(exit_code(run.status))


simulate.__doc__ = _SIMULATE_HELP


def _bus_fault(bus: int | None, fields: dict[str, Any]) -> list[Event]:
    """The fault of the --fault-... options; those not given keep the event's own defaults."""
    given = {name: value for name, value in fields.items() if value is not None}
    if bus is not None:
        return [BusFault(bus, **given)]
    if given:
        raise OptionError(f"a fault needs --fault-bus (its {', '.join(given)} is given)")
    return []


def _events(texts: list[str] | None, path: Path | None) -> list[Event]:
    happenings = [] if path is None else load_events(path)
    return happenings + [parse_event(text) for text in texts or []]


def _write(
    run: Trajectory, csv: Path | None, parquet: Path | None, npz: Path | None, names: list[str]
) -> None:
    if csv is not None:
        run.to_csv(csv, names)
    if parquet is not None:
        run.to_parquet(parquet, names)
    if npz is not None:
        run.to_npz(npz)


def _print_run(run: Trajectory, summary: Summary) -> None:
    for warning in run.model.warnings:
        out.print(f"warning: {warning}", style="yellow", markup=False)
    out.print(swing_table(summary))
    out.print(facts_table(run_facts(run, summary)))


def _run_record(run: Trajectory, summary: Summary, setup_seconds: float) -> dict[str, Any]:
    record = run.metadata()
    record |= {
        "stable": None if run.criterion is None else run.status is Status.COMPLETED,
        "setup_seconds": setup_seconds,
        "simulation_seconds": run.simulation_seconds,
        "states": run.model.n_states,
        "machines": len(run.model.machines),
        "buses": len(run.model.case.buses),
        "lowest_voltage": asdict(summary.lowest_voltage),
        "highest_voltage": asdict(summary.highest_voltage),
        "swings": [asdict(swing) | {"unit": str(swing.unit)} for swing in summary.swings],
    }
    return record


def _residual(model: Any) -> float:
    return float(np.abs(model.compiled(model.x0)).max())
