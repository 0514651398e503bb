"""The page of the documentation that shows the paper's tables beside ours.

Runs ``gridfold reproduce all``, or takes the record of such a run: ``reproduce_page.py RECORD.json``
(its figures then stay as they are).
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from report import GENERATED, Table, machine, one_thread, write

MODELS = ("linear", "adaptive_partitioned", "adaptive_whole")
ADAPTIVE = MODELS[1:]
SHORT = {"linear": "linear", "adaptive_partitioned": "part.", "adaptive_whole": "whole"}
#: Machines retained throughout, and the paper's form with the exact and with its own coupling.
FURTHER = {
    "retained": "retained",
    "linear_printed": "linear printed",
    "adaptive_partitioned_printed": "part. printed",
    "adaptive_whole_printed": "whole printed",
    "linear_lagged": "linear lagged",
    "adaptive_partitioned_lagged": "part. lagged",
}
LOST = "lost"


def measure() -> dict[str, Any]:
    """Run the command, with its figures beside the page."""
    command = Path(sys.executable).with_name("gridfold")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.json"
        subprocess.run(
            [command, "reproduce", "all", "--json", path, "--out", GENERATED / "reproduction"],
            check=True,
        )
        return _load(path)


def page(record: dict[str, Any]) -> list[object]:
    """Sections of the page."""
    return [
        "## System and thresholds",
        _system(record),
        *_calibration(record["calibration"]),
        "## Table I",
        _first(record),
        _forms(record),
        _means(record["table1_summary"]),
        "## Table II",
        _second(record["table2"]),
        "## Table III",
        _third(record["table3"], "Our form"),
        _third(record["table3_printed"], "The form printed in the paper"),
        "## Table IV",
        _fourth(record["table4"]),
        "## Claims",
        Table(
            "Statements of the paper, checked on the runs above.",
            ("statement", "holds", "found"),
            [
                (item["claim"], "yes" if item["holds"] else "no", item["found"])
                for item in record["verdicts"]
            ],
        ),
    ]


def _system(record: dict[str, Any]) -> Table:
    names = ("system", "system_calibrated", "system_published")
    columns = [record[name] or {} for name in names]
    rows = [
        (name.replace("_", " "), *(_fact(column.get(name)) for column in columns))
        for name in record["system"]
    ]
    return Table(
        "Calibrated: with the thresholds of our own calibration; a dash: no such value.",
        ("", "paper's thresholds", "calibrated", "paper"),
        rows,
    )


def _calibration(found: dict[str, Any] | None) -> list[object]:
    if found is None:
        return []
    rows = [
        (
            kind,
            _fact(item["value"]),
            _number(item["largest_error_deg"], 2),
            _fact(item["binding_bus"]),
            _fact(item["binding_generator"]),
            str(item["runs"]),
        )
        for kind, item in found.items()
    ]
    heads = ("threshold", "value", "largest error (degrees)", "bound by bus", "machine", "runs")
    caption = (
        "Calibration: errors of all faults below 6 degrees; angles with the column norm found first. "
        "Without a value even the lowest does not satisfy: the machine named still exceeds it."
    )
    return [Table(caption, heads, rows)]


def _first(record: dict[str, Any]) -> Table:
    heads = ["bus", "machine", "paper", "CCT", "paper", "margin"]
    heads += [SHORT[name] for name in MODELS]
    heads += [f"{SHORT[name]} printed, calib." for name in ADAPTIVE]
    heads += [f"paper {SHORT[name]}" for name in MODELS]
    rows = []
    for row in record["table1"]:
        texts = [str(row["bus"]), row["generator"] or LOST, str(row["paper_generator"])]
        texts += [f"{row['cct_s']:.2f}", f"{row['paper_cct_s']:.2f}", f"{row['margin_ms']:.0f}"]
        texts += [_number(row["rmse_deg"][name], 2) for name in MODELS]
        texts += [_number(row["rmse_deg_calibrated"][name], 2) for name in ADAPTIVE]
        rows.append([*texts, *(_number(row["paper_rmse_deg"][name], 2) for name in MODELS)])
    caption = (
        "Largest RMS rotor-angle error of the study area in degrees, each model's own worst machine; "
        "machine: the worst of the linear run. CCT in s, margin to the true one in ms. Our form; "
        "calibrated thresholds belong to the form printed in the paper."
    )
    return Table(caption, tuple(heads), rows)


def _forms(record: dict[str, Any]) -> Table:
    rows = [
        [str(row["bus"]), *(_number(row["rmse_deg"][name], 2) for name in FURTHER)]
        for row in record["table1"]
    ]
    caption = (
        "The same with five machines retained and no switching, and in the form printed in the "
        "paper. Lagged: with the coupling of the paper, all others with the exact one."
    )
    return Table(caption, ("bus", *FURTHER.values()), rows)


def _means(summary: dict[str, Any]) -> Table:
    rows = []
    for label, key in (("paper's thresholds", "rmse_deg"), ("calibrated", "rmse_deg_calibrated")):
        for name, item in summary[key].items():
            if item is not None:
                column = name.removesuffix("_lagged").removesuffix("_printed")
                paper = _number(summary["paper_mean_rmse_deg"].get(column), 2)
                mean, largest = f"{item['mean']:.2f}", f"{item['largest']:.2f}"
                where, count = str(item["largest_bus"]), str(item["rows"])
                short = SHORT.get(name) or FURTHER[name]
                if key == "rmse_deg_calibrated":
                    short = f"{short} printed"
                rows.append((short, label, mean, paper, largest, where, count))
    heads = ("model", "thresholds", "mean", "paper's mean", "largest", "at bus", "rows")
    return Table("Means over the rows that kept synchronism, in degrees.", heads, rows)


def _second(rows: list[dict[str, Any]]) -> Table:
    heads = ["state", "unit"]
    for name in MODELS:
        heads += [SHORT[name], "paper"]
    heads += [f"{SHORT[name]} below linear" for name in ADAPTIVE]
    texts = []
    for row in rows:
        line = [row["state"].replace("_", " "), row["unit"]]
        for name in MODELS:
            line += [_exponent(row[name]), _exponent(row["paper"][name])]
        for name in ADAPTIVE:
            both = row["linear"] and row[name] is not None
            line.append(f"{100 * (1 - row[name] / row['linear']):.0f} %" if both else "-")
        texts.append(line)
    caption = f"RMS errors of machine {rows[0]['generator']} after the fault at bus 3."
    return Table(caption, tuple(heads), texts)


def _third(columns: dict[str, Any], form: str) -> Table:
    heads = ["model"]
    for name, item in columns.items():
        heads += [f"{name} (bus {item['bus']}), ms", "ratio", "paper, s", "ratio"]
    rows = []
    for name in ("detailed", *MODELS):
        line = [name.replace("_", ", ")]
        for item in columns.values():
            paper = item["paper"]
            line += [f"{1000 * item['seconds'][name]:.1f}", f"{item['ratios'][name]:.2f}"]
            line += [f"{paper['seconds'][name]:.1f}", f"{paper['ratios'][name]:.2f}"]
        rows.append(line)
    return Table(
        f"{form}: CPU time of a run of 16 s, median of interleaved runs; ratios to detailed.",
        tuple(heads),
        rows,
    )


def _fourth(rows: list[dict[str, Any]]) -> Table:
    heads = ["fault", "cleared, s", "clearing time of"]
    for name in ADAPTIVE:
        heads += [SHORT[name], "paper"]
    texts = []
    for row in rows:
        whose = "this contingency" if row["own_clearing_time"] else "the temporary fault"
        line = [row["fault"], f"{row['clearing_s']:.2f}", whose]
        for name in ADAPTIVE:
            line += [_number(row[name], 2), f"{row['paper'][name]:.2f}"]
        texts.append(line)
    return Table("Largest RMS rotor-angle error in degrees.", tuple(heads), texts)


def _load(path: Path) -> dict[str, Any]:
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return record


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _exponent(value: float | None) -> str:
    return LOST if value is None else f"{value:.1e}"


def _fact(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main(arguments: list[str]) -> None:
    """Write the page."""
    record = _load(Path(arguments[0])) if arguments else measure()
    note = f"`python benchmarks/reproduce_page.py`. {machine()}"
    print(write("reproduction.md", "# The paper's case studies", note, *page(record)))


if __name__ == "__main__":
    one_thread()
    main(sys.argv[1:])
