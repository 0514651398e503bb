"""Commands that simulate."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from gridfold.cli.choice import ModelChoice
from gridfold.cli.console import (
    err,
    exit_code,
    out,
    say_approximate,
    say_basis,
    say_method,
    say_model,
    speaks_to_people,
    write_json_option,
)
from gridfold.cli.criteria import CriteriaOptions
from gridfold.cli.exit_codes import EXIT_CODES
from gridfold.cli.options import CaseOptions, JsonOption, RunOptions, run_option
from gridfold.cli.outcome import Disturbance, Outcome, ranked
from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.network import NetworkBackend
from gridfold.equivalents.auto import Work
from gridfold.equivalents.model_kind import ModelKind
from gridfold.errors import OptionError
from gridfold.grid.criterion_checks import check_criteria
from gridfold.grid.events import BusFault, Event
from gridfold.io.case_folder import read_case
from gridfold.io.comtrade import check_name
from gridfold.io.event_places import Numbering, any_name, numbering
from gridfold.io.event_records import (
    event_from_record,
    events_of,
    parse_event,
    read_tables,
    relays_of,
)
from gridfold.io.results import check_target
from gridfold.report.criteria_tables import criteria_table
from gridfold.report.curves import draw_curves, run_curves
from gridfold.report.plots import plot_trajectory
from gridfold.report.style import check_format, save_figure
from gridfold.report.tables import (
    case_facts,
    extremes_table,
    facts_table,
    model_facts,
    notice_table,
    run_facts,
    swing_table,
)
from gridfold.runs.basis import basis_of
from gridfold.runs.clearing import critical_clearing_time
from gridfold.runs.criteria import Verdict, judge
from gridfold.runs.monitor import DEFAULT_MONITOR, Columns, monitored, parse_monitor
from gridfold.runs.monitor.columns import column_filter
from gridfold.runs.monitor.extremes import extremes
from gridfold.runs.simulate import simulate as run_simulation
from gridfold.runs.summary import Summary, summarize
from gridfold.runs.table_files import TableFile, TableFormat
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: Machines with the largest errors that a picture shows in colour.
_DRAWN = 6

_event_option = partial(typer.Option, rich_help_panel="Disturbance")
_result_option = partial(typer.Option, rich_help_panel="Results")

_SIMULATE_HELP = f"""Simulate a disturbance on the detailed or a reduced model of CASE.

Examples:

  gridfold simulate npcc --fault-bus 3 --fault-start 0 --fault-duration 0.2 --csv out.csv

  gridfold simulate npcc --event "branch-fault branch=3-2 duration=0.1" --plot run.png

  gridfold simulate npcc --events events.toml --t-end 20 --method abm4 --json -

  gridfold simulate npcc --event "load-shed areas=1 share=0.1 time=1" --relays relays.toml

  gridfold simulate npcc --fault-bus 3 --monitor "flow 3-2, voltage area:1" --csv out.csv

  gridfold simulate npcc --fault-bus 3 --criterion "voltage back to 0.9 within 1 s"

  gridfold simulate npcc --fault-bus 3 --model adaptive --study-buses 1-36 --compare

  gridfold simulate npcc --fault-bus 3 --model linear --coupling lagged --budget

{EXIT_CODES}
"""


@dataclass(frozen=True)
class EventOptions:
    """What happens to the network."""

    fault_bus: Annotated[
        str | None, _event_option(help="Bus with a three-phase fault, by number or name.")
    ] = None
    fault_start: Annotated[
        float | None, _event_option(help="Time of that fault (s).", show_default="0")
    ] = None
    fault_duration: Annotated[
        float | None, _event_option(help="Its duration (s).", show_default="0.1")
    ] = None
    fault_resistance: Annotated[
        float | None, _event_option(help="Its resistance (p.u.).", show_default="0")
    ] = None
    fault_reactance: Annotated[
        float | None, _event_option(help="Its reactance (p.u.).", show_default="0")
    ] = None
    trip_bus: Annotated[bool, _event_option("--trip-bus", help="Cleared by tripping the bus.")] = (
        False
    )
    event: Annotated[
        list[str] | None, _event_option(help='Event as "KIND NAME=VALUE ..."; may be repeated.')
    ] = None
    events: Annotated[Path | None, _event_option(help="TOML file with \\[\\[event]] tables.")] = (
        None
    )
    relays: Annotated[
        Path | None,
        _event_option(help="TOML file with \\[\\[relays]] tables, which watch the run."),
    ] = None

    def collect(self, number: Numbering = any_name) -> list[Event]:
        """All events, that of the --fault-... options first, and the relays."""
        events, relays = self._tables
        return [
            *self._bus_fault(number),
            *events_of(events, f"{self.events}: ", number),
            *(parse_event(text, number) for text in self.event or []),
            *relays_of(relays, f"{self.relays}: ", number),
        ]

    @cached_property
    def _tables(self) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Records of events and of relays from the files, which are read once."""
        events = [] if self.events is None else read_tables(self.events, "event")
        return events, [] if self.relays is None else read_tables(self.relays, "relays")

    def _bus_fault(self, number: Numbering) -> list[Event]:
        """The fault of the --fault-... options; those not given keep the event's own defaults."""
        fields: dict[str, Any] = {
            "start": self.fault_start,
            "duration": self.fault_duration,
            "resistance": self.fault_resistance,
            "reactance": self.fault_reactance,
            "trip_bus": self.trip_bus or None,
        }
        given = {name: value for name, value in fields.items() if value is not None}
        if self.fault_bus is not None:
            record = {"kind": "bus-fault", "bus": self.fault_bus, **given}
            return [event_from_record(record, "--fault-bus", number)]
        if given:
            raise OptionError(f"a fault needs --fault-bus (its {', '.join(given)} is given)")
        return []


