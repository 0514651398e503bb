"""Calibration of the thresholds: end of section III.A of Osipov & Sun.

A threshold is lowered in steps until the rotor-angle errors of all contingencies are below a limit. One
contingency is enough to reject a threshold, and the one that rejected the last is tried first.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import takewhile

from gridfold.cards import Card
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.contingency_errors import (
    AngleError,
    Contingency,
    ContingencyRunner,
    LeftOut,
    Progress,
    Reference,
    Trial,
)
from gridfold.equivalents.families import (
    COLUMN_NORM,
    ReducedExternal,
    reduce_external,
    whole_system,
)
from gridfold.equivalents.small_models import SmallModels
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.events import Event
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Coupling, Partition, couple
from gridfold.reduction import Reducer
from gridfold.runs.method import fit_stepper
from gridfold.runs.size import check_states, sample_count
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion

__all__ = [
    "AngleError",
    "Calibration",
    "Contingency",
    "LeftOut",
    "Progress",
    "Threshold",
    "ThresholdKind",
    "calibrate",
]

#: Column norms that are tried, in per unit; at 0 every machine is kept.
COLUMN_NORMS = tuple(round(10 - 0.1 * k, 1) for k in range(101))
#: Angle thresholds that are tried, in degrees.
ANGLES_DEG = tuple(float(angle) for angle in range(180, 0, -1))


#: Fewest samples of a run whose angles are compared.
FEWEST_SAMPLES = 50


class ThresholdKind(Enum):
    """What is calibrated: the column norm, or the angle of one version of the algorithm."""

    COLUMN_NORM = "column norm"
    PARTITIONED = "angle, partitioned"
    WHOLE = "angle, whole system"


@dataclass(frozen=True)
class Threshold:
    """A calibrated threshold.

    Parameters
    ----------
    kind : ThresholdKind
        What it is a threshold of.
    value : float or None
        In per unit or degrees; None if even the lowest that was tried does not satisfy.
    errors : tuple of AngleError
        Of every contingency at the threshold, in their order; empty without a threshold.
    binding : AngleError or None
        What rejected the value before; None if the first was accepted.
    runs : int
        Simulations with small models.
    seconds : float
        Time taken.
    """

    kind: ThresholdKind
    value: float | None
    errors: tuple[AngleError, ...]
    binding: AngleError | None
    runs: int
    seconds: float

    @property
    def worst(self) -> AngleError | None:
        """The largest error at the threshold."""
        return max(self.errors, key=lambda error: error.rms_deg, default=None)


@dataclass(frozen=True, repr=False)
class Calibration(Card):
    """Calibrated thresholds, one for each kind asked for.

    Parameters
    ----------
    thresholds : dict of ThresholdKind to Threshold
        The results.
    column_norm : float
        Column norm (p.u.) with which the angles were calibrated.
    coupling : Coupling
        Column norms of all external machines.
    limit_deg : float
        Limit of the errors in degrees.
    boundary : BoundaryCoupling
        How the areas knew each other's boundary voltages.
    left_out : tuple of LeftOut
        Contingencies that do not count, because they are not stable.
    detailed_runs : int
        Detailed simulations.
    seconds : float
        Time of everything.
    """

    thresholds: dict[ThresholdKind, Threshold]
    column_norm: float
    coupling: Coupling = field(repr=False)
    limit_deg: float
    boundary: BoundaryCoupling
    left_out: tuple[LeftOut, ...]
    detailed_runs: int
    seconds: float

    def _facts(self) -> Mapping[str, object]:
        units = {ThresholdKind.COLUMN_NORM: "p.u."}
        return {"limit": f"to {self.limit_deg:g} degrees RMS"} | {
            kind.value: "none"
            if found.value is None
            else f"{found.value:g} {units.get(kind, 'deg')}"
            for kind, found in self.thresholds.items()
        }

    @property
    def kept(self) -> tuple[UnitKey, ...]:
        """External machines that stay nonlinear with :attr:`column_norm`."""
        return self.coupling.kept(self.column_norm)


def calibrate(
    parts: Partition,
    contingencies: Sequence[Event | Sequence[Event]],
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    reducer: Reducer | None = None,
    limit_deg: float = 6.0,
    what: Collection[ThresholdKind] = tuple(ThresholdKind),
    column_norm: float | None = None,
    criterion: SynchronismCriterion = DEFAULT_CRITERION,
    workers: int | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    coupling: BoundaryCoupling = BoundaryCoupling.EXACT,
) -> Calibration:
    """Find the first thresholds, from above, at which all rotor-angle errors are below a limit.

    The column norm goes down from 10 p.u. by 0.1, hybrid all the time. Where the angle of the whole
    system is wanted too, both versions must satisfy, since they share the kept machines; the paper
    asks this of the partitioned one alone. Angles go down from 180 degrees by 1. :data:`COLUMN_NORMS`
    and :data:`ANGLES_DEG` list the values.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    contingencies : sequence of events, or of sequences of events
        What happens in each; faults at their critical clearing times in the paper.
    t_end, stepper, criterion
        As in :func:`gridfold.simulate`.
    reducer : Reducer, optional
        As in :func:`reduce_external`.
    limit_deg : float
        Limit of the RMS error of any study-area machine's rotor angle in degrees.
    what : collection of ThresholdKind
        Thresholds wanted; all by default.
    column_norm : float, optional
        Column norm (p.u.) for the angles. By default the calibrated one; every machine is kept if
        there is none, and 1 p.u. is taken if it is not wanted.
    workers : int, optional
        Threads; one a core by default. The thresholds do not depend on it.
    on_progress : callable, optional
        Called with a :class:`Progress` now and then, from the calling thread.
    coupling
        As in :func:`reduce_external`; the version without partition has none.

    Raises
    ------
    OptionError
        An option is out of range, no contingency is stable, or no study-area machine has a rotor.
    """
    began = clock.perf_counter()
    if not limit_deg > 0:
        raise OptionError(f"the limit of the errors must be positive, not {limit_deg!r} degrees")
    if workers is not None and workers < 1:
        raise OptionError(f"workers must be 1 or more, not {workers!r}")
    if not set(parts.study_units) & set(parts.model.machines):
        raise OptionError("the study area has no machine with a rotor; nothing can be compared")
    stepper = fit_stepper(parts.model, stepper).stepper
    check_runs(parts, len(contingencies), t_end, stepper)
    norms = couple(parts)
    norm = COLUMN_NORM if column_norm is None else column_norm
    norms.kept(norm)
    family = None
    if set(what) - {ThresholdKind.WHOLE}:
        family = reduce_external(parts, reducer, norm, coupling)
    models = _Models(parts, norms, family)
    threads = workers or os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool:
        runner = ContingencyRunner(parts, t_end, stepper, criterion, pool, threads, on_progress)
        references, left_out = runner.detailed([_as_tuple(item) for item in contingencies])
        found = {}
        for kind in ThresholdKind:
            if kind not in what:
                continue
            found[kind] = _search(
                runner, kind, models.trials(kind, norm, what), references, limit_deg
            )
            if kind is ThresholdKind.COLUMN_NORM and column_norm is None:
                norm = found[kind].value or 0.0
    count = len(references) + len(left_out)
    seconds = clock.perf_counter() - began
    return Calibration(found, norm, norms, limit_deg, coupling, tuple(left_out), count, seconds)


def check_runs(parts: Partition, count: int, t_end: float, stepper: Stepper) -> None:
    """Refuse runs from which thresholds cannot be found.

    Raises
    ------
    OptionError
        They have too few samples to be compared, or so many of them take too much memory.
    """
    samples = sample_count(t_end, stepper.step)
    if samples < FEWEST_SAMPLES:
        raise OptionError(
            f"runs of {t_end:g} s by steps of {stepper.step:g} s have {samples:.0f} samples; comparing "
            f"angles takes {FEWEST_SAMPLES} or more: choose a shorter step"
        )
    check_states(parts.model, t_end, stepper.step, count)


def _as_tuple(contingency: Event | Sequence[Event]) -> Contingency:
    return tuple(contingency) if isinstance(contingency, Sequence) else (contingency,)


class _Models:
    """Small models by version and kept machines, each built once."""

    def __init__(self, parts: Partition, coupling: Coupling, reduced: ReducedExternal | None):
        self.parts, self.coupling, self.reduced = parts, coupling, reduced
        self._stores: dict[tuple[bool, tuple[UnitKey, ...]], SmallModels] = {}

    def trials(
        self, kind: ThresholdKind, norm: float, what: Collection[ThresholdKind]
    ) -> list[Trial]:
        """What is tried for a threshold, from above; `norm` counts for angles alone."""
        if kind is not ThresholdKind.COLUMN_NORM:
            small = self._small(self.reduced if kind is ThresholdKind.PARTITIONED else None, norm)
            return [Trial(angle, (small,), angle) for angle in ANGLES_DEG]
        versions = (self.reduced, None) if ThresholdKind.WHOLE in what else (self.reduced,)
        # The model changes where the list of kept machines does.
        first: dict[tuple[UnitKey, ...], float] = {}
        for value in COLUMN_NORMS:
            first.setdefault(self.coupling.kept(value), value)
        return [
            Trial(value, tuple(self._small(version, value) for version in versions), 0.0)
            for value in first.values()
        ]

    def _small(self, reduced: ReducedExternal | None, norm: float) -> SmallModels:
        """Of the reduced external area with other machines kept, or of the whole system if None."""
        kept = self.coupling.kept(norm)
        key = reduced is None, kept
        if key not in self._stores:
            if reduced is None:
                self._stores[key] = SmallModels(whole_system(self.parts, norm))
            else:
                self._stores[key] = SmallModels(replace(reduced, kept=kept))
        return self._stores[key]


def _search(
    runner: ContingencyRunner,
    kind: ThresholdKind,
    trials: Sequence[Trial],
    references: Sequence[Reference],
    limit_deg: float,
) -> Threshold:
    """The first trial with which all errors are below the limit."""
    began, runs, position = clock.perf_counter(), 0, 0
    order = list(range(len(references)))
    binding: AngleError | None = None
    while position < len(trials):
        runner.report(kind.value, position, len(trials))
        # One contingency with as many thresholds as there are threads, then the others.
        window = trials[position : position + runner.threads]
        tried = runner.errors([(trial, references[order[0]]) for trial in window])
        runs += len(tried)
        rejected = list(takewhile(lambda error: not error.rms_deg < limit_deg, tried))
        if rejected:
            binding, position = rejected[-1], position + len(rejected)
        if len(rejected) == len(window):
            continue
        rest = [(trials[position], references[k]) for k in order[1:]]
        errors = [tried[len(rejected)], *_until_rejected(runner, rest, limit_deg)]
        runs += len(errors) - 1
        failed = [k for k, error in enumerate(errors) if not error.rms_deg < limit_deg]
        if not failed:
            runner.report(kind.value, len(trials), len(trials))
            ranked = tuple(error for _, error in sorted(zip(order, errors, strict=True)))
            seconds = clock.perf_counter() - began
            return Threshold(kind, trials[position].value, ranked, binding, runs, seconds)
        binding, position = errors[failed[0]], position + 1
        order.insert(0, order.pop(failed[0]))
    runner.report(kind.value, len(trials), len(trials))
    return Threshold(kind, None, (), binding, runs, clock.perf_counter() - began)


def _until_rejected(
    runner: ContingencyRunner, jobs: Sequence[tuple[Trial, Reference]], limit_deg: float
) -> list[AngleError]:
    """Errors in order, as many at once as there are threads, until one reaches the limit."""
    errors: list[AngleError] = []
    for start in range(0, len(jobs), runner.threads):
        errors += runner.errors(jobs[start : start + runner.threads])
        if not all(error.rms_deg < limit_deg for error in errors):
            break
    return errors
