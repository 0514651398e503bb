"""What a study says of batches and GPUs that fail: the reason, once, and every row is there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gridfold as gf
from gridfold.io.study_store import StudyStore
from gridfold.report.study_record import study_record
from gridfold.report.study_tables import study_facts
from gridfold.runs.batch import simulate_batch
from gridfold.study import Stage, engine, on_gpu, run_study, solve
from gridfold.study.study_file import Study, parse_study

STUDY = {
    "schema": 1,
    "contingencies": {"bus_faults": "1-6", "clearing_time": 0.05},
    "model": {"kind": "detailed"},
    "run": {"t_end": 0.1, "step": 0.02, "method": "rk4"},
}


@pytest.fixture
def study() -> Study:
    return parse_study(STUDY)


def breaks_after(count: int) -> Any:
    """A batch that ends with an error nobody thought of after some of its runs."""

    def runs(*given: Any, **named: Any) -> Iterator[Any]:
        for number, run in enumerate(simulate_batch(*given, **named)):
            if number == count:
                raise FloatingPointError("no such\n  luck")
            yield run

    return runs


def raising(error: Exception) -> Any:
    def fails(*given: Any, **named: Any) -> Iterator[Any]:
        raise error
        yield

    return fails


def told_by(study: Study, folder: Path, **options: Any) -> list[str]:
    told: list[str] = []
    outcome = run_study(
        study,
        folder,
        count=1,
        on_progress=lambda progress: told.extend(progress.warnings),
        **options,
    )
    assert (outcome.stage, outcome.done, outcome.failed) == (Stage.DONE, 6, 0)
    return told


def test_a_batch_that_breaks_off_is_told_once_and_kept_and_loses_no_row(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told_by(study, tmp_path / "whole")
    monkeypatch.setattr(solve, "simulate_batch", breaks_after(2))
    monkeypatch.setattr(engine, "_together", lambda *given: 4)
    monkeypatch.setattr(solve, "FEWEST_TOGETHER", 2)
    words = "contingencies run one by one, not side by side: FloatingPointError: no such luck"
    assert told_by(study, tmp_path / "broken") == [words]
    with StudyStore.read(tmp_path / "broken") as store:
        assert store.identity["notices"] == [words]
        assert words in "\n".join(map(str, study_facts(store).values()))
        assert words in study_record(store)["warnings"]["others"]
        broken = store.frame()
    with StudyStore.read(tmp_path / "whole") as store:
        assert "notices" not in store.identity
        whole = store.frame()
    for name in ("number", "status", "stable", "largest_separation_deg"):
        assert broken[name].tolist() == pytest.approx(whole[name].tolist(), abs=1e-9), name


@pytest.fixture
def failing_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """A GPU that takes the trial run, and nothing after it."""
    monkeypatch.setattr(on_gpu, "why_no_gpu", lambda: None)
    monkeypatch.setattr(on_gpu, "simulated", lambda: False)
    monkeypatch.setattr(on_gpu, "simulate_on_gpu", lambda *given, **named: iter(()))

    launch = raising(RuntimeError("CUDA_ERROR_LAUNCH_FAILED"))
    monkeypatch.setattr(solve, "simulate_on_gpu", launch)


@pytest.mark.usefixtures("failing_gpu")
def test_a_gpu_that_fails_with_auto_leaves_the_runs_to_the_cpu(
    study: Study, tmp_path: Path
) -> None:
    told = told_by(study, tmp_path / "auto", device="auto")
    words = "contingencies run on the CPU: the GPU failed: RuntimeError: CUDA_ERROR_LAUNCH_FAILED"
    assert told == [words]


@pytest.mark.usefixtures("failing_gpu")
def test_a_gpu_that_is_asked_for_and_fails_is_an_error(study: Study, tmp_path: Path) -> None:
    with pytest.raises(gf.GpuError, match="CUDA_ERROR_LAUNCH_FAILED; auto and cpu run on the CPU"):
        run_study(study, tmp_path / "cuda", count=1, device="cuda")


def test_a_gpu_that_fails_when_it_is_tried_is_an_error_if_it_is_asked_for(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(on_gpu, "why_no_gpu", lambda: None)
    monkeypatch.setattr(on_gpu, "simulated", lambda: False)
    monkeypatch.setattr(on_gpu, "simulate_on_gpu", raising(RuntimeError("no room")))
    with pytest.raises(gf.GpuError, match="device cuda: the GPU failed: RuntimeError: no room"):
        run_study(study, tmp_path / "cuda", count=1, device="cuda")
    told = told_by(study, tmp_path / "auto", device="auto")
    assert told == ["contingencies run on the CPU, not on a GPU: RuntimeError: no room"]


def test_with_loads_that_are_no_impedances_a_study_advances_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mixed = parse_study(STUDY | {"case": {"loads": "0.3,0.3,0.4"}})
    together: list[int] = []

    def counted(model: Any, disturbances: Any, *given: Any, **named: Any) -> Iterator[Any]:
        together.append(len(disturbances))
        return simulate_batch(model, disturbances, *given, **named)

    monkeypatch.setattr(solve, "simulate_batch", counted)
    told_by(mixed, tmp_path / "together")
    assert together == [6]