@dataclass(frozen=True)
class ResultOptions:
    """Files of a run."""

    csv: Annotated[Path | None, _result_option(help="Write the curves as CSV.")] = None
    parquet: Annotated[Path | None, _result_option(help="Write the curves as Parquet.")] = None
    npz: Annotated[Path | None, _result_option(help="Write all states as a NumPy archive.")] = None
    comtrade: Annotated[
        Path | None, _result_option(help="Write the curves in COMTRADE (.cfg, and .dat beside it).")
    ] = None
    monitor: Annotated[
        str | None,
        _result_option(
            help="What is watched, such as 'flow 101-103, voltage area:1, every 5': columns of tables, "
            "panels of pictures; without these, a table of extremes.",
            show_default=DEFAULT_MONITOR,
        ),
    ] = None
    signals: Annotated[str | None, _result_option(hidden=True)] = None
    columns: Annotated[str | None, _result_option(hidden=True)] = None
    plot: Annotated[list[Path] | None, _result_option(help="Draw the run (.png or .svg).")] = None

    def __post_init__(self) -> None:
        for picture in self.plot or []:
            check_format(picture)
        if self.comtrade is not None:
            check_name(self.comtrade)
        for path in (self.csv, self.parquet, self.npz, self.comtrade, *(self.plot or [])):
            if path is not None:
                check_target(path)
        given = [
            name for name in ("monitor", "signals", "columns") if getattr(self, name) is not None
        ]
        if len(given) > 1:
            raise OptionError(f"give --{given[0]} or --{given[1]}, not both")
        if self.monitor is not None:
            parse_monitor(self.monitor, "--monitor")

    @property
    def whole(self) -> bool:
        """Whether they need the whole run at once."""
        return bool(self.npz or self.comtrade or self.plot) or self.printed

    @property
    def printed(self) -> bool:
        """Whether what is watched is told as a table: no file takes it."""
        return self._watching and not (self.csv or self.parquet or self.comtrade or self.plot)

    @property
    def _watching(self) -> bool:
        return not self.monitor is self.signals is self.columns is None

    def watched(self, model: DetailedModel, study: frozenset[int] | None) -> Columns:
        """What is watched of a run of `model` with a study area."""
        if self.columns is not None:
            _tell_old("--columns", "--monitor, such as 'speed, voltage 3'")
            return column_filter(model, _names(self.columns))
        text = self.monitor or DEFAULT_MONITOR
        if self.signals is not None:
            text = ", ".join([DEFAULT_MONITOR, *_names(self.signals)])
            _tell_old("--signals", f"--monitor '{text}'")
        return monitored(model, text, study, "--monitor")

    def tables(self, columns: Columns) -> list[TableFile]:
        """Tables of a run."""
        paths = ((TableFormat.CSV, self.csv), (TableFormat.PARQUET, self.parquet))
        return [TableFile(path, form, columns) for form, path in paths if path is not None]

    def write(self, run: Trajectory, columns: Columns) -> None:
        """Write the curves."""
        for table in self.tables(columns):
            run.write_table(table)
        if self.npz is not None:
            run.to_npz(self.npz)
        if self.comtrade is not None:
            run.write_comtrade(self.comtrade, columns)

    def draw(self, result: Outcome, columns: Columns) -> None:
        """Draw what is watched, or the machines with the largest errors in colour."""
        if not self.plot:
            return
        if self._watching:
            figure = draw_curves(run_curves(result.run, columns))
            for picture in self.plot:
                save_figure(figure, picture)
            return
        worst = [] if result.comparison is None else ranked(result.comparison)[:_DRAWN]
        for picture in self.plot:
            plot_trajectory(result.run, picture, [error.unit for error in worst], result.detailed)


def _tell_old(name: str, now: str) -> None:
    """Tell of an option that goes with the next release."""
    err.print(f"warning: {name} is now {now}; the next release knows it no more", style="yellow")


