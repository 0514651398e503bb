"""Long runs whose tables are written while they are stepped: what has been written is not kept."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import NamedTuple

from gridfold.dynamics.model import DetailedModel
from gridfold.grid.events import Event
from gridfold.runs.method import Choice, choose_stepper
from gridfold.runs.parts import Taker
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.size import sample_count
from gridfold.runs.summary import Summarizer, Summary
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.table_files import TableFile
from gridfold.runs.trajectory import Trajectory


class StreamedRun(NamedTuple):
    """A run that was written while it was stepped: its summary, and a trajectory with few rows.

    The trajectory holds both ends of each segment alone.
    """

    trajectory: Trajectory
    summary: Summary


def simulate_to_files(
    model: DetailedModel,
    tables: Sequence[TableFile],
    events: Sequence[Event] = (),
    t_end: float = 16.0,
    method: Choice | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
    study_buses: frozenset[int] | None = None,
) -> StreamedRun:
    """Simulate on the detailed model and write tables of it row by row.

    The memory that it takes does not grow with the states of a run. The rows are those of
    :func:`gridfold.simulate`; the Adams method starts anew every few hundred to thousand steps, which
    changes its results within its own error.

    Parameters
    ----------
    model : DetailedModel
        The model of the intact network.
    tables : sequence of TableFile
        What is written; nothing is, if the run cannot be finished.
    events, t_end, criterion, store
        As in :func:`gridfold.simulate`.
    method : Choice, optional
        The stepper and why, from :func:`gridfold.choose_stepper`.
    study_buses : frozenset of int, optional
        Bus numbers of the study area, for the metadata.

    Raises
    ------
    OptionError
        The sampling times alone take too much memory.
    OutputError
        A table does not fit on its disk, or cannot be written.
    EventError, NetworkError
        As :func:`gridfold.simulate`.
    """
    chosen = choose_stepper(model) if method is None else method
    for table in tables:
        table.check_size(sample_count(t_end, chosen.stepper.step))
    summarizer = Summarizer(model)
    with ExitStack() as stack:
        writers = [stack.enter_context(table.open()) for table in tables]
        takers: tuple[Taker, ...] = (summarizer, *writers)
        run = simulate(model, events, t_end, chosen.stepper, criterion, store, takers)
        run = replace(run, method_reason=chosen.reason, study_buses=study_buses)
        for table, writer in zip(tables, writers, strict=True):
            writer.file.metadata = run.metadata(table.columns)
    return StreamedRun(run, summarizer.summary())
