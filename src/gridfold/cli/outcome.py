"""A disturbance simulated with the model chosen, and what there is to tell about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from gridfold.cli.choice import Simulator
from gridfold.cli.console import out
from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun, Attempt, Switch
from gridfold.equivalents.compare import Comparison, UnitError, compare
from gridfold.equivalents.error_budget import ErrorBudget
from gridfold.equivalents.error_causes import NO_CAUSES, ErrorCauses
from gridfold.grid.case import UnitKey
from gridfold.grid.criteria import Criterion
from gridfold.grid.events import Event
from gridfold.report.tables import budget_table, error_table, facts_table, switch_table
from gridfold.runs.method import Choice
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.streaming import simulate_to_files
from gridfold.runs.summary import Summary
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.table_files import TableFile
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

_NO_COMPARISON = "No comparison: the run itself is detailed."


@dataclass(frozen=True)
class Tolerance:
    """An error in degrees that was allowed, the estimated one, its causes, and the runs tried."""

    tolerance_deg: float
    error_estimate_deg: float
    causes: ErrorCauses = NO_CAUSES
    attempts: tuple[Attempt, ...] = ()

    @property
    def text(self) -> str:
        """For people."""
        text = f"about {self.error_estimate_deg:.2g} degree of {self.tolerance_deg:g} allowed"
        if self.error_estimate_deg > 0:
            text += f": {self.causes.text}"
        for tried in self.attempts:
            if tried.refused is not None:
                about = "" if tried.estimate_deg is None else f" (about {tried.estimate_deg:.2g})"
                text += f"; not {tried.mode.value}, {tried.refused}{about}"
        return text

    def record(self) -> dict[str, Any]:
        """The same, ready for JSON."""
        return {
            "tolerance_deg": self.tolerance_deg,
            "error_estimate_deg": self.error_estimate_deg,
            "error_causes_deg": self.causes.record(),
            "attempts": [tried.record() for tried in self.attempts],
        }


@dataclass(frozen=True)
class Outcome:
    """A run, and what there is to tell about a reduced model: the log, times, errors.

    A run whose tables have been written already comes with its summary.
    """

    run: Trajectory
    switches: tuple[Switch, ...] | None = None
    reduction_seconds: float = 0.0
    detailed: Trajectory | None = None
    comparison: Comparison | None = None
    note: str | None = None
    budget: ErrorBudget | None = None
    tolerance: Tolerance | None = None
    summary: Summary | None = None

    def record(self) -> dict[str, Any]:
        """What the JSON file says besides the run itself; of the detailed model why no errors."""
        kept = {} if self.tolerance is None else self.tolerance.record()
        return kept | self._model_record()

    def _model_record(self) -> dict[str, Any]:
        no_comparison = {"comparison": None, "comparison_note": self.note}
        if self.switches is None:
            return {} if self.note is None else no_comparison
        modes = [(switch.before, switch.after) for switch in self.switches]
        record: dict[str, Any] = {
            "reduction_seconds": self.reduction_seconds,
            "switches": [
                switch._asdict()
                | {"before": None if before is None else before.value, "after": after.value}
                for switch, (before, after) in zip(self.switches, modes, strict=True)
            ],
        }
        if self.budget is not None:
            record["error_budget"] = [
                asdict(row)
                | {"error": row.error and _error_record(row.error), "status": row.status.value}
                for row in self.budget.rows
            ]
        if self.detailed is None:
            return record
        record |= no_comparison
        if self.comparison is not None:
            record["comparison"] = {
                "detailed_seconds": self.detailed.simulation_seconds,
                "units": [_error_record(error) for error in ranked(self.comparison)],
                "state_rms": self.comparison.state_rms,
            }
        return record

    def show(self) -> None:
        """Print it for people."""
        if self.tolerance is not None:
            out.print(facts_table({"Error": self.tolerance.text}))
        if self.switches is not None:
            out.print(switch_table(self.switches))
            out.print(facts_table({"Reduced models": f"built in {self.reduction_seconds:.3f} s"}))
        if self.comparison is not None:
            out.print(error_table(self.comparison))
        if self.note is not None:
            out.print(self.note, style="yellow")
        if self.budget is not None:
            out.print(budget_table(self.budget))


@dataclass(frozen=True)
class Disturbance:
    """A disturbance to be simulated."""

    model: DetailedModel
    events: Sequence[Event]
    t_end: float
    method: Choice
    criterion: SynchronismCriterion | None
    study_buses: frozenset[int] | None = None
    criteria: Sequence[Criterion] = ()

    def solve(self, simulator: Simulator, comparing: bool, budgeting: bool = False) -> Outcome:
        """On the model of `simulator`.

        `comparing` adds a detailed run beside it, `budgeting` the error by its causes.
        """
        store: ModelStore = {}
        stepper, reason = self.method.stepper, self.method.reason
        rest = (self.model, self.events, self.t_end, stepper, self.criterion, store)
        if simulator.small is None:
            note = _NO_COMPARISON if comparing else None
            run = replace(simulate(*rest), method_reason=reason, study_buses=self.study_buses)
            return Outcome(run, note=note, tolerance=_kept(simulator, 0.0))
        found = simulator.run(*rest, self.criteria)
        seconds = simulator.seconds + found.reduction_seconds
        trajectory = replace(found.trajectory, method_reason=reason)
        kept = _kept(simulator, found.error_estimate_deg, found)
        result = Outcome(trajectory, found.switches, seconds, tolerance=kept)
        if budgeting:
            result = replace(result, budget=simulator.budget(self.events, self.t_end, stepper))
        if not comparing:
            return result
        detailed = simulate(*rest)
        for name, done in (("reduced", result.run), ("detailed", detailed)):
            if done.status is not Status.COMPLETED:
                note = (
                    f"No comparison: the {name} run ended at {done.times[-1]:g} s "
                    f"({done.status.value})."
                )
                return replace(result, detailed=detailed, note=note)
        units = _comparable(detailed, simulator.study_units)
        if not units:
            note = "No comparison: no machine of the study area has a rotor."
            return replace(result, detailed=detailed, note=note)
        return replace(result, detailed=detailed, comparison=compare(detailed, result.run, units))

    def stream(self, simulator: Simulator, tables: Sequence[TableFile], comparing: bool) -> Outcome:
        """On the detailed model, with its tables written while it runs."""
        run, summary = simulate_to_files(
            self.model, tables, self.events, self.t_end, self.method, self.criterion,
            study_buses=self.study_buses,
        )  # fmt: skip
        note = _NO_COMPARISON if comparing else None
        return Outcome(run, note=note, tolerance=_kept(simulator, 0.0), summary=summary)


def _kept(
    simulator: Simulator, estimate_deg: float | None, found: AdaptiveRun | None = None
) -> Tolerance | None:
    """What there is to tell of the tolerance, if there is one."""
    if simulator.tolerance_deg is None or estimate_deg is None:
        return None
    if found is None:
        return Tolerance(simulator.tolerance_deg, estimate_deg)
    causes = found.error_causes or NO_CAUSES
    return Tolerance(simulator.tolerance_deg, estimate_deg, causes, found.attempts)


def ranked(comparison: Comparison) -> list[UnitError]:
    """Errors of the machines, the largest first."""
    return sorted(comparison.units, key=lambda error: -error.rms_deg)


def _error_record(error: UnitError) -> dict[str, Any]:
    return asdict(error) | {"unit": str(error.unit)}


def _comparable(run: Trajectory, units: Sequence[UnitKey]) -> list[UnitKey]:
    """Machines among `units` that are in service at some time of the run."""
    machines = [unit for unit in units if unit in run.model.machines]
    missing = np.isnan(run.rotor_angle_deg(machines))
    return [unit for k, unit in enumerate(machines) if not missing[:, k].all()]