def demo(
    folder: Annotated[Path, typer.Option("--out", help="Folder for the results.")] = Path(
        "gridfold-demo"
    ),
) -> None:
    """Simulate a three-phase fault at bus 3 of the built-in NPCC system, print and draw it.

    Example: gridfold demo --out first
    """
    began = time.perf_counter()
    model = build_model(read_case("npcc"))
    out.print(facts_table(case_facts(model.case) | model_facts(model, model.residual)))
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
    source: CaseOptions,
    events: EventOptions,
    runs: RunOptions,
    choice: ModelChoice,
    criteria: CriteriaOptions,
    results: ResultOptions,
    no_watch: Annotated[
        bool, run_option("--no-watch", help="Go on after loss of synchronism.")
    ] = False,
    network: Annotated[NetworkBackend, run_option(help="Network solver.")] = NetworkBackend.AUTO,
    compare: Annotated[
        bool, _result_option("--compare", help="Errors against a detailed run of the same.")
    ] = False,
    budget: Annotated[
        bool, _result_option("--budget", help="These errors by their causes too.")
    ] = False,
    json: JsonOption = None,
) -> None:
    """Simulate a disturbance."""
    began = time.perf_counter()
    events.collect()
    asked = criteria.collect()
    criterion = None if no_watch else runs.criterion
    without = (ModelKind.DETAILED, ModelKind.PAPER_WHOLE)
    if compare and choice.model is ModelKind.DETAILED:
        raise OptionError("--compare needs a reduced model, see --model")
    if budget and choice.model in (ModelKind.AUTO, *without):
        raise OptionError("--budget needs a model with a reduced external area, see --model")
    grid = source.build(network)
    happenings = events.collect(numbering(grid.case))
    method = runs.choose(grid, happenings)
    ready = time.perf_counter()
    study = choice.external.area.known(grid.case, source.case)
    task = Disturbance(grid, happenings, runs.t_end, method, criterion, study, asked)
    work = Work(1, round(runs.t_end / method.stepper.step))
    columns = results.watched(grid, study)
    tables = results.tables(columns)
    simulator = choice.build(grid, source.case, work, method.stepper)
    check_criteria(asked, grid.case, study)
    written = simulator.small is None and not results.whole and not asked
    if written:
        result = task.stream(simulator, tables, compare)
    else:
        result = task.solve(simulator, compare or budget, budget)
    run = result.run
    summary = summarize(run) if result.summary is None else result.summary
    record = _run_record(run, summary, ready - began + run.setup_seconds)
    record["model_reason"] = simulator.reason
    watched = extremes(columns.names, run.table(columns)) if results.printed else []
    if results.printed:
        record["monitor"] = [_finite(asdict(item)) for item in watched]
    findings = judge(run, asked, study)
    if asked:
        record["criteria"] = [item.record() for item in findings]
    write_json_option(json, record | result.record())
    if not written:
        results.write(run, columns)
    if speaks_to_people(json):
        out.print(notice_table(run))
        _print_run(run, summary)
        if watched:
            out.print(extremes_table(watched))
        if findings:
            out.print(criteria_table(findings))
        say_method(method.reason)
        say_model(simulator.kind.value, simulator.reason)
        say_approximate(run.approximate(columns))
        result.show()
    results.draw(result, columns)
    violated = any(item.verdict is Verdict.VIOLATED for item in findings)
    raise typer.Exit(exit_code(run.status, violated))


simulate.__doc__ = _SIMULATE_HELP


def _stable(run: Trajectory, summary: Summary) -> bool:
    return run.status is Status.COMPLETED and not summary.dark


def _finite(record: dict[str, Any]) -> dict[str, Any]:
    """A record ready for JSON: what is no number is None."""
    missing = {k: None for k, v in record.items() if isinstance(v, float) and not isfinite(v)}
    return record | missing


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _print_run(run: Trajectory, summary: Summary) -> None:
    basis = basis_of(run.model)
    out.print(swing_table(summary))
    out.print(facts_table(run_facts(run, summary)))
    say_basis(basis)


def _run_record(run: Trajectory, summary: Summary, setup_seconds: float) -> dict[str, Any]:
    record = run.metadata()
    record |= {
        "stable": None if run.criterion is None else _stable(run, summary),
        "setup_seconds": setup_seconds,
        "simulation_seconds": run.simulation_seconds,
        "states": run.model.n_states,
        "machines": len(run.model.machines),
        "buses": len(run.model.case.buses),
        "lowest_voltage": summary.lowest_voltage and asdict(summary.lowest_voltage),
        "highest_voltage": summary.highest_voltage and asdict(summary.highest_voltage),
        "frequency": summary.frequency and asdict(summary.frequency),
        **asdict(summary.cut_off),
        "swings": [asdict(swing) | {"unit": str(swing.unit)} for swing in summary.swings],
    }
    return record
