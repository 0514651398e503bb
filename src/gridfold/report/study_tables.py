"""Tables about studies for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gridfold.editing.editor import EDITED
from gridfold.io.study_damage import Damage
from gridfold.io.study_store import StudyStore
from gridfold.report.criteria_tables import criteria_facts, violating
from gridfold.report.plain import as_lines
from gridfold.report.tables import shortened
from gridfold.study.single_precision import single_words
from gridfold.study.work import StudyRun

if TYPE_CHECKING:
    import pandas as pd

#: What is said of the largest error of figures in the runs that were checked.
FURTHER_ERRORS = {
    "error_damping_ratio": "damping within {:.2%}",
    "error_nadir_hz": "lowest frequencies within {:.2g} Hz",
    "error_lowest_voltage": "lowest voltages within {:.2g} p.u.",
}
#: Reasons and damages that are told.
_REASONS = 3


@dataclass(frozen=True)
class Counts:
    """Contingencies of a study: all, those with a result, and what came of these."""

    total: int
    stable: int
    unstable: int
    failed: int
    violating: int | None = None

    @property
    def done(self) -> int:
        """Those with a result."""
        return self.stable + self.unstable + self.failed

    def record(self) -> dict[str, int]:
        """Ready for JSON."""
        given = {name: count for name, count in asdict(self).items() if count is not None}
        return given | {"waiting": self.total - self.done}

    def __str__(self) -> str:
        text = f"{self.total} contingencies: {self.stable} stable, {self.unstable} not"
        text += f", {self.failed} failed"
        if self.violating is not None:
            text += f", {self.violating} violate criteria"
        return text if self.done == self.total else f"{text}, {self.total - self.done} not done"


def study_counts(store: StudyStore) -> Counts:
    """The counts of a study as it is now."""
    frame = store.frame()
    stable = int(frame["stable"].fillna(False).sum())
    failed = int(frame["stable"].isna().sum())
    unstable = len(frame) - stable - failed
    return Counts(len(store.contingencies()), stable, unstable, failed, violating(frame))


def failure_lines(frame: pd.DataFrame, total: int) -> list[str]:
    """How many failed, why the first ones did, and what to do."""
    failed = frame[frame["stable"].isna()].sort_values("number")
    lines = [
        f"{row['name']!r} failed: {row['reason']}"
        for row in failed.head(_REASONS).to_dict("records")
    ]
    if len(failed) > _REASONS:
        lines.append(f"... and {len(failed) - _REASONS} more: --where \"status = 'failed'\"")
    return [*lines, f"{len(failed)} of {total} failed; --retry-failed tries them again"]


def damage_lines(damage: Sequence[Damage], folder: Path) -> list[str]:
    """What is not whole of a store, and what to do."""
    lines = [str(item) for item in damage[:_REASONS]]
    if len(damage) > _REASONS:
        lines.append(f"... and {len(damage) - _REASONS} more (all of them with check --json -)")
    advice = f"gridfold check {folder} --repair keeps what is whole"
    return [*lines, advice] if lines else []


def study_facts(store: StudyStore, outcome: StudyRun | None = None) -> dict[str, str]:
    """What a study is about and what came of it, by name."""
    about, frame = store.identity, store.frame()
    counts = study_counts(store)
    if missing := [name for name in ("study", "settings", "case") if name not in about]:
        return {"Contingencies": str(counts), "Study": f"{missing[0]!r} cannot be read"}
    settings = about["settings"]
    facts = {
        "Study": about["study"]["name"],
        "Case": f"{about['case']}, {settings['machines']} machines, {settings['states']} states",
        "Model": _model(settings),
        "Contingencies": f"{counts.done} of {counts.total} done",
        "Outcome": f"{counts.stable} stable, {counts.unstable} not, {counts.failed} failed",
    }
    if settings.get("method_doubts"):
        facts["Time step"] = "; ".join(settings["method_doubts"])
    if single := about.get("single_precision"):
        facts["Single precision"] = single_words(single)
    done = [line for line in settings.get("case_notices", ()) if line.startswith(EDITED)]
    if done:
        facts[f"Edits ({len(done)})"] = as_lines([line.removeprefix(EDITED) for line in done])
    facts |= criteria_facts(frame)
    facts |= _evidence(settings, frame)
    if not settings["validated"]:
        facts["Not validated"] = _why_not_validated(settings)
    warnings = (*settings.get("warnings", ()), *about.get("notices", ()))
    for name, lines in (("Warnings", warnings), ("Unusual data", settings.get("data_doubts", ()))):
        if lines:
            facts[f"{name} ({len(lines)})"] = as_lines(shortened(lines, 1))
    if outcome is not None:
        facts["Time"] = f"{outcome.seconds:.1f} s with {outcome.workers}"
        if outcome.here:
            facts["Rate"] = f"{outcome.per_second:.3g} contingencies a second, all included"
        facts["Results"] = str(outcome.folder)
    return facts


def _evidence(settings: Mapping[str, Any], frame: pd.DataFrame) -> dict[str, str]:
    """What is known of the errors of a reduced model, and of what it saves."""
    facts: dict[str, str] = {}
    errors = frame["error_rms_deg"].dropna()
    if len(errors):
        worst = float(errors.max())
        facts["Checked in detail"] = (
            f"{len(errors)}: rotor angles of the study area within {worst:.2f} degrees RMS"
            + "".join(further_errors(frame))
        )
    if other := other_verdicts(frame):
        facts["Other verdict in detail"] = ", ".join(other)
    if settings.get("tolerance_deg") is not None:
        facts["Tolerance"] = _kept_tolerance(settings["tolerance_deg"], frame)
    if settings.get("tolerance_told"):
        facts["Chosen for the tolerance"] = settings["tolerance_told"]
    if settings.get("moved_modes"):
        facts["Modes moved by the reduction"] = "; ".join(settings["moved_modes"])
    if settings.get("model_reason"):
        facts["Model chosen"] = settings["model_reason"]
    saved = _compared_with_detailed(frame)
    if saved:
        facts["Detailed model"] = saved
    return facts


def further_errors(frame: pd.DataFrame) -> Iterator[str]:
    """How far damping, frequency and voltage are off in the runs that were checked."""
    for column, text in FURTHER_ERRORS.items():
        errors = frame[column].dropna().abs()
        if len(errors):
            yield f", {text.format(errors.max())}"


def other_verdicts(frame: pd.DataFrame) -> list[str]:
    """Names of those that ended otherwise in the detailed model."""
    checked = frame[frame["checked"].notna()]
    same = checked["checked"].str.replace("_", " ") == checked["status"]
    return [str(name) for name in checked["name"][~same.fillna(False)]]


def _why_not_validated(settings: dict[str, Any]) -> str:
    lines = [
        f"{item['model']}: {item['outcome']} ({item['records']}, {item['share']:.1%})"
        for item in settings["replacements"]
    ]
    lines += settings.get("unplaced", ())
    return "; ".join(lines) or "parts of the network are left out"


def _kept_tolerance(tolerance_deg: float, frame: pd.DataFrame) -> str:
    """The estimates, and how they and the tolerance stand in the runs that were checked."""
    estimates = frame["error_estimate_deg"].dropna()
    text = f"{tolerance_deg:g} degrees RMS against the centre of inertia"
    if len(estimates):
        text += f"; estimated errors up to {estimates.max():.2g}"
        if estimates.max() > 0:
            text += f" ({_causes(frame[frame['error_estimate_deg'] == estimates.max()].iloc[0])})"
    both = frame[["error_estimate_deg", "error_coi_deg"]].dropna()
    if len(both):
        above = int((both["error_coi_deg"] > tolerance_deg).sum())
        below = int((both["error_estimate_deg"] < both["error_coi_deg"]).sum())
        text += (
            f"; of {len(both)} checked runs {above} beyond the tolerance, {below} with an error above "
            "the estimate"
        )
    return text


def _causes(row: pd.Series) -> str:
    """Where the error of a run came from."""
    causes = ("linearization", "truncation", "jump")
    return ", ".join(f"{name} {row[f'error_{name}_deg']:.2g}" for name in causes)


def _compared_with_detailed(frame: pd.DataFrame) -> str | None:
    """What the detailed model would have taken, by the runs that were checked."""
    if not {"wall_run_s", "wall_check_s"} <= set(frame.columns):
        return None
    both = frame[["wall_run_s", "wall_check_s"]].dropna()
    ours, detailed = float(both["wall_run_s"].sum()), float(both["wall_check_s"].sum())
    if not len(both) or not detailed:
        return None
    would = detailed / len(both) * len(frame)
    return (
        f"would have taken about {would:.3g} s for all runs; this one takes {ours / detailed:.2f} of "
        f"it in the {len(both)} that were checked, reductions for new topologies included"
    )


def count_line(rows: int, limit: int, counts: Counts) -> str:
    """How many rows are shown, chosen and there: no filter hides that others failed."""
    more = f" ({rows - limit} more rows)" if rows > limit else ""
    return f"{min(limit, rows)} shown of {rows} rows{more}; {counts}"


def _model(settings: dict[str, Any]) -> str:
    words = [settings["model"]]
    if "order" in settings:
        words.append(f"order {settings['order']}")
    if "kept" in settings:
        words.append(f"{len(settings['kept'])} of {settings['external_machines']} machines kept")
    if settings.get("angle_deg"):
        words.append(f"switching at {settings['angle_deg']:g} degrees")
    words.append(f"{settings['method']} with {settings['step'] * 1000:g} ms")
    return ", ".join(words)
