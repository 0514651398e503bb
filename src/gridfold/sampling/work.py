"""Samples from what is drawn to rows: operating point, model, run, labels; in whatever process."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import GridfoldError
from gridfold.grid.case import Case, Control
from gridfold.numerics.blas import one_blas_thread
from gridfold.powerflow import PowerFlowResult, solve_power_flow
from gridfold.powerflow.network import FlowNetwork
from gridfold.sampling.draw import Draw, Happenings, draw
from gridfold.sampling.plan import SamplePlan
from gridfold.sampling.points import OperatingPoints
from gridfold.sampling.rows import INFEASIBLE, labels
from gridfold.study.prepare import Offline, Prepared, prepare
from gridfold.study.solve import Solved, Task, solve_batch

#: Name of the first column of curves.
_NUMBER = "number"
#: Samples whose models are at hand at once: more would take memory, fewer leave columns empty.
_TOGETHER = 100


@dataclass(frozen=True)
class SampleWork:
    """All that makes samples of a plan, as plain data that can be sent to other processes."""

    plan: SamplePlan
    offline: Offline
    happenings: Happenings

    @property
    def time_limit(self) -> float | None:
        """Longest time for one sample in seconds."""
        return self.offline.time_limit


@dataclass(frozen=True)
class Chunk:
    """Samples of one file: its position, the first number, and what they are drawn from.

    `rows` has a row for each sample, shape (n_samples, dimensions).
    """

    position: int
    first: int
    rows: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True)
class Made:
    """A chunk that is done: a row of columns for each sample, and curves as a Parquet file."""

    position: int
    rows: tuple[dict[str, Any], ...]
    curves: bytes | None


@dataclass(frozen=True)
class Sampler:
    """What makes samples; shared by the threads of one process."""

    work: SampleWork
    prepared: Prepared
    network: FlowNetwork
    points: OperatingPoints

    @cached_property
    def slack(self) -> NDArray[np.int64]:
        """Positions of the units in service that balance the power."""
        units = enumerate(self.points.case.generators)
        return np.array(
            [k for k, u in units if u.in_service and u.control is Control.SLACK], dtype=np.int64
        )

    def draw(self, number: int, row: NDArray[np.float64]) -> Draw:
        """What is drawn for a sample."""
        return draw(self.work.plan, self.work.happenings, number, row)

    def case(self, drawn: Draw) -> Case:
        """The case of a sample; raises an EventError where it cannot be."""
        return self.points.case_at(drawn.values)

    def models(self, draws: Sequence[Draw]) -> list[DetailedModel | GridfoldError]:
        """The model of each sample at its equilibrium, or why there is none."""
        flows = [self._power_flow(drawn) for drawn in draws]
        base = self.prepared.model
        made = iter(base.at_each([flow for flow in flows if not isinstance(flow, GridfoldError)]))
        models = [flow if isinstance(flow, GridfoldError) else next(made) for flow in flows]
        for model in models:
            # The time step is chosen once, for the case and the ends of all parameters.
            if isinstance(model, DetailedModel):
                vars(model)["fast_modes"] = base.fast_modes
        return models

    def _power_flow(self, drawn: Draw) -> PowerFlowResult | GridfoldError:
        try:
            return solve_power_flow(self.case(drawn), network=self.network)
        except GridfoldError as error:
            return error

    def rows(self, draws: Sequence[Draw]) -> list[tuple[dict[str, Any], bytes | None]]:
        """The columns of some samples, whose runs advance together, and their curves if they are kept.

        Curves are a Parquet file.
        """
        models = self.models(draws)
        live = [
            (Task(drawn.contingency, check=False), model)
            for drawn, model in zip(draws, models, strict=True)
            if isinstance(model, DetailedModel)
        ]
        tasks = tuple(task for task, _ in live)
        solved = iter(solve_batch(self.prepared, tasks, [model for _, model in live]))
        return [
            self._row(drawn, model, None if isinstance(model, GridfoldError) else next(solved))
            for drawn, model in zip(draws, models, strict=True)
        ]

    def _row(
        self, drawn: Draw, model: DetailedModel | GridfoldError, solved: Solved | None
    ) -> tuple[dict[str, Any], bytes | None]:
        row: dict[str, Any] = {
            "number": drawn.number,
            "contingency": drawn.contingency.name,
            "kind": drawn.contingency.kind,
            "clearing_time": drawn.clearing_time,
            **drawn.values,
        }
        if isinstance(model, GridfoldError) or solved is None:
            reason = " ".join(str(model).split())
            return {**row, "status": INFEASIBLE, "reason": reason}, None
        row |= self._start(model.power_flow) | labels(solved.figures)
        return row, solved.parquet

    def _start(self, flow: PowerFlowResult) -> dict[str, float]:
        """Figures of an operating point."""
        base, size = flow.case.base_mva, np.abs(flow.voltage)
        return {
            "load_mw": float(flow.load_power.sum().real) * base,
            "generation_mw": float(flow.unit_power.sum().real) * base,
            "slack_mw": float(flow.unit_power[self.slack].sum().real) * base,
            "start_lowest_voltage": float(size.min()),
            "start_highest_voltage": float(size.max()),
        }


def make_sampler(work: SampleWork) -> Sampler:
    """What makes the samples; the same `work` gives the same in every process."""
    prepared = prepare(work.offline)
    case = prepared.model.case
    points = OperatingPoints.of(work.plan, case, work.offline.devices)
    sampler = Sampler(work, prepared, FlowNetwork.of(case), points)
    _ = prepared.model.fast_modes  # found once, before threads look for them
    return sampler


@one_blas_thread
def make_chunk(sampler: Sampler, chunk: Chunk) -> Made:
    """Make the samples of a chunk."""
    draws = [sampler.draw(chunk.first + k, numbers) for k, numbers in enumerate(chunk.rows)]
    rows, curves = [], []
    for first in range(0, len(draws), _TOGETHER):
        few = draws[first : first + _TOGETHER]
        for drawn, (row, parquet) in zip(few, sampler.rows(few), strict=True):
            rows.append(row)
            if parquet is not None:
                curves.append(_curves(drawn.number, parquet))
    return Made(chunk.position, tuple(rows), _joined(curves) if curves else None)


def _curves(number: int, parquet: bytes) -> pa.Table:
    """Curves of a sample in single precision, with its number."""
    table = pq.read_table(io.BytesIO(parquet))
    table = table.cast(pa.schema([(name, pa.float32()) for name in table.column_names]))
    numbers = pa.array(np.full(len(table), number, dtype=np.int64))
    return table.add_column(0, _NUMBER, numbers).replace_schema_metadata(None)


def _joined(curves: list[pa.Table]) -> bytes:
    stream = io.BytesIO()
    pq.write_table(pa.concat_tables(curves), stream, compression="zstd")
    return stream.getvalue()


def counted(rows: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """How many samples are stable, unstable, infeasible and failed."""
    counts = {"stable": 0, "unstable": 0, INFEASIBLE: 0, "failed": 0}
    for row in rows:
        stable = row.get("stable")
        if row["status"] in (INFEASIBLE, "failed"):
            counts[row["status"]] += 1
        else:
            counts["stable" if stable else "unstable"] += 1
    return counts
