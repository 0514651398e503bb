"""Tables I to IV of Osipov & Sun for people: ours, and the paper's beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rich.box import SIMPLE_HEAD

from gridfold.paper import published
from gridfold.paper.record import (
    PUBLISHED_FACTS,
    Reproduction,
    SystemFacts,
    paper_means,
)
from gridfold.paper.runs import OURS, BusRow, FaultErrors, SmallRun
from gridfold.paper.tables import (
    ADAPTIVE,
    ADAPTIVE_PRINTED,
    ConditionRow,
    Means,
    StateRow,
    Timing,
    Verdict,
    means,
)
from gridfold.report.plain import PlainTable
from gridfold.systems.status import Status

_LOST = "lost"
_NONE = "-"
_SHORT = {
    SmallRun.LINEAR: "linear",
    SmallRun.ADAPTIVE_PARTITIONED: "part.",
    SmallRun.ADAPTIVE_WHOLE: "whole",
}
#: Further columns of Table I: machines retained and nothing switched, and the paper's form.
_FURTHER = {
    SmallRun.RETAINED: "retained",
    SmallRun.LINEAR_PRINTED: "linear printed",
    SmallRun.ADAPTIVE_PARTITIONED_PRINTED: "part. printed",
    SmallRun.ADAPTIVE_WHOLE_PRINTED: "whole printed",
    SmallRun.LINEAR_LAGGED: "linear lagged",
    SmallRun.ADAPTIVE_PARTITIONED_LAGGED: "part. lagged",
}
_NAMES = {
    "detailed": "detailed",
    "linear": "linear, partitioned",
    "adaptive_partitioned": "adaptive, partitioned",
    "adaptive_whole": "adaptive, unpartitioned",
}


def reproduction_tables(result: Reproduction) -> list[PlainTable]:
    """Every table of a reproduction, in the paper's order."""
    tables = [system_table(result.system, result.system_calibrated)]
    if result.table1 is not None:
        tables += [first_table(result.table1), forms_table(result.table1)]
    if result.table2:
        tables.append(second_table(result.table2))
    if result.table3 is not None:
        tables.append(third_table(result.table3, "our form"))
    if result.table3_printed is not None:
        tables.append(third_table(result.table3_printed, "the form printed in the paper"))
    if result.table4 is not None:
        tables.append(fourth_table(result.table4))
    if result.verdicts is not None:
        tables.append(verdict_table(result.verdicts))
    return tables


def system_table(system: SystemFacts, calibrated: SystemFacts | None) -> PlainTable:
    """Counts and thresholds."""
    heads = ["", "ours", *(["calibrated"] if calibrated else []), "paper"]
    table = _table("System, partition and thresholds", heads, 1)
    columns = [asdict(system), *([asdict(calibrated)] if calibrated else []), PUBLISHED_FACTS]
    for name in asdict(system):
        texts = [_text(column.get(name)) for column in columns]
        table.add_row(name.replace("_", " "), *texts)
    return table


def first_table(rows: Sequence[BusRow]) -> PlainTable:
    """Table I: rotor-angle errors after a fault at each bus."""
    with_calibrated = any(row.calibrated for row in rows)
    heads = ["bus", "machine", "paper", "CCT (s)", "paper", "margin (ms)"]
    heads += list(_SHORT.values())
    if with_calibrated:
        heads += [f"{_FURTHER[kind]}, calibrated" for kind in ADAPTIVE_PRINTED]
    heads += [f"paper {name}" for name in _SHORT.values()]
    title = "Table I: largest RMS rotor-angle error of the study area (degrees)"
    table = _table(title, heads, 0)
    for row in rows:
        table.add_row(*_first_row(row, with_calibrated))
    table.add_section()
    for name in ("mean", "largest"):
        values = [_mean_text(means(rows, kind), name) for kind in OURS]
        if with_calibrated:
            values += [_mean_text(means(rows, kind, True), name) for kind in ADAPTIVE_PRINTED]
        paper = paper_means() if name == "mean" else _paper_largest()
        table.add_row(name, *[""] * 5, *values, *(f"{value:.2f}" for value in paper))
    return table


def forms_table(rows: Sequence[BusRow]) -> PlainTable:
    """Table I with machines retained throughout, and in the paper's form with either coupling."""
    title = "Table I in other forms (degrees); lagged: with the coupling of the paper"
    table = _table(title, ["bus", *_FURTHER.values()], 0)
    for row in rows:
        table.add_row(str(row.bus), *(_degrees(row.errors, kind) for kind in _FURTHER))
    table.add_section()
    for name in ("mean", "largest"):
        table.add_row(name, *(_mean_text(means(rows, kind), name) for kind in _FURTHER))
    return table


