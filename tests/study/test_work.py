"""Handing out and writing down, with workers that die: no row is lost, doubled or wrongly failed."""

from __future__ import annotations

from concurrent.futures import Future
from pathlib import Path
from threading import Event, Lock, Timer

import pytest
from study_stores import failed, new_store, stable

from gridfold import OptionError
from gridfold.io.study_store import StudyStore
from gridfold.study.generate import contingency_from_record
from gridfold.study.solve import Batch, Solved, Task
from gridfold.study.team import Submit, Team
from gridfold.study.work import Stage, Work

Solving = Future[tuple[Solved, ...]]


class Pool:
    """Workers that share their fate: one that dies takes all that is in flight with it."""

    def __init__(
        self,
        deadly: set[int] | None = None,
        fails: set[int] | None = None,
        seconds: float = 0.01,
        shift: float = 0.0,
    ):
        self.seconds, self.shift = seconds, shift
        self.deadly, self.fails = deadly or set(), fails or set()
        self.flying: list[tuple[Solving, Batch]] = []
        self.solved: list[int] = []
        self.lock = Lock()

    def submit(self, batch: Batch) -> Solving:
        future: Solving = Future()
        with self.lock:
            self.flying.append((future, batch))
        Timer(self.seconds, self.land).start()
        return future

    def land(self) -> None:
        with self.lock:
            flying = [item for item in self.flying if item[0].set_running_or_notify_cancel()]
            self.flying = []
        numbers = [task.contingency.number for _, batch in flying for task in batch]
        for future, batch in flying:
            if self.deadly & set(numbers):
                future.set_exception(RuntimeError("the pool is broken"))
            else:
                future.set_result(tuple(self.row(task.contingency.number) for task in batch))

    def row(self, number: int) -> Solved:
        self.solved.append(number)
        separation = 10.0 * number + self.shift
        return Solved(failed(number) if number in self.fails else stable(number, separation))


def work_on(store: StudyStore, submit: Submit, numbers: set[int], together: int = 1) -> Work:
    tasks = [
        Task(contingency_from_record(record), check=False)
        for record in store.contingencies()
        if record["number"] in numbers
    ]
    batches = [tuple(tasks[k : k + together]) for k in range(0, len(tasks), together)]
    return Work(store, Team(2, "two", submit), [("", batches)], lambda progress: None, 0.0)


@pytest.mark.parametrize("together", [1, 3])
@pytest.mark.parametrize("deadly", [{1}, {5}, {1, 2, 3}, {9, 10}])
def test_only_who_loses_its_worker_alone_is_failed(tmp_path: Path, deadly: set[int], together: int):
    pool = Pool(deadly)
    with new_store(tmp_path / "a", 10) as store:
        work = work_on(store, pool.submit, set(range(1, 11)), together)
        assert work.run(Event()) is Stage.DONE
        frame = store.frame()
    assert frame["number"].tolist() == list(range(1, 11))
    assert set(frame["number"][frame["status"] == "failed"]) == deadly
    assert sorted(pool.solved) == sorted(set(range(1, 11)) - deadly), "nothing is solved twice"
    assert work.counts == {"stable": 10 - len(deadly), "unstable": 0, "failed": len(deadly)}
    reasons = frame["reason"][frame["status"] == "failed"]
    assert set(reasons) == {"RuntimeError: the pool is broken"}


def test_workers_that_never_give_a_result_are_an_error_and_no_row(tmp_path: Path):
    with new_store(tmp_path / "a", 3) as store:
        work = work_on(store, Pool({1, 2, 3}).submit, {1, 2, 3})
        with pytest.raises(OptionError, match="before the first result: RuntimeError: the pool"):
            work.run(Event())
        assert store.done() == set()


def test_workers_that_take_no_tasks_are_an_error_and_no_row(tmp_path: Path):
    def submit(batch: Batch) -> Solving:
        raise RuntimeError("cannot schedule new futures after shutdown")

    with new_store(tmp_path / "a", 3) as store:
        with pytest.raises(OptionError, match="take no more tasks: RuntimeError: cannot schedule"):
            work_on(store, submit, {1, 2, 3}).run(Event())
        assert store.done() == set()


def test_what_failed_keeps_its_row_until_there_is_a_new_one(tmp_path: Path):
    with new_store(tmp_path / "a", 4) as store:
        store.add([stable(1, 1.0), failed(2), failed(3), stable(4, 4.0)])
        assert store.failed() == {2, 3}
        stop = Event()
        stop.set()
        work = work_on(store, Pool(seconds=1.0).submit, {2, 3})
        assert work.run(stop) is Stage.INTERRUPTED
        assert store.failed() == {2, 3}
        work = work_on(store, Pool(fails={3}).submit, {2, 3})
        assert work.run(Event()) is Stage.DONE
        assert work.counts == {"stable": 3, "unstable": 0, "failed": 1}
        assert store.failed() == {3}
        assert store.frame()["number"].tolist() == [1, 2, 3, 4]
        assert store.curves(2) is not None


def test_an_interrupt_among_suspects_writes_none_of_them(tmp_path: Path):
    stop, pool = Event(), Pool({1}, seconds=0.2)  # all are in flight when the first one lands

    def submit(batch: Batch) -> Solving:
        seen.append(batch)
        if len(seen) > 4:  # the first suspect
            pool.seconds = 1.0
            stop.set()
        return pool.submit(batch)

    seen: list[Batch] = []
    with new_store(tmp_path / "a", 4) as store:
        assert work_on(store, submit, {1, 2, 3, 4}).run(stop) is Stage.INTERRUPTED
        assert store.done() == set()


def test_a_second_round_takes_the_place_of_rows_but_never_by_a_failure(tmp_path: Path):
    with new_store(tmp_path / "a", 4) as store:
        told = []
        first = work_on(store, Pool().submit, {1, 2, 3, 4})
        assert first.run(Event()) is Stage.DONE
        second = work_on(store, Pool(fails={2}, shift=5.0).submit, {2, 3})
        second.tell = told.append
        assert second.run(Event()) is Stage.DONE
        frame = store.frame().set_index("number")
    assert frame["largest_separation_deg"].to_dict() == {1: 10.0, 2: 20.0, 3: 35.0, 4: 40.0}
    assert second.counts == {"stable": 4, "unstable": 0, "failed": 0}
    assert told[-1].done == told[-1].total == 4


def test_rounds_are_made_when_the_one_before_is_written(tmp_path: Path):
    with new_store(tmp_path / "a", 4) as store:
        tasks = [
            (Task(contingency_from_record(record), check=False),)
            for record in store.contingencies()
        ]

        def rounds():
            yield "", tasks[:3]
            assert store.done() == {1, 2, 3}
            yield "the rest", tasks[3:]

        said = []
        work = Work(store, Team(2, "two", Pool().submit), rounds(), said.append, 0.0)
        assert work.run(Event()) is Stage.DONE
        assert store.done() == {1, 2, 3, 4}
    assert [progress.message for progress in said if progress.message] == ["two", "the rest"]
