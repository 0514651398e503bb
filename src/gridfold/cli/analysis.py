"""Commands that look at a case: its data, its modes, its critical clearing times."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from gridfold.cli.choice import ModelChoice
from gridfold.cli.console import (
    out,
    say_basis,
    say_doubts,
    say_method,
    say_model,
    speaks_to_people,
    stage_bars,
    write_json_option,
)
from gridfold.cli.options import (
    CaseOptions,
    JobsOption,
    JsonOption,
    RunOptions,
    run_option,
)
from gridfold.equivalents.auto import Work
from gridfold.errors import OptionError
from gridfold.grid.case import Case
from gridfold.grid.events import BranchFault, BusFault
from gridfold.grid.selection import select_buses, select_lines
from gridfold.report.plain import as_lines
from gridfold.report.plots import plot_eigenvalues
from gridfold.report.style import check_format
from gridfold.report.tables import (
    area_table,
    area_tie_table,
    case_facts,
    clearing_table,
    device_table,
    facts_table,
    flow_facts,
    mode_table,
    model_facts,
    shortened,
)
from gridfold.runs.basis import basis_of
from gridfold.runs.case_info import CaseInfo, area_ties
from gridfold.runs.clearing import ClearingTime, Fault, critical_clearing_times
from gridfold.runs.longer_step import choose_for_many
from gridfold.runs.small_signal import SmallSignal, small_signal


class ModeOrder(Enum):
    """Which modes come first in the table."""

    DAMPING = "damping"
    REAL = "real"


def info(source: CaseOptions, json: JsonOption = None) -> None:
    """Print what a case consists of, its operating point and its dynamic devices.

    Of files of PSS/E and MATPOWER also what gridfold has no model for, which is no error here.

    Examples: gridfold info npcc

              gridfold info grid.raw grid.dyr
    """
    found = source.examine()
    write_json_option(json, _info_record(found))
    if speaks_to_people(json):
        _print_info(found)


def _info_record(found: CaseInfo) -> dict[str, Any]:
    case, flow, model = found.case, found.power_flow, found.model
    return {
        "case": case.name,
        "fingerprint": case.fingerprint,
        "file_counts": dict(case.file_counts),
        "buses": len(case.buses),
        "branches": len(case.branches),
        "generators": len(case.generators),
        "loads": len(case.loads),
        "shunts": len(case.shunts),
        "areas": sorted({bus.area for bus in case.buses}),
        "tie_lines": [
            {
                "from_bus": tie.branch.from_bus,
                "to_bus": tie.branch.to_bus,
                "circuit": tie.branch.circuit,
                "areas": list(tie.areas),
            }
            for tie in area_ties(case)
        ],
        "device_models": [item._asdict() for item in found.models],
        "skipped": [{"line": item.line, "text": item.text} for item in found.skipped],
        "missing": list(found.basis.missing),
        "power_flow_mismatch": None if flow is None else flow.mismatch,
        "losses_mw": None if flow is None else flow.losses_mw,
        "machines": None if model is None else len(model.machines),
        "states": None if model is None else model.n_states,
        "equilibrium_residual": None if model is None else model.residual,
        "trouble": found.trouble,
        **found.basis.record(),
    }


def _why_none(found: CaseInfo) -> str:
    """Why there is no dynamic model."""
    if found.trouble:
        return "does not start"
    return "none, models are missing" if found.basis.missing else "none, for lack of dynamic data"


def _print_info(found: CaseInfo) -> None:
    case, flow, model = found.case, found.power_flow, found.model
    facts = case_facts(case)
    if model is not None:
        facts |= model_facts(model, model.residual)
    elif flow is not None:
        facts |= flow_facts(flow) | {"Dynamic model": _why_none(found)}
    else:
        facts["Power flow"] = "does not converge"
    out.print(facts_table(facts))
    out.print(area_table(case))
    if ties := area_ties(case):
        out.print(area_tie_table(ties))
    if found.models:
        out.print(device_table(found.models))
    if found.skipped:
        skipped = [f"line {item.line}: {item.text}" for item in found.skipped]
        out.print(facts_table({f"Skipped records ({len(skipped)})": as_lines(shortened(skipped))}))
    say_basis(found.basis, doubts=6)
    for line in filter(None, (found.trouble, *found.advice)):
        out.print(line, style="yellow")


def eigenvalues(
    source: CaseOptions,
    count: Annotated[int, typer.Option(min=1, help="Modes in the table.")] = 20,
    order: Annotated[
        ModeOrder,
        typer.Option(help="Oscillations, the least damped first, or all, rightmost first."),
    ] = ModeOrder.DAMPING,
    plot: Annotated[Path | None, typer.Option(help="Draw them (.png or .svg).")] = None,
    json: JsonOption = None,
) -> None:
    """Eigenvalues, damping ratios and participation factors at the operating point.

    Example: gridfold eigenvalues npcc --count 30 --plot modes.png
    """
    if plot is not None:
        check_format(plot)
    model = source.build()
    basis = basis_of(model)
    modes = small_signal(model)
    listed = [k for k, value in enumerate(modes.eigenvalues) if value.imag >= 0]
    if order is ModeOrder.DAMPING:
        oscillating = [k for k in listed if modes.eigenvalues[k].imag > 0]
        shown = sorted(oscillating, key=lambda k: modes.damping_ratio[k])[:count]
    else:
        shown = listed[:count]
    record = {"case": model.case.name, "fingerprint": model.case.fingerprint, **basis.record()}
    write_json_option(json, record | {"modes": [_mode_record(modes, k) for k in listed]})
    if speaks_to_people(json):
        out.print(mode_table(modes, shown))
        rightmost = modes.rightmost
        if rightmost is None:
            out.print("The model has no eigenvalues: no unit of it has a state.")
            say_basis(basis)
            return
        text = f"Rightmost eigenvalue apart from the common angle: {rightmost.real:+.6f}"
        out.print(text + (f" ± {abs(rightmost.imag):.6f}j" if rightmost.imag else ""))
        say_basis(basis)
    if plot is not None:
        plot_eigenvalues(modes, model.case.name, plot)


#: Runs that a critical clearing time takes, roughly.
_RUNS_PER_FAULT = 8


def cct(
    source: CaseOptions,
    runs: RunOptions,
    choice: ModelChoice,
    buses: Annotated[
        str | None, typer.Option(help="Faulted buses, such as 1-36, area:1 or 'kv>=345'.")
    ] = None,
    lines: Annotated[
        str | None,
        typer.Option(
            help="Lines, such as 3-2 or area:1, with a fault at either end that trips them."
        ),
    ] = None,
    resolution: Annotated[float, run_option(help="Grid of clearing times (s).")] = 0.01,
    longest: Annotated[float, run_option(help="Longest clearing time tried (s).")] = 2.0,
    jobs: JobsOption = None,
    json: JsonOption = None,
) -> None:
    """Critical clearing times of three-phase faults at buses and lines, on all cores.

    The largest clearing time on a grid for which no machine loses synchronism until the run ends.

    Examples: gridfold cct npcc --buses 1-36 --json cct.json

              gridfold cct npcc --lines "area:1 to area:2"
    """
    criterion = runs.criterion
    grid = source.build()
    faults = _faults(grid.case, buses, lines, choice.external.area.known(grid.case, source.case))
    basis = basis_of(grid)
    count = _RUNS_PER_FAULT * len(faults)
    method = choose_for_many(
        grid,
        [(fault,) for fault in faults],
        runs.method,
        runs.seconds,
        runs=count,
        t_end=runs.t_end,
        criterion=criterion,
    )
    work = Work(count, round(runs.t_end / method.stepper.step))
    simulator = choice.build(grid, source.case, work, method.stepper)
    with stage_bars() as bars:
        times = critical_clearing_times(
            grid,
            faults,
            jobs,
            on_done=bars.counter("clearing times", len(faults)),
            resolution=resolution,
            longest=longest,
            t_end=runs.t_end,
            stepper=method.stepper,
            criterion=criterion,
            simulator=simulator,
        )
    name = simulator.kind.value
    told = {"model": name, "model_reason": simulator.reason} | method.record() | basis.record()
    about = {"case": grid.case.name, "fingerprint": grid.case.fingerprint, **told}
    write_json_option(json, about | {"clearing_times": [_clearing_record(item) for item in times]})
    if speaks_to_people(json):
        out.print(clearing_table(times))
        out.print(
            f"Synchronism is lost at {criterion}; runs of {runs.t_end:g} s on the {name} model."
        )
        say_basis(basis)
        say_method(method.reason)
        say_doubts(method.doubts)
        say_model(name, simulator.reason)


def _faults(
    case: Case, buses: str | None, lines: str | None, study: frozenset[int] | None
) -> list[Fault]:
    """Faults at buses, then at both ends of lines."""
    if buses is None and lines is None:
        raise OptionError("give --buses or --lines: where the faults are")
    faults: list[Fault] = []
    if buses is not None:
        faults += [BusFault(bus) for bus in select_buses(buses, case, "--buses", study)]
    if lines is not None:
        found = sorted({line.position for line in select_lines(lines, case, "--lines", study)})
        faults += [
            BranchFault(case.branch_names[position], fraction=end)
            for position in found
            if case.branches[position].in_service
            for end in (0.0, 1.0)
        ]
    if not faults:
        raise OptionError("no bus and no line in service is chosen")
    return faults


def _clearing_record(item: ClearingTime) -> dict[str, Any]:
    fault = item.fault
    return {
        "bus": fault.bus if isinstance(fault, BusFault) else None,
        "branch": fault.branch if isinstance(fault, BranchFault) else None,
        "fraction": fault.fraction if isinstance(fault, BranchFault) else None,
        "cct_s": item.seconds,
        "bounded": item.bounded,
        "runs": item.runs,
    }


def _mode_record(modes: SmallSignal, k: int) -> dict[str, Any]:
    value, ratio = modes.eigenvalues[k], modes.damping_ratio[k]
    return {
        "real": float(value.real),
        "imag": float(value.imag),
        "frequency_hz": float(modes.frequency_hz[k]),
        "damping_ratio": None if np.isnan(ratio) else float(ratio),
        "common_angle": bool(modes.common_angle[k]),
        "at_rest": bool(modes.at_rest[k]),
        "participation": dict(modes.dominant_states(k)),
    }