def _first_row(row: BusRow, with_calibrated: bool) -> list[str]:
    unit = row.errors.worst_unit(SmallRun.LINEAR)
    paper = published.TABLE_1.get(row.bus)
    texts = [
        str(row.bus),
        _NONE if unit is None else str(unit),
        _NONE if paper is None else str(paper.generator),
        f"{row.cct:.2f}",
        _NONE if paper is None else f"{paper.cct:.2f}",
        f"{row.margin_ms:.0f}",
        *(_degrees(row.errors, kind) for kind in OURS),
    ]
    if with_calibrated:
        texts += [_degrees(row.calibrated, kind, _NONE) for kind in ADAPTIVE_PRINTED]
    return texts + ([_NONE] * 3 if paper is None else [f"{value:.2f}" for value in paper.errors])


def second_table(rows: Sequence[StateRow]) -> PlainTable:
    """Table II: errors of all states of the worst machine at bus 23."""
    heads = ["state", "unit"]
    for name in _SHORT.values():
        heads += [name, f"paper {name}"]
    heads += [f"{_SHORT[kind]} below linear (%)" for kind in ADAPTIVE]
    title = f"Table II: RMS error of the states of machine {rows[0].unit} after the bus-3 fault"
    table = _table(title, heads, 2)
    for row in rows:
        texts = [row.published.symbol, row.published.unit]
        for kind in OURS:
            ours = row.errors.get(kind)
            theirs = getattr(row.published.errors, kind.value)
            texts += [_LOST if ours is None else f"{ours:.1e}", f"{theirs:.1e}"]
        for kind in ADAPTIVE:
            percent = row.reduction_percent(kind)
            texts.append(_NONE if percent is None else f"{percent:.0f}")
        table.add_row(*texts)
    return table


def third_table(columns: Mapping[str, Timing], form: str) -> PlainTable:
    """Table III in a form: times and their ratios to the detailed run."""
    heads = ["model"]
    for name, item in columns.items():
        heads += [f"{name}: bus {item.bus} (ms)", "ratio", "paper (s)", "ratio"]
    table = _table(
        f"Table III, {form}: CPU time of a run of 16 s, median of interleaved runs", heads, 1
    )
    for model, label in _NAMES.items():
        texts = [label]
        for item in columns.values():
            paper = getattr(item.published, model)
            texts += [f"{1000 * item.seconds[model]:.1f}", f"{item.ratios[model]:.2f}"]
            texts += [f"{paper:.1f}", f"{paper / item.published.detailed:.2f}"]
        table.add_row(*texts)
    return table


def fourth_table(rows: Sequence[ConditionRow]) -> PlainTable:
    """Table IV: faults that lead to a new operating condition."""
    heads = ["fault", "cleared (s)", "clearing time of"]
    for kind in ADAPTIVE:
        heads += [_SHORT[kind], f"paper {_SHORT[kind]}"]
    table = _table("Table IV: largest RMS rotor-angle error (degrees)", heads, 1)
    for row in rows:
        whose = "this contingency" if row.own_clearing else "the temporary fault"
        texts = [row.published.fault, f"{row.errors.clearing:.2f}", whose]
        for kind in ADAPTIVE:
            texts += [_degrees(row.errors, kind), f"{getattr(row.published, kind.value):.2f}"]
        table.add_row(*texts)
    return table


def verdict_table(verdicts: Sequence[Verdict]) -> PlainTable:
    """Claims of the paper, and whether they hold here."""
    table = _table("Claims of the paper in our data", ["claim", "holds", "found"], 3)
    for item in verdicts:
        table.add_row(item.claim, "yes" if item.holds else "no", item.found)
    return table


def _table(title: str, heads: Sequence[str], left: int) -> PlainTable:
    """An empty table; the first `left` columns are text."""
    table = PlainTable(
        title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1), pad_edge=False
    )
    for position, head in enumerate(heads):
        table.add_column(head, justify="left" if position < left else "right", overflow="fold")
    return table


def _degrees(errors: FaultErrors | None, kind: SmallRun, missing: str = _LOST) -> str:
    if errors is None:
        return _NONE
    value = errors.worst_deg(kind)
    if value is not None:
        return f"{value:.2f}"
    return _NONE if errors.status is not Status.COMPLETED else missing


def _mean_text(item: Means | None, name: str) -> str:
    return _NONE if item is None else f"{getattr(item, name):.2f}"


def _paper_largest() -> published.Errors:
    columns = zip(*(row.errors for row in published.TABLE_1.values()), strict=True)
    return published.Errors(*map(max, columns))


def _text(value: object) -> str:
    if value is None:
        return _NONE
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)
