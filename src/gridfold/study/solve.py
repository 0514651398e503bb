"""One contingency, from its events to a row of figures and the curves of the report."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.adaptive import AdaptiveRun, Switch, simulate_adaptive
from gridfold.equivalents.compare import compare
from gridfold.equivalents.error_causes import NO_CAUSES, ErrorCauses
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.equivalents.together import simulate_adaptive_batch, why_reduced_single
from gridfold.errors import GpuError, GridfoldError
from gridfold.grid.case import UnitKey
from gridfold.grid.criteria import VoltageDip, VoltageRecovery
from gridfold.grid.events import Event
from gridfold.io.study_store import Result
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.deadline import time_limit
from gridfold.numerics.steppers import Stepper
from gridfold.runs.batch import FEWEST_TOGETHER, simulate_batch, why_single
from gridfold.runs.clearing import ClearingTime, critical_clearing_time
from gridfold.runs.criteria import Finding, Verdict, judge
from gridfold.runs.cuda import simulate_on_gpu
from gridfold.runs.members import Outcome
from gridfold.runs.monitor import Columns
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.table_files import TableFile, TableFormat
from gridfold.runs.trajectory import Trajectory
from gridfold.study.clearing import clearing_times, only_fault
from gridfold.study.curves import run_curves, sampled_rows
from gridfold.study.generate import Contingency
from gridfold.study.judged import judged_figures, names_of
from gridfold.study.prepare import Prepared
from gridfold.study.study_file import Kept, SideBySide
from gridfold.study.summary import Figures, time_per_model, trajectory_figures
from gridfold.study.watched import watched_curves


@dataclass(frozen=True)
class Task:
    """A contingency to be solved, and whether a detailed run checks it."""

    contingency: Contingency
    check: bool


#: Tasks that one worker takes together.
Batch = tuple[Task, ...]
#: Simulates disturbances together, as :func:`simulate_batch` does.
RunTogether = Callable[..., Iterator[tuple[int, Outcome]]]
#: The model of each task, at an operating point of its own; None where it is that of the study.
Models = Sequence[DetailedModel] | None


@dataclass(frozen=True)
class Solved:
    """What came of a task: the result, and the trajectory as a Parquet file if it is kept.

    `notices` say what kept its batch from running as it should have; a study tells each once.
    """

    result: Result
    parquet: bytes | None = None
    notices: tuple[str, ...] = ()

    @property
    def figures(self) -> dict[str, Any]:
        """The row of figures."""
        return dict(self.result.figures)


@one_blas_thread
def solve_batch(prepared: Prepared, batch: Batch, models: Models = None) -> tuple[Solved, ...]:
    """Simulate some contingencies, side by side where that is faster, else one after the other.

    `models` are the model of each, at an operating point of its own; by default that of the study.

    Raises
    ------
    GpuError
        The GPU that is asked for fails.
    """
    known: dict[int, Solved] = {}
    notices: list[str] = []
    if len(batch) >= FEWEST_TOGETHER and why_one_by_one(prepared) is None:
        if prepared.on_gpu and models is None:
            notices += _on_gpu(prepared, batch, known)
        if len(known) < len(batch) and (notices or models is not None or not prepared.on_gpu):
            notices += _on_cpu(prepared, batch, models, known)
    solved = [
        known.get(number) or solve(_at(prepared, models, number), task)
        for number, task in enumerate(batch)
    ]
    told = [replace(first, notices=tuple(notices)) for first in solved[:1]]
    return (*told, *solved[1:])


def _at(prepared: Prepared, models: Models, number: int) -> Prepared:
    """The study at the operating point of one of its tasks."""
    if models is None:
        return prepared
    model = models[number]
    return replace(prepared, model=model, intact={model.state: model})


def _on_gpu(prepared: Prepared, batch: Batch, known: dict[int, Solved]) -> list[str]:
    """Put what a GPU makes of the tasks to what is known; returns how it failed, if it did."""
    try:
        on_gpu = partial(simulate_on_gpu, precision=prepared.study.run.precision)
        known.update(_side_by_side(prepared, batch, None, on_gpu))
    except Exception as error:  # of the compiler or the driver, of whatever kind
        what = in_words(error)
        if prepared.gpu_only:
            raise GpuError(f"the GPU failed: {what}; auto and cpu run on the CPU") from error
        return [f"contingencies run on the CPU: the GPU failed: {what}"]
    return []


def _on_cpu(
    prepared: Prepared, batch: Batch, models: Models, known: dict[int, Solved]
) -> list[str]:
    """Put what comes of the other tasks, side by side, to what is known; returns how that failed."""
    left = [number for number in range(len(batch)) if number not in known]
    tasks = tuple(batch[number] for number in left)
    own = None if models is None else [models[number] for number in left]
    run_together = simulate_batch if own is None else partial(simulate_batch, models=own)
    try:
        for place, solved in (
            _side_by_side(prepared, tasks, own, run_together)
            if prepared.small is None
            else _reduced_side_by_side(prepared, tasks)
        ):
            known[left[place]] = solved
    except Exception as error:  # each is tried by itself, and tells there what is wrong with it
        return [f"contingencies run one by one, not side by side: {in_words(error)}"]
    return []


def in_words(error: Exception) -> str:
    """An error of whatever kind in a line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def why_by_itself(prepared: Prepared) -> str | None:
    """Why each contingency of a study runs by itself, whatever there is to run them; None if not."""
    if prepared.study.run.batch is SideBySide.OFF:
        return "batch = off asks for them one by one"
    if prepared.relays:
        return "relays watch every run"
    if prepared.time_limit is not None:
        return "each has a time limit of its own"
    return None


