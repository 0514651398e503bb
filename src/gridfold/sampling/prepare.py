"""What is done once before samples are made: the study behind them, their time step, their chunks."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from gridfold.errors import GridfoldError, OptionError
from gridfold.io.sample_store import SampleStore
from gridfold.numerics.steppers import ImplicitTrapezoidal
from gridfold.powerflow import solve_power_flow
from gridfold.runs.method import Choice, choose_stepper
from gridfold.sampling.distribution import value_of
from gridfold.sampling.draw import Happenings, filling
from gridfold.sampling.plan import FREE_KEYS, Filling, SamplePlan
from gridfold.sampling.work import Chunk, Sampler, SampleWork, make_sampler
from gridfold.study.generate import from_table
from gridfold.study.identity import (
    changed_keys,
    refuse_other_case,
    refuse_other_files,
)
from gridfold.study.identity import (
    identity_of as study_identity,
)
from gridfold.study.named_files import read_named
from gridfold.study.prepare import do_offline_work
from gridfold.study.trust import code_record, require_trust

#: Parts of the distributions of parameters at which the time step has to do.
_ENDS = (1e-3, 1 - 1e-3)


def prepared_work(
    plan: SamplePlan,
    folder: Path,
    earlier: SampleStore | None = None,
    trust_devices: bool | Collection[str] = False,
) -> Sampler:
    """What makes the samples of a plan; names of files start at `folder`.

    With `earlier` that is what makes the rest of that data set.

    Raises
    ------
    GridfoldError
        Something in the plan does not fit the case.
    """
    study = plan.study()
    named = read_named(study, folder)
    require_trust(named.own_code, trust_devices)
    if earlier is not None:
        refuse_other_files(earlier, named.hashes)
    settings = None if earlier is None else earlier.identity["settings"]
    offline, contingencies = do_offline_work(study, named, earlier=settings)
    offline = replace(offline, time_limit=plan.run.time_limit)
    csv = plan.faults.csv
    own = len(plan.contingency) + (0 if csv is None else len(list(from_table(folder / csv))))
    work = SampleWork(plan, offline, Happenings(contingencies, len(contingencies) - own))
    sampler = make_sampler(work)
    if earlier is not None:
        refuse_other_case(earlier, identity_of(sampler))
        return sampler
    method = _method_of_all(sampler)
    if method is offline.method:
        return sampler
    return make_sampler(replace(work, offline=replace(offline, method=method)))


def chunks(plan: SamplePlan) -> list[Chunk]:
    """All chunks of a plan."""
    rows = filling(plan)
    starts = range(0, plan.samples, plan.chunk)
    return [Chunk(k, at + 1, rows[at : at + plan.chunk]) for k, at in enumerate(starts)]


def identity_of(sampler: Sampler) -> dict[str, Any]:
    """What must be the same for a data set to be resumed, and what it is about."""
    offline = sampler.work.offline
    return study_identity(offline) | {
        "plan": sampler.work.plan.content(),
        "own_code": [code_record(code) for code in offline.named.own_code],
    }


def refuse_other_plan(store: SampleStore, plan: SamplePlan) -> None:
    """Say which key differs, where the plan is another one than that of the data."""
    before, now = store.identity["plan"], plan.content()
    grows = plan.filling is Filling.SOBOL and plan.samples >= before["samples"]
    free = FREE_KEYS | {"samples"} if grows else FREE_KEYS
    for key, was, wants in changed_keys(before, now, free):
        more = "; only with sobol it may grow" if key == "samples" else ""
        raise OptionError(
            f"{store.folder}: the samples belong to another plan: {key} was {was!r} and is "
            f"{wants!r}{more}; take another folder with --out"
        )


def _method_of_all(sampler: Sampler) -> Choice:
    """The integration rule and step that do at both ends of all parameters too."""
    method = sampler.work.offline.method
    if not sampler.points.parameters or isinstance(method.stepper, ImplicitTrapezoidal):
        return method
    run = sampler.work.plan.run
    for values in _ends(sampler.work.plan):
        try:
            flow = solve_power_flow(sampler.points.case_at(values), network=sampler.network)
            model = sampler.prepared.model.at(flow)
        except GridfoldError:  # no operating point there, which is for the samples to tell
            continue
        found = choose_stepper(model, run.method, method.stepper.step)
        if isinstance(found.stepper, ImplicitTrapezoidal):
            return found
    return method


def _ends(plan: SamplePlan) -> Iterator[dict[str, float]]:
    """All parameters at one end of their distributions, with powers as they are in the case."""
    for part in _ENDS:
        values = {}
        for name, table, _, item in plan.named:
            unchanged = 0.0 if item.factor is None else 1.0
            values[name] = value_of(item.amount, part) if table == "parameter" else unchanged
        yield values
