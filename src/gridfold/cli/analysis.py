"""Commands that look at a case: its data, its modes."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from gridfold.cli.console import (
    out,
    say_basis,
    speaks_to_people,
    write_json_option,
)
from gridfold.cli.options import (
    CaseOptions,
    JsonOption,
)
from gridfold.report.plain import as_lines
from gridfold.report.plots import plot_eigenvalues
from gridfold.report.style import check_format
from gridfold.report.tables import (
    area_table,
    area_tie_table,
    case_facts,
    device_table,
    facts_table,
    flow_facts,
    mode_table,
    model_facts,
    shortened,
)
from gridfold.runs.basis import basis_of
from gridfold.runs.case_info import CaseInfo, area_ties
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