def why_one_by_one(prepared: Prepared) -> str | None:
    """Why the contingencies of a study do not advance together; None if they do."""
    if (reason := why_by_itself(prepared)) is not None:
        return reason
    if prepared.tolerant is not None:
        return "a tolerance decides about every run by itself"
    why = why_single if prepared.small is None else why_reduced_single
    return why(prepared.model, prepared.method.stepper)


def _side_by_side(
    prepared: Prepared, batch: Batch, models: Models, run_together: RunTogether
) -> Iterator[tuple[int, Solved]]:
    """What comes of the tasks of a batch that ran together, by their places in it."""
    disturbances = [task.contingency.events for task in batch]
    runs = run_together(
        prepared.model,
        disturbances,
        prepared.study.run.t_end,
        prepared.method.stepper,
        prepared.criterion,
        dict(prepared.intact),
        every_state=_looks_at_every_state(prepared),
    )
    times = clearing_times(prepared, disturbances, models)
    for number, run in runs:
        if isinstance(run, Trajectory):
            area = None if prepared.parts is None else prepared.parts.study_buses
            within = replace(run, study_buses=area)
            solver = _Solver(_at(prepared, models, number), batch[number], times.get(number))
            yield number, solver.detailed(within)


def _reduced_side_by_side(prepared: Prepared, batch: Batch) -> Iterator[tuple[int, Solved]]:
    """The same for tasks that are simulated on reduced models."""
    assert prepared.small is not None
    runs = simulate_adaptive_batch(
        prepared.model,
        prepared.small,
        prepared.rule,
        [task.contingency.events for task in batch],
        prepared.study.run.t_end,
        prepared.method.stepper,
        prepared.criterion,
        dict(prepared.intact),
    )
    for number, run in runs:
        if isinstance(run, AdaptiveRun):
            yield number, _Solver(prepared, batch[number]).reduced(run)


def _looks_at_every_state(prepared: Prepared) -> bool:
    """Whether more is wanted of a run than its rotor angles and speeds: voltages follow from all."""
    wanted = prepared.study.outputs
    judged = any(isinstance(item, VoltageDip | VoltageRecovery) for item in prepared.criteria)
    watched = wanted.curves and wanted.monitor is not None
    return judged or wanted.trajectories is not Kept.NONE or watched


@one_blas_thread
def solve(prepared: Prepared, task: Task) -> Solved:
    """Simulate a contingency; whatever goes wrong becomes a row with its reason."""
    began = time.perf_counter()
    try:
        with time_limit(prepared.time_limit):
            return _Solver(prepared, task).solve(began)
    except GridfoldError as error:
        return failed(task, str(error), time.perf_counter() - began)
    except Exception as error:  # one contingency is never the end of a study
        reason = f"{type(error).__name__}: {error}"
        return failed(task, reason, time.perf_counter() - began)


