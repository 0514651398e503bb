"""What the report of a study tells, as one record that is ready for JSON.

All of it comes from the store; neither case nor model is needed.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gridfold.io.study_store import StudyStore
from gridfold.paper.published import SOURCE, TABLE_1
from gridfold.report.criteria_record import criteria_record
from gridfold.report.criteria_tables import other_criteria, violating
from gridfold.report.curves import axis_text
from gridfold.report.event_words import event_places, event_words
from gridfold.report.grid_layout import with_places
from gridfold.report.study_file_text import study_file_text
from gridfold.report.study_tables import further_errors, other_verdicts, study_facts
from gridfold.study.single_precision import single_words
from gridfold.study.summary import column_types

if TYPE_CHECKING:
    import pandas as pd

Record = dict[str, Any]

#: Characters that curves may take in the page, which a browser opens without delay.
ROOM = 20_000_000
#: Significant digits of a figure.
_DIGITS = 6
#: What stands for a missing sample of a curve, and the largest sample.
_MISSING, _LARGEST = -32768, 32000
#: Finest step of a curve in the page: degrees.
_FINEST_DEG = 0.01
#: What was watched, where nothing was.
_NONE: Record = {"panels": []}
_LOST = re.compile(r"lost synchronism: rotor_angle:(\S+) at (\S+) s")
_OFF_SPEED = re.compile(r"off speed: speed:(\S+) at (\S+) s")


def study_record(store: StudyStore, room: int = ROOM) -> Record:
    """The whole record of a study, finished or not.

    Parameters
    ----------
    store : StudyStore
        The results.
    room : int
        Characters that curves may take. Those of the first contingencies of the ranking are taken, the
        unstable ones first, then by separation.

    Returns
    -------
    dict
        Ready for JSON; missing figures are None. Curves are 16-bit numbers with a factor, see
        :func:`packed`.
    """
    about = store.require("study", "settings", "case", "fingerprint", "gridfold", "map")
    found, listed = store.frame(), store.contingencies()
    # A damaged store may lack a column.
    frame = ranked(found.assign(**{name: None for name in column_types() if name not in found}))
    facts = study_facts(store)
    shown = frame.drop(columns="criteria")
    return {
        "study": about["study"]["name"],
        "case": facts["Case"],
        "model": facts["Model"],
        "kind": about["settings"]["model"],
        "counts": _counts(frame, len(listed)),
        "finished": "last_run" in about and len(frame) == len(listed),
        "accuracy": _accuracy(frame, about) | {"tolerance": facts.get("Tolerance")},
        "warnings": _warnings(about),
        "map": _map(about),
        "criteria": criteria_record(frame),
        "angle_limit_deg": about["study"]["run"]["angle_limit_deg"],
        "fields": list(shown.columns),
        "rows": _rows(shown),
        "events": {item["number"]: _events(item["events"]) for item in listed},
        **_all_curves(store, [int(number) for number in frame["number"]], room),
        "paper": _paper(about, listed),
        "provenance": _provenance(about),
        "study_file": study_file_text(about["study"]),
    }


def ranked(frame: pd.DataFrame) -> pd.DataFrame:
    """The unstable ones first, then those that violate criteria, then by separation; failed last."""
    kept = (frame["violated"].fillna("") == "").astype("Int64")
    order = 2 * frame["stable"].astype("Int64").fillna(2) + kept
    return (
        frame.assign(_order=order)
        .sort_values(
            ["_order", "largest_separation_deg", "number"],
            ascending=[True, False, True],
            na_position="last",
        )
        .drop(columns="_order")
    )


def packed(values: NDArray[Any], finest: float = _FINEST_DEG) -> Record:
    """Samples as 16-bit numbers in little-endian order, base64, with the factor they are to take.

    A missing sample is -32768.
    """
    finite = np.abs(values[np.isfinite(values)], dtype=float)
    factor = max(finest, float(finite.max(initial=0.0)) / _LARGEST)
    steps = np.where(np.isfinite(values), np.round(np.nan_to_num(values) / factor), _MISSING)
    content = base64.b64encode(steps.astype("<i2").tobytes()).decode("ascii")
    return {"factor": float(f"{factor:.9g}"), "content": content}


def _counts(frame: pd.DataFrame, total: int) -> Record:
    stable = int(frame["stable"].fillna(False).sum())
    failed = int(frame["stable"].isna().sum())
    count = violating(frame)
    return {
        "total": total,
        "stable": stable,
        "unstable": len(frame) - stable - failed,
        "failed": failed,
        "waiting": total - len(frame),
        **({} if count is None else {"violating": count}),
    }


def _accuracy(frame: pd.DataFrame, about: Mapping[str, Any]) -> Record:
    """What the detailed runs beside those of the study say."""
    checked = frame[frame["checked"].notna()]
    errors = checked[checked["error_rms_deg"].notna()]
    record: Record = {
        "asked": about["study"]["check"]["sample"] != 0,
        "checked": len(checked),
        "other_verdict": other_verdicts(frame),
        "other_criteria": list(other_criteria(frame)),
        "beyond_tolerance": _beyond(checked, about["settings"].get("tolerance_deg")),
        "further": "".join(further_errors(frame)).removeprefix(", "),
        "compared": len(errors),
    }
    if len(errors):
        worst = errors.sort_values("error_rms_deg").iloc[-1]
        record |= {
            "largest_rms_deg": _figure(worst["error_rms_deg"]),
            "median_rms_deg": _figure(errors["error_rms_deg"].median()),
            "worst": int(worst["number"]),
            "worst_name": str(worst["name"]),
            "worst_machine": _figure(worst["error_machine"]),
        }
    return record


def _beyond(checked: pd.DataFrame, tolerance_deg: float | None) -> list[str]:
    """Names of checked runs whose error is above the tolerance."""
    if tolerance_deg is None:
        return []
    return [str(name) for name in checked["name"][checked["error_coi_deg"] > tolerance_deg]]


def _warnings(about: Mapping[str, Any]) -> Record:
    settings = about["settings"]
    kinds = ("method_doubts", "warnings", "data_doubts", "limits_moved", "case_notices")
    others = [item for kind in kinds for item in settings.get(kind, ())] + about.get("notices", [])
    return {
        "validated": settings["validated"],
        "replacements": [
            f"{item['model']}: {item['outcome']}, {item['records']} records from {item['first']}, "
            f"{item['share']:.1%} of {item['of']}"
            for item in settings["replacements"]
        ],
        "unsupported": [
            str(item) for item in (*settings["unsupported"], *settings.get("unplaced", ()))
        ],
        "others": list(dict.fromkeys(map(str, others))),
    }


def _map(about: Mapping[str, Any]) -> Record:
    """The map of the store, with the buses of the machines that are kept nonlinear."""
    kept = about["settings"].get("kept", [])
    return {
        **with_places(about["map"]),
        "kept": sorted({int(unit.partition(":")[0]) for unit in kept}),
    }


def _events(events: Sequence[Mapping[str, Any]]) -> Record:
    faults = [[e["start"], e["start"] + e["duration"]] for e in events if "duration" in e]
    words = [event_words(event) for event in events]
    return {"words": words, "faults": faults, **event_places(events)}


def _rows(frame: pd.DataFrame) -> list[list[Any]]:
    plain = frame.astype(object).where(frame.notna(), None)
    return [[_figure(value) for value in row] for row in plain.itertuples(index=False)]


def _figure(value: Any) -> Any:
    """A figure ready for JSON: None if it is missing, a few significant digits."""
    if value is None:
        return None
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None
    return _words(str(value))


def _words(text: str) -> str:
    text = _LOST.sub(r"machine \1 lost synchronism at \2 s", text)
    return _OFF_SPEED.sub(r"machine \1 was off speed at \2 s", text)


def _all_curves(store: StudyStore, numbers: Sequence[int], room: int) -> Record:
    """Curves by number as far as there is room, their times, and whether some are left out."""
    times: list[list[float]] = []
    curves: dict[int, Record] = {}
    for number in numbers:
        if room <= 0:
            break
        found = _curves(store.curves(number), times)
        if found is not None:
            curves[number] = found
            room -= sum(len(run["content"]) for run in found["runs"].values())
            for what in ("watched", "decided"):
                room -= sum(len(panel["content"]) for panel in found.get(what, _NONE)["panels"])
    return {"times": times, "curves": curves, "some_left_out": room <= 0}


def _curves(curves: Mapping[str, NDArray[Any]] | None, times: list[list[float]]) -> Record | None:
    """The curves of a contingency; its times are put into `times` if they are new there."""
    if curves is None:
        return None
    outside = curves["units_outside"].tolist() if "units_outside" in curves else []
    record: Record = {"units": curves["units"].tolist(), "outside": outside, "runs": {}}
    for name in ("run", "detailed", "linear"):
        if f"{name}_angles" in curves:
            where = _position(curves[f"{name}_times"], times)
            # Sample after sample of one machine, then of the next.
            record["runs"][name] = {"times": where, **packed(curves[f"{name}_angles"].T)}
    if "watched_names" in curves:
        left_out = int(curves["watched_left_out"])
        record["watched"] = {**_panels(curves, "watched", times), "left_out": left_out}
    if "decided_names" in curves:
        record["decided"] = _panels(curves, "decided", times)
        names, values = curves["limit_names"].tolist(), curves["limit_values"].tolist()
        for panel in record["decided"]["panels"]:
            pairs = zip(names, values, strict=True)
            panel["limits"] = [value for name, value in pairs if name == panel["kind"]]
    if "error" in curves:
        record["error"] = packed(curves["error"], finest=1e-4)
    record["switches"] = [
        [round(float(time), 6), str(model), str(reason)]
        for time, model, reason in zip(
            curves["switch_times"], curves["switch_models"], curves["switch_reasons"], strict=True
        )
    ]
    return record


def _panels(curves: Mapping[str, NDArray[Any]], what: str, times: list[list[float]]) -> Record:
    """What was watched, or what decided, kind by kind, each with a factor of its own."""
    names, values = curves[f"{what}_names"].tolist(), curves[f"{what}_values"]
    kinds = dict.fromkeys(name.partition(":")[0] for name in names)
    panels = []
    for kind in kinds:
        places = [k for k, name in enumerate(names) if name.partition(":")[0] == kind]
        size = float(np.nanmax(np.abs(values[places]), initial=0.0))
        panels.append(
            {
                "kind": kind,
                "axis": axis_text(kind).replace("\n", " "),
                "labels": [names[k].partition(":")[2] for k in places],
                **packed(values[places], finest=size / _LARGEST or 1.0),
            }
        )
    return {"times": _position(curves[f"{what}_times"], times), "panels": panels}


def _position(samples: NDArray[Any], times: list[list[float]]) -> int:
    """Where these times stand in `times`: most runs have the same."""
    wanted = [round(float(sample), 5) for sample in samples]
    if wanted not in times:
        times.append(wanted)
    return times.index(wanted)


def _paper(about: Mapping[str, Any], listed: Sequence[Mapping[str, Any]]) -> Record | None:
    """Clearing times in Table I of the paper by contingency; None for another case."""
    if about["case"] != "npcc":
        return None
    times = {
        item["number"]: TABLE_1[item["events"][0]["bus"]].cct
        for item in listed
        if _is_of_table_1(item["events"])
    }
    return {"source": f"{SOURCE}, Table I", "times": times} if times else None


def _is_of_table_1(events: Sequence[Mapping[str, Any]]) -> bool:
    """Whether this is a bolted fault at a bus of the table that clears by itself."""
    if len(events) != 1 or events[0]["kind"] != "bus-fault":
        return False
    event = events[0]
    plain = not (event["trip_bus"] or event["resistance"] or event["reactance"])
    return plain and event["bus"] in TABLE_1


def _provenance(about: Mapping[str, Any]) -> list[list[str]]:
    """Pairs of a term and what is said about it."""
    settings, last = about["settings"], about.get("last_run", {})
    pairs = [
        ["gridfold", f"{about['gridfold']}, sources {about.get('sources', 'not told')}"],
        ["Case data", f"{about['case']}, fingerprint {about['fingerprint']}"],
        ["Loads", about["study"]["case"]["loads"]],
        ["Study area", f"buses {settings['study_buses']}" if settings["study_buses"] else "none"],
        ["Integration", f"{settings['step'] * 1000:g} ms, {settings['method_reason']}"],
    ]
    if single := about.get("single_precision"):
        pairs.append(["Single precision", single_words(single)])
    if "column_norm" in settings:
        angle = settings.get("angle_deg")
        switching = "never switching" if angle is None else f"switching at {angle:g} degrees"
        pairs.append(["Thresholds", f"column norm {settings['column_norm']:g} p.u., {switching}"])
    if "kept" in settings:
        kept = ", ".join(settings["kept"]) or "none"
        pairs.append(["Machines kept nonlinear", kept])
    if settings.get("order") is not None:
        bound = settings.get("bound")
        text = f"order {settings['order']}"
        pairs.append(["Reduction", text if bound is None else f"{text}, error bound {bound:.3g}"])
    if files := about.get("files"):
        pairs.append(["Files, SHA-256", "; ".join(f"{name} {sha}" for name, sha in files.items())])
    if last:
        pairs += [
            ["Last run ended", last["finished"]],
            ["Workers", last["workers"]],
            ["Machine", last["machine"]],
            ["Python, NumPy", f"{last['python']}, {last['numpy']}"],
        ]
    return [[term, str(text)] for term, text in pairs]
