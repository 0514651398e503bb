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
    parse_buses,
    say_method,
    speaks_to_people,
    stage_bars,
    write_json_option,
)
from gridfold.cli.options import (
    CaseArgument,
    JsonOption,
    RunOptions,
    WorkersOption,
    run_option,
)
from gridfold.dynamics.model import build_model
from gridfold.grid.events import BusFault
from gridfold.io.case_folder import load_case
from gridfold.report.plots import plot_eigenvalues
from gridfold.report.style import check_format
from gridfold.report.tables import (
    area_table,
    case_facts,
    clearing_table,
    device_table,
    facts_table,
    mode_table,
    model_facts,
)
from gridfold.studies.clearing_time import ClearingTime, critical_clearing_times
from gridfold.studies.simulate import simulate
from gridfold.studies.small_signal import SmallSignal, small_signal


class ModeOrder(Enum):
    """Which modes come first in the table."""

    DAMPING = "damping"
    REAL = "real"


def info(case: CaseArgument, json: JsonOption = None) -> None:
    """Print what a case consists of, its operating point and its dynamic devices.

    Example: gridfold info npcc
    """
    data = load_case(case)
    model = build_model(data)
    residual = float(np.abs(model.compiled(model.x0)).max())
    write_json_option(
        json,
        {
            "case": data.name,
            "fingerprint": data.fingerprint,
            "buses": len(data.buses),
            "branches": len(data.branches),
            "generators": len(data.generators),
            "loads": len(data.loads),
            "shunts": len(data.shunts),
            "machines": len(model.machines),
            "states": model.n_states,
            "power_flow_mismatch": model.power_flow.mismatch,
            "losses_mw": model.power_flow.losses_mw,
            "equilibrium_residual": residual,
            "warnings": list(model.warnings),
        },
    )
    if speaks_to_people(json):
        out.print(facts_table(case_facts(data) | model_facts(model, residual)))
        out.print(area_table(data))
        out.print(device_table(data))


def eigenvalues(
    case: CaseArgument,
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
    data = load_case(case)
    modes = small_signal(build_model(data))
    if plot is not None:
        plot_eigenvalues(modes, data.name, plot)
    listed = [k for k, value in enumerate(modes.eigenvalues) if value.imag >= 0]
    if order is ModeOrder.DAMPING:
        oscillating = [k for k in listed if modes.eigenvalues[k].imag > 0]
        shown = sorted(oscillating, key=lambda k: modes.damping_ratio[k])[:count]
    else:
        shown = listed[:count]
    write_json_option(json, {"case": data.name, "modes": [_mode_record(modes, k) for k in listed]})
    if speaks_to_people(json):
        out.print(mode_table(modes, shown))
        rightmost = modes.rightmost
        text = f"Rightmost eigenvalue apart from the common angle: {rightmost.real:+.6f}"
        out.print(text + (f" ± {abs(rightmost.imag):.6f}j" if rightmost.imag else ""))


def cct(
    case: CaseArgument,
    buses: Annotated[str, typer.Option(help="Faulted buses, such as 1-36 or 3,7.")],
    runs: RunOptions,
    choice: ModelChoice,
    resolution: Annotated[float, run_option(help="Grid of clearing times (s).")] = 0.01,
    longest: Annotated[float, run_option(help="Longest clearing time tried (s).")] = 2.0,
    workers: WorkersOption = None,
    json: JsonOption = None,
) -> None:
    """Critical clearing times of three-phase faults at buses, on all cores.

    The largest clearing time on a grid for which no machine loses synchronism until the run ends.

    Example: gridfold cct npcc --buses 1-36 --json cct.json
    """
    faults = [BusFault(bus) for bus in parse_buses(buses)]
    criterion = runs.criterion
    grid = build_model(load_case(case))
    method = runs.choose(grid)
    simulator = choice.build(grid, case) or simulate
    with stage_bars() as bars:
        times = critical_clearing_times(
            grid,
            faults,
            workers,
            on_done=bars.counter("clearing times", len(faults)),
            resolution=resolution,
            longest=longest,
            t_end=runs.t_end,
            stepper=method.stepper,
            criterion=criterion,
            simulator=simulator,
        )
    name = choice.model.value
    told = {"model": name} | method.record()
    write_json_option(json, [_clearing_record(item) | told for item in times])
    if speaks_to_people(json):
        out.print(clearing_table(times))
        out.print(
            f"Synchronism is lost at {criterion}; runs of {runs.t_end:g} s on the {name} model."
        )
        say_method(method.reason)


def _clearing_record(item: ClearingTime) -> dict[str, Any]:
    return {
        "bus": getattr(item.fault, "bus", None),
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
        "participation": dict(modes.dominant_states(k)),
    }