def failed(task: Task, reason: str, seconds: float | None = None) -> Solved:
    """The row of a contingency that could not be simulated."""
    text = " ".join(reason.split())
    figures = Figures(status="failed", reason=text, wall_s=seconds)
    return Solved(Result(task.contingency.number, vars(figures)))


@dataclass
class _Solver:
    """The runs of one contingency, with the models of the networks that it leads through.

    `clearing_time` is its critical clearing time, where that is known.
    """

    prepared: Prepared
    task: Task
    clearing_time: ClearingTime | None = None
    store: ModelStore = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.store.update(self.prepared.intact)

    @property
    def small(self) -> SmallModels | None:
        """Small models, shared by all contingencies."""
        return self.prepared.small

    @property
    def events(self) -> tuple[Event, ...]:
        """What happens, and the relays that watch."""
        return (*self.task.contingency.events, *self.prepared.relays)

    @property
    def columns(self) -> Columns:
        """What is watched."""
        assert self.prepared.columns is not None
        return self.prepared.columns

    def solve(self, began: float) -> Solved:
        """Run it, and look at the run."""
        events = self.events
        if self.small is None:
            return self.detailed(self._detailed(events))
        return self._reduced(self._adaptive_run(self.small, events), began)

    def reduced(self, adaptive: AdaptiveRun) -> Solved:
        """Look at a run on reduced models."""
        spent = _seconds(adaptive.trajectory) + adaptive.reduction_seconds
        return self._reduced(adaptive, time.perf_counter() - spent)

    def _reduced(self, adaptive: AdaptiveRun, began: float) -> Solved:
        figures: dict[str, Any] = time_per_model(adaptive.trajectory, adaptive.modes)
        figures["wall_reduction_s"] = adaptive.reduction_seconds
        figures["wall_run_s"] = time.perf_counter() - began
        figures["error_estimate_deg"] = adaptive.error_estimate_deg
        figures |= _cause_figures(adaptive.error_causes)
        figures["switches"] = max(0, len(adaptive.switches) - 1)
        return self._looked_at(adaptive.trajectory, figures, adaptive.switches, began)

    def detailed(self, run: Trajectory) -> Solved:
        """Look at a detailed run."""
        began = time.perf_counter() - _seconds(run)
        figures: dict[str, Any] = time_per_model(run)
        if self.prepared.study.model.tolerance_deg is not None:
            figures |= {"error_estimate_deg": 0.0, **_cause_figures(NO_CAUSES)}
        return self._looked_at(run, figures, (), began)

    def _looked_at(
        self,
        run: Trajectory,
        figures: dict[str, Any],
        switches: tuple[Switch, ...],
        began: float,
    ) -> Solved:
        """The row, the curves and the table of a run."""
        figures |= trajectory_figures(run)
        findings = self._judge(run)
        figures |= judged_figures(findings, figures.get("error_estimate_deg"))
        beside: dict[str, Trajectory] = {}
        if self.task.check and self.small is not None:
            checked, beside = self._check(run, figures, self.small)
            figures |= checked
        critical = figures["critical_machine"]
        wanted, curves = self.prepared.study.outputs, None
        if wanted.curves:
            curves = run_curves(run, beside, switches, findings, self._units_of(run), critical)
            if wanted.monitor is not None:
                curves |= watched_curves(run, self.columns, sampled_rows(run))
        figures |= self._clearing_time()
        figures["wall_s"] = time.perf_counter() - began
        row = vars(Figures(**figures))
        result = Result(self.task.contingency.number, row, curves)
        return Solved(result, self._parquet(run, stable=bool(row["stable"])))

    def _detailed(self, events: Sequence[Event]) -> Trajectory:
        ready = self.prepared
        rest = (ready.study.run.t_end, ready.method.stepper, ready.criterion, self.store)
        area = None if ready.parts is None else ready.parts.study_buses
        return replace(simulate(ready.model, events, *rest), study_buses=area)

    def _adaptive_run(self, small: SmallModels, events: Sequence[Event]) -> AdaptiveRun:
        """The study's model."""
        ready = self.prepared
        if ready.tolerant is None:
            return self._adaptive(small, ready.rule, events)
        rest = (ready.study.run.t_end, ready.method.stepper, ready.criterion, self.store)
        return ready.tolerant.run(ready.model, events, *rest, ready.criteria)

    def _adaptive(
        self, small: SmallModels, rule: SwitchingRule, events: Sequence[Event]
    ) -> AdaptiveRun:
        ready = self.prepared
        rest = (ready.study.run.t_end, ready.method.stepper, ready.criterion, self.store)
        return simulate_adaptive(ready.model, small, rule, events, *rest)

    def _check(
        self, run: Trajectory, found: dict[str, Any], small: SmallModels
    ) -> tuple[dict[str, Any], dict[str, Trajectory]]:
        """Errors of a run and its figures, and a detailed and a linear run of the same."""
        events = self.events
        detailed = self._detailed(events)
        linear = self._adaptive(small, SwitchingRule(inf), events).trajectory
        figures: dict[str, Any] = {
            "checked": detailed.status.value,
            "wall_check_s": _seconds(detailed),
        }
        if self.prepared.criteria:
            judged = self._judge(detailed)
            figures["checked_violated"] = names_of(judged, Verdict.VIOLATED)
        right = trajectory_figures(detailed)
        for name in ("damping_ratio", "nadir_hz", "lowest_voltage"):
            if found.get(name) is not None and right.get(name) is not None:
                figures[f"error_{name}"] = found[name] - right[name]
        out = detailed.models[-1].state.units_out
        units = [unit for unit in self._units_of(detailed) if unit not in out]
        if units and len(detailed.times) == len(run.times):
            errors = compare(detailed, run, units)
            figures |= {
                "error_rms_deg": errors.worst.rms_deg,
                "error_machine": str(errors.worst.unit),
                "error_coi_deg": max(error.relative_rms_deg for error in errors.units),
                "error_largest_deg": max(error.largest_deg for error in errors.units),
            }
        return figures, {"detailed": detailed, "linear": linear}

    def _judge(self, run: Trajectory) -> tuple[Finding, ...]:
        """What the study's criteria say of a run."""
        ready = self.prepared
        area = None if ready.parts is None else ready.parts.study_buses
        return judge(run, ready.criteria, area) if ready.criteria else ()

    def _clearing_time(self) -> dict[str, Any]:
        wanted = self.prepared.study.clearing_times
        fault = only_fault(self.task.contingency.events)
        if not wanted.wanted or fault is None:
            return {}
        found = self.clearing_time or critical_clearing_time(
            self.prepared.model,
            fault,
            resolution=wanted.resolution,
            longest=wanted.longest,
            t_end=self.prepared.study.run.t_end - fault.start,
            stepper=self.prepared.method.stepper,
            criterion=self.prepared.criterion,
            simulator=self._simulator,
        )
        return {
            "critical_clearing_time": found.seconds,
            "clearing_time_bounded": found.bounded,
            "margin": round(found.seconds - fault.duration, 9),
        }

    def _simulator(
        self,
        model: DetailedModel,
        events: Sequence[Event],
        t_end: float,
        stepper: Stepper | None,
        criterion: SynchronismCriterion | None,
        store: ModelStore | None,
        /,
    ) -> Trajectory:
        """The study's model, with the models that this contingency has built, and its relays."""
        events = (*events, *self.prepared.relays)
        if self.small is None:
            return simulate(model, events, t_end, stepper, criterion, self.store)
        rest = (events, t_end, stepper, criterion, self.store)
        if self.prepared.tolerant is not None:
            return self.prepared.tolerant.run(model, *rest).trajectory
        return simulate_adaptive(model, self.small, self.prepared.rule, *rest).trajectory

    def _units_of(self, run: Trajectory) -> list[UnitKey]:
        return [unit for unit in self.prepared.study_machines if unit in run.model.machines]

    def _parquet(self, run: Trajectory, stable: bool) -> bytes | None:
        wanted = self.prepared.study.outputs
        if wanted.trajectories is Kept.NONE or (wanted.trajectories is Kept.UNSTABLE and stable):
            return None
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "run.parquet"
            run.write_table(TableFile(path, TableFormat.PARQUET, self.columns))
            return path.read_bytes()


def _seconds(run: Trajectory) -> float:
    """Seconds that the machine took for a run, networks included."""
    return run.setup_seconds + run.simulation_seconds


def _cause_figures(causes: ErrorCauses | None) -> dict[str, float]:
    """Columns of where the error came from."""
    found = {} if causes is None else causes.record()
    return {f"error_{name}_deg": value for name, value in found.items()}
