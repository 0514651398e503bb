"""What comes of the contingencies that a worker takes together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gridfold.errors import GridfoldError
from gridfold.study import solve as solving
from gridfold.study.engine import _batches
from gridfold.study.named_files import read_named
from gridfold.study.prepare import do_offline_work, prepare
from gridfold.study.solve import Task, solve, solve_batch, why_one_by_one
from gridfold.study.study_file import parse_study
from gridfold.study.summary import WALL

FAULTS = {
    "schema": 1,
    "contingencies": {"bus_faults": "3-11", "clearing_time": 0.1},
    "contingency": [
        {"name": "unstable", "events": [{"kind": "bus-fault", "bus": 26, "duration": 0.5}]},
        {"name": "later", "events": [{"kind": "bus-fault", "bus": 26, "start": 0.333}]},
        {"name": "line", "events": [{"kind": "branch-fault", "branch": "3-2"}]},
    ],
    "criteria": [{"kind": "voltage-dip", "level": 0.8, "longest": 0.1}],
    "model": {"kind": "linear", "order": 20},
    "run": {"t_end": 3.0},
    "check": {"sample": 0},
}


def test_reduced_runs_side_by_side_have_the_rows_that_they_have_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    study = parse_study(FAULTS)
    offline, contingencies = do_offline_work(study, read_named(study, Path()))
    prepared = prepare(offline)
    assert why_one_by_one(prepared) is None
    tasks = tuple(Task(item, check=False) for item in contingencies)
    alone = [solve(prepared, task) for task in tasks]

    def never(*arguments: object) -> None:
        raise GridfoldError("one by one")

    monkeypatch.setattr(solving, "simulate_adaptive", never)
    together = solve_batch(prepared, tasks)
    assert {solved.figures["stable"] for solved in alone} == {True, False}
    for here, there in zip(together, alone, strict=True):
        for name, known in there.figures.items():
            found = here.figures[name]
            if name.startswith(WALL):
                continue
            if isinstance(known, float):
                wide = 1e-6 if name in ("swing_hz", "damping_ratio") else 1e-9
                assert found == pytest.approx(known, rel=wide, abs=1e-9), name
            elif name != "criteria":
                assert found == known, name
        assert here.result.curves is not None
        assert there.result.curves is not None
        assert here.result.curves.keys() == there.result.curves.keys()
        for name, values in there.result.curves.items():
            if np.asarray(values).dtype.kind == "f":
                np.testing.assert_allclose(here.result.curves[name], values, atol=1e-4)


def test_contingencies_of_other_topologies_are_handed_out_together() -> None:
    lines = {"line_faults": "buses 1-12", "clearing_time": 0.1}
    known = {"schema": 1, "contingencies": lines, "model": {"kind": "linear", "order": 20}}
    study = parse_study(known)
    offline, contingencies = do_offline_work(study, read_named(study, Path()))
    prepared = prepare(offline)
    tasks = [Task(item, check=False) for item in contingencies]
    assert len(tasks) > 20
    for workers, most in ((1, 8), (len(tasks), 4)):
        batches = _batches(tasks, prepared, workers)
        assert [task for batch in batches for task in batch] == tasks
        assert all(len(batch) <= most for batch in batches)
        assert len(batches) < 1.5 * len(tasks) / most + 1
