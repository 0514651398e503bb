"""Tables for people, as rich renderables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import isnan

from rich.text import Text

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import Switch
from gridfold.equivalents.compare import Comparison
from gridfold.equivalents.error_budget import ErrorBudget
from gridfold.equivalents.families import ReducedExternal
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.moved_modes import MOVED, ComparedMode, compared_modes
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.doubts import Doubt
from gridfold.partition import Coupling, Partition
from gridfold.powerflow import PowerFlowResult
from gridfold.reduction import Reducer
from gridfold.report.plain import PlainTable, as_lines
from gridfold.runs.basis import Basis
from gridfold.runs.case_info import AreaTie, ModelCount
from gridfold.runs.clearing import ClearingTime
from gridfold.runs.clearing.rows import place_of
from gridfold.runs.device_check import Finding
from gridfold.runs.monitor.extremes import Extremes
from gridfold.runs.small_signal import SmallSignal
from gridfold.runs.summary import Summary
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: Nonlinear functions of a generator as the paper counts them (Osipov & Sun, section III.A).
FUNCTIONS_PER_GENERATOR = 4


def facts_table(facts: Mapping[str, str | Text]) -> PlainTable:
    """Two columns: what, and how much."""
    table = PlainTable(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in facts.items():
        table.add_row(name, value)
    return table


def case_facts(case: Case) -> dict[str, str]:
    """What a case consists of."""
    transformers = sum(b.ratio != 1 or b.shift_deg != 0 for b in case.branches)
    load = sum(case.stored_power(load).real for load in case.loads if load.in_service)
    return {
        "Case": f"{case.name}: {case.description}" if case.description else case.name,
        "Buses": str(len(case.buses)),
        "Branches": f"{len(case.branches)} ({transformers} with an off-nominal ratio or shift)",
        "Generators": str(len(case.generators)),
        "Loads": f"{len(case.loads)}, {load:,.1f} MW",
        "Shunts": str(len(case.shunts)),
        "Base": f"{case.base_mva:g} MVA, {case.frequency_hz:g} Hz",
        "Fingerprint": case.fingerprint[:16],
    } | file_facts(case)


def file_facts(case: Case) -> dict[str, str]:
    """Records of the file by kind, of a case that comes from a file of planners."""
    listed = ", ".join(f"{count} {name}" for name, count in case.file_counts.items())
    return {"Records of the file": listed} if listed else {}


def area_table(case: Case) -> PlainTable:
    """Areas with their buses, machines, load and tie lines."""
    area = {bus.number: bus.area for bus in case.buses}
    table = PlainTable(title="Areas", title_justify="left")
    for name in ("area", "name"):
        table.add_column(name)
    for name in ("buses", "generators", "load (MW)", "tie lines"):
        table.add_column(name, justify="right")
    units = Counter(area[generator.bus] for generator in case.generators)
    ties = Counter(
        number
        for branch in case.branches
        if area[branch.from_bus] != area[branch.to_bus]
        for number in (area[branch.from_bus], area[branch.to_bus])
    )
    for number, count in sorted(Counter(area.values()).items()):
        loads = (item for item in case.loads if item.in_service and area[item.bus] == number)
        load = sum(case.stored_power(item).real for item in loads)
        name = case.area_names.get(number, "")
        table.add_row(
            str(number),
            name,
            str(count),
            str(units[number]),
            f"{load:,.1f}",
            str(ties[number]),
        )
    return table


def area_tie_table(ties: Sequence[AreaTie], shown: int = 12) -> PlainTable:
    """The first branches between areas."""
    table = PlainTable(title=f"{len(ties)} tie lines between areas", title_justify="left")
    for name in ("from bus", "to bus", "circuit", "areas"):
        table.add_column(name, justify="right")
    for branch, (first, second) in ties[:shown]:
        buses = str(branch.from_bus), str(branch.to_bus)
        table.add_row(*buses, branch.circuit, f"{first} - {second}")
    if len(ties) > shown:
        table.note(f"and {len(ties) - shown} more, see --json")
    return table


def device_table(models: Sequence[ModelCount]) -> PlainTable:
    """Device models, how many records each has, and whether gridfold has it."""
    table = PlainTable(title="Dynamic devices", title_justify="left")
    table.add_column("model")
    table.add_column("kind")
    table.add_column("records", justify="right")
    table.add_column("in gridfold")
    for item in models:
        known = "your own" if item.own else "yes" if item.implemented else "no"
        style = None if item.implemented else "yellow"
        table.add_row(item.model, item.kind, str(item.records), known, style=style)
    return table


def finding_table(findings: Sequence[Finding]) -> PlainTable:
    """What the tests of a device model found."""
    table = PlainTable()
    table.add_column("test")
    table.add_column("")
    table.add_column("found", overflow="fold")
    outcomes = {True: ("ok", None), False: ("FAULT", "bold red"), None: ("not tried", "yellow")}
    for item in findings:
        outcome, style = outcomes[item.passed]
        table.add_row(item.test, outcome, item.text, style=style)
    return table


def shortened(lines: Sequence[str], shown: int = 5, command: str = "--json") -> list[str]:
    """The first lines, and how many more there are; `command` has all of them."""
    more = [f"... and {len(lines) - shown} more (all of them with {command})"]
    return [*lines[:shown], *(more if len(lines) > shown else [])]


def doubt_lines(doubts: Sequence[Doubt], shown: int = 6) -> list[str]:
    """A line for each row of the tables of usual values, with the first record that is beyond it."""
    first: dict[str, tuple[Doubt, str]] = {}
    counts: Counter[str] = Counter()
    for doubt in doubts:
        counts.update(doubt.rows)
        for row, text in zip(doubt.rows, doubt.texts, strict=True):
            first.setdefault(row, (doubt, text))
    lines = []
    for row, (doubt, text) in first.items():
        others = f"; {counts[row] - 1} more of this kind" if counts[row] > 1 else ""
        lines.append(f"{replace(doubt, rows=(row,), texts=(text,))}{others}")
    if len(lines) > shown or len(lines) < len(doubts):
        left = f"{len(lines) - shown} more kinds; " if len(lines) > shown else ""
        records = f"{len(doubts)} records with unusual values"
        return [*lines[:shown], f"{left}{records}: gridfold info --json - lists all of them"]
    return lines


def basis_facts(basis: Basis) -> dict[str, str | Text]:
    """What results rest on beside the data; rows only for what there is."""
    facts: dict[str, str | Text] = {"Loads": str(basis.loads)}
    for name, lines in (
        ("Replaced", [str(item) for item in basis.replacements]),
        ("Limits moved", basis.limits_moved),
        ("Unsupported", basis.unsupported),
        ("Missing", basis.missing),
        ("No such unit", basis.unplaced),
        ("Notes", basis.notices),
    ):
        if lines:
            count = f" ({len(lines)})" if len(lines) > 1 else ""
            told = lines if name == "Missing" else shortened(lines)
            facts[name + count] = as_lines(told)
    return facts


def flow_facts(flow: PowerFlowResult) -> dict[str, str]:
    """Operating point."""
    generation = flow.unit_power.sum().real * flow.case.base_mva
    return {
        "Power flow": f"{flow.iterations} iterations, largest mismatch {flow.mismatch:.1e} p.u.",
        "Generation": f"{generation:,.1f} MW, losses {flow.losses_mw:,.1f} MW",
    }


def model_facts(model: DetailedModel, residual: float) -> dict[str, str]:
    """Operating point and size of a detailed model."""
    return flow_facts(model.power_flow) | {
        "Dynamic model": f"{model.n_states} states, {len(model.machines)} machines",
        "Equilibrium": f"largest derivative {residual:.1e}",
    }


def run_facts(run: Trajectory, summary: Summary) -> dict[str, str]:
    """What happened in a run."""
    outcome = f"{run.status.value} at {run.times[-1]:g} s"
    if run.culprit is not None:
        outcome += f", first {run.culprit}"
    facts = {
        "Outcome": outcome,
        "Criterion": "none" if run.criterion is None else f"ends at {run.criterion}",
        "Method": f"{run.stepper.name}, {run.stepper.step:g} s, {run.run.step_count} steps",
    }
    for name, found in (
        ("Lowest voltage", summary.lowest_voltage),
        ("Highest voltage", summary.highest_voltage),
    ):
        if found is not None:
            place = f"{found.value:.3f} p.u. at bus {found.bus}, {found.at_seconds:g} s"
            facts[name] = place + (" (after the last event)" if run.notices else "")
    completed = run.status is Status.COMPLETED
    until = "" if completed else f" until the run ended at {run.times[-1]:g} s"
    return facts | {
        **_island_facts(summary, until),
        "Time": f"networks {run.setup_seconds:.3f} s, integration {run.simulation_seconds:.3f} s",
    }


def _island_facts(summary: Summary, until: str) -> dict[str, str]:
    """Frequencies of all islands, and what was cut off if anything was."""
    facts, swing, parts = {}, summary.frequency, summary.cut_off
    if swing is not None:
        facts["Frequency"] = (
            f"{swing.lowest_hz:.3f} Hz at {swing.lowest_at:g} s to {swing.highest_hz:.3f} Hz at "
            f"{swing.highest_at:g} s{until}"
        )
    if parts.islands != 1 or parts.lost_load_mw:
        facts["Islands"] = (
            f"{parts.islands}, {parts.islanded_mw:.1f} MW of generation outside the largest, "
            f"{parts.lost_load_mw:.1f} MW of load lost"
        )
    return facts


def notice_table(run: Trajectory) -> PlainTable:
    """What happened to the network, in order of time."""
    table = PlainTable(title="Events", title_justify="left")
    table.add_column("time (s)", justify="right")
    table.add_column("what", overflow="fold")
    for notice in run.notices:
        table.add_row(f"{notice.time:g}", notice.text)
    return table


def swing_table(summary: Summary, count: int = 8) -> PlainTable:
    """The machines whose angle from the centre of inertia changes most."""
    table = PlainTable(
        title="Largest changes of rotor angles since the start", title_justify="left"
    )
    for name in ("machine", "change (deg)", "at (s)", "lowest speed", "highest speed"):
        table.add_column(name, justify="right")
    for swing in summary.swings[:count]:
        table.add_row(
            str(swing.unit),
            f"{swing.largest_angle_deg:+.2f}",
            f"{swing.at_seconds:.2f}",
            f"{swing.lowest_speed:.5f}",
            f"{swing.highest_speed:.5f}",
        )
    return table


def mode_table(modes: SmallSignal, shown: Sequence[int]) -> PlainTable:
    """Modes with their damping and the states that take part most."""
    table = PlainTable(title="Modes", title_justify="left")
    for name in ("eigenvalue (1/s)", "frequency (Hz)", "damping (%)"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("states with the largest participation factors", overflow="fold")
    ratio = modes.damping_ratio
    for k in shown:
        value = modes.eigenvalues[k]
        text = f"{value.real:+.4f} ± {value.imag:.4f}j" if value.imag else f"{value.real:+.4f}"
        states = ", ".join(f"{name} {factor:.2f}" for name, factor in modes.dominant_states(k))
        note = (
            "common angle; " if modes.common_angle[k] else "at rest; " if modes.at_rest[k] else ""
        )
        damping = "" if modes.zero[k] else f"{100 * ratio[k]:.2f}"
        table.add_row(text, f"{modes.frequency_hz[k]:.4f}", damping, note + states)
    return table


def extremes_table(rows: Sequence[Extremes], limit: int = 40) -> PlainTable:
    """Start, end and extremes of what was watched; the first `limit` columns."""
    table = PlainTable(title="Watched", title_justify="left")
    table.add_column("column", overflow="fold")
    for name in ("start", "lowest", "at (s)", "highest", "at (s)", "end"):
        table.add_column(name, justify="right")
    for row in rows[:limit]:
        figures = (row.start, row.lowest, row.lowest_at, row.highest, row.highest_at, row.end)
        table.add_row(row.name, *("" if isnan(value) else f"{value:.5g}" for value in figures))
    if len(rows) > limit:
        table.note(f"{len(rows) - limit:,} more columns; --csv or --parquet writes all of them")
    return table


def clearing_table(times: Sequence[ClearingTime], limit: int) -> PlainTable:
    """Critical clearing times of faults at buses and at ends of lines.

    Of more than `limit` those are shown that are the shortest, in their order.
    """
    table = PlainTable(title="Critical clearing times", title_justify="left")
    table.add_column("fault")
    table.add_column("CCT (s)", justify="right")
    table.add_column("first machine")
    table.add_column("runs", justify="right")
    shown = times
    if len(times) > limit:
        # Times that are not known are NaN, and come last.
        shown = sorted(times, key=lambda item: (item.failed, not item.bounded, item.seconds))[
            :limit
        ]
        table.note(f"The {limit} shortest of {len(times)}.")
    for item in shown:
        machine = "" if item.machine is None else str(item.machine)
        table.add_row(place_of(item.fault), _clearing_text(item), machine, str(item.runs))
    return table


def _clearing_text(item: ClearingTime) -> str:
    if item.failed:
        return "failed"
    if not item.bounded:
        return f">= {item.seconds:g}"
    return f"{item.seconds:g}" if item.seconds else f"< {item.lost_at:g}"


def partition_facts(
    parts: Partition, coupling: Coupling, threshold: float, buses: str
) -> dict[str, str]:
    """What both areas consist of; `buses` is the study area as text."""
    per, kept = FUNCTIONS_PER_GENERATOR, coupling.kept(threshold)
    external, whole = len(parts.external_units), len(parts.study_units) + len(parts.external_units)
    linear = per * (external - len(kept))
    boundary = ", ".join(map(str, parts.boundary_buses))
    inside = len(parts.study_buses)
    outside = len(parts.model.case.buses) - inside
    return {
        "Study area": f"buses {buses} ({inside}), {_area_size(parts, parts.study_units)}",
        "External area": f"{outside} buses, {_area_size(parts, parts.external_units)}",
        "Boundary buses": boundary,
        "Threshold": f"column norm {threshold:g} p.u., {coupling.siemens(threshold):g} S at 20 kV",
        "Kept nonlinear": ", ".join(map(str, kept)) or "none",
        "Linearized": f"{external - len(kept)} machines: {linear} of {per * external} functions, "
        f"or of {per * whole} without partition ({per} a generator)",
        "Reference machine": str(coupling.reference or "none, the infinite bus"),
    }


def _area_size(parts: Partition, units: Sequence[UnitKey]) -> str:
    return f"{len(units)} machines, {len(parts.states_of(units))} states"


def tie_table(parts: Partition) -> PlainTable:
    """The branches between the areas."""
    table = PlainTable(title="Tie lines", title_justify="left")
    for name in ("branch", "study bus", "external bus"):
        table.add_column(name, justify="right")
    for tie in parts.tie_lines:
        branch = str(parts.model.case.branches[tie.branch]).removeprefix("branch ")
        table.add_row(branch, str(tie.study_bus), str(tie.external_bus))
    return table


def norm_table(coupling: Coupling, threshold: float) -> PlainTable:
    """Column norms of the external machines, the largest first."""
    table = PlainTable(title="Column norms of the external machines", title_justify="left")
    for name in ("machine", "norm (p.u.)", "at 20 kV (S)"):
        table.add_column(name, justify="right")
    table.add_column("functions")
    kept = set(coupling.kept(threshold))
    pairs = zip(coupling.norms.tolist(), coupling.units, strict=True)
    for norm, unit in sorted(pairs, reverse=True):
        what = "kept" if unit in kept else "linearized"
        table.add_row(str(unit), f"{norm:.4g}", f"{coupling.siemens(norm):.4g}", what)
    return table


def reduction_facts(
    family: ReducedExternal, threshold: float, buses: str, seconds: float, shown: int = 8
) -> dict[str, str]:
    """Order, bound and singular values of a reduced external area."""
    reduction = family.reduction
    values = [] if reduction.hankel_values is None else reduction.hankel_values[:shown].tolist()
    kept = ", ".join(map(str, family.kept)) or "none"
    bound = "none" if reduction.bound is None else f"{reduction.bound:.3e}"
    return {
        "Study area": f"buses {buses}",
        "External area": f"{len(family.area.index)} states, reduced to {reduction.order}",
        "Reducer": _reducer_text(family.reducer),
        "Error bound": bound,
        "Hankel singular values": ", ".join(f"{value:.3g}" for value in values) or "none",
        "Kept nonlinear": f"{kept} (column norm from {threshold:g} p.u.)",
        "Time": f"{seconds:.2f} s",
    }


def _reducer_text(reducer: Reducer) -> str:
    """Name and options of a reducer, such as `balanced truncation, tolerance 1e-05`."""
    name = re.sub("(?<=[a-z])(?=[A-Z])", " ", type(reducer).__name__).lower()
    options = [
        f"{item.name.replace('_', ' ')} {value:g}"
        for item in fields(reducer)  # type: ignore[arg-type]
        if isinstance(value := getattr(reducer, item.name), int | float)
    ]
    return ", ".join([name, *options])


def ladder_table(family: Ladder) -> PlainTable:
    """The areas of a ladder: what is exact, where they meet, how they were reduced."""
    table = PlainTable(title="Areas", title_justify="left")
    for name in ("model", "retained", "ports", "states", "order", "bound (p.u.)"):
        table.add_column(name, overflow="fold")
    for area in dict.fromkeys(family.areas):
        bases, bound = area.bases, area.bases.bound
        table.add_row(
            area.mode.value,
            ", ".join(map(str, area.retained)) or "none",
            ", ".join(map(str, area.ports.buses)),
            str(len(area.area.state_index)),
            str(bases.order),
            "none" if bound is None else f"{bound:.2e}",
        )
    return table


def modes_text(modes: Sequence[ComparedMode]) -> str:
    """How many swing modes of the study area stay where they are, and which do not."""
    moved = [str(mode) for mode in modes if mode.moved]
    text = (
        f"{len(modes) - len(moved)} of {len(modes)} within {MOVED:.0%} of those of the whole system"
    )
    return "; ".join([text, *moved])


def ladder_facts(family: Ladder, seconds: float, shown: int = 8) -> dict[str, str]:
    """Singular values of the last area, what a step of each rung takes, and the time for all."""
    values = family.areas[-1].bases.hankel_values
    listed = [] if values is None else values[:shown].tolist()
    steps = [f"{mode.value} {1e6 * spent:.1f}" for mode, spent in family.step_seconds.items()]
    unused = [rung.value for rung in family.rungs if rung not in family.modes]
    facts = {
        "Hankel singular values": ", ".join(f"{value:.3g}" for value in listed) or "none",
        "Microseconds a step": ", ".join(steps),
        "Swing modes": modes_text(compared_modes(family.areas[-1])),
        "Time": f"{seconds:.2f} s",
    }
    if family.fit is not None:
        facts["Chosen for the tolerance"] = family.fit.text
    if unused:
        facts["Not used"] = f"{', '.join(unused)}: no cheaper than the rung above"
    return facts


def switch_table(switches: Sequence[Switch]) -> PlainTable:
    """The log of switches between models."""
    table = PlainTable(title="Models", title_justify="left")
    table.add_column("time (s)", justify="right")
    table.add_column("model")
    table.add_column("why", overflow="fold")
    table.add_column("jump (deg)", justify="right")
    for switch in switches:
        table.add_row(
            f"{switch.time:g}", switch.after.value, switch.reason, f"{switch.jump_deg:.1e}"
        )
    return table


def error_table(comparison: Comparison) -> PlainTable:
    """Errors of rotor angles against the detailed run, the largest first."""
    table = PlainTable(
        title="Rotor-angle errors against the detailed run (deg)", title_justify="left"
    )
    for name in ("machine", "RMS", "largest", "RMS against the centre of inertia"):
        table.add_column(name, justify="right")
    for error in sorted(comparison.units, key=lambda item: -item.rms_deg):
        values = (error.rms_deg, error.largest_deg, error.relative_rms_deg)
        table.add_row(str(error.unit), *(f"{value:.3f}" for value in values))
    return table


def budget_table(budget: ErrorBudget) -> PlainTable:
    """Where the error of a reduced model comes from."""
    table = PlainTable(
        title="Error budget: rotor angles of the worst machine (deg)", title_justify="left"
    )
    table.add_column("source")
    table.add_column("compared", overflow="fold")
    for name in ("machine", "RMS", "largest"):
        table.add_column(name, justify="right")
    for row in budget.rows:
        if row.error is None:
            table.add_row(row.source, f"{row.changed}: {row.status.value}", "", "none", "none")
        else:
            values = (f"{value:.3g}" for value in (row.error.rms_deg, row.error.largest_deg))
            table.add_row(row.source, row.changed, str(row.error.unit), *values)
    return table
