"""Where the error of a run with a reduced external area comes from: one cause at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gridfold.cards import Card
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.compare import UnitError, compare
from gridfold.equivalents.families import ModelFamily, ReducedExternal, reduce_external
from gridfold.equivalents.folded import fold
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.events import Event
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.steppers import ScipyReference, Stepper
from gridfold.reduction import Unreduced
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

_HYBRID = SwitchingRule(0.0)


@dataclass(frozen=True)
class BudgetRow:
    """The error that one cause makes alone.

    Parameters
    ----------
    source : str
        The cause.
    changed : str
        What was compared with what.
    error : UnitError or None
        Of the worst study-area machine; None if one of the runs did not reach the end.
    status : Status
        How the run with this cause ended.
    """

    source: str
    changed: str
    error: UnitError | None
    status: Status

    @property
    def told(self) -> str:
        """The error in words, or why there is none."""
        return self.status.value if self.error is None else f"{self.error.rms_deg:.3g} degrees RMS"


@dataclass(frozen=True, repr=False)
class ErrorBudget(Card):
    """Errors by cause; they need not add up."""

    rows: tuple[BudgetRow, ...]

    def _facts(self) -> Mapping[str, object]:
        return {"causes": f"of {len(self.rows)} causes"} | {
            row.source: row.told for row in self.rows
        }


@one_blas_thread
def error_budget(
    family: Ladder | ReducedExternal,
    rule: SwitchingRule,
    events: Sequence[Event] = (),
    t_end: float = 16.0,
    stepper: Stepper | None = None,
) -> ErrorBudget:
    """Change one thing at a time between the detailed model and a reduced one.

    Parameters
    ----------
    family : Ladder or ReducedExternal
        The reduced external area.
    rule : SwitchingRule
        Thresholds; 0 degrees gives the most exact model and infinity the next one all the time.
    events, t_end, stepper
        As in :func:`gridfold.simulate`.

    Returns
    -------
    ErrorBudget
        Rows for the time step (against SciPy's integrator at a tolerance of 1e-10), with the paper's
        models the lagged coupling (no function linear), linearization (no state truncated, exact
        coupling), truncation (against the same without it), and the model as it is.
    """
    parts, model = family.parts, family.parts.model
    if not set(parts.study_units) & set(model.machines):
        raise OptionError("the study area has no machine with a rotor; it has no angles to err in")
    stepper = fit_stepper(model, stepper).stepper
    store: ModelStore = {}
    detailed = simulate(model, events, t_end, stepper, store=store)
    fine = simulate(model, events, t_end, ScipyReference(stepper.step), store=store)

    def run(chosen: ModelFamily, by: SwitchingRule) -> Trajectory:
        return simulate_adaptive(model, chosen, by, events, t_end, stepper, store=store).trajectory

    exact, untruncated = _without_lag(family), _untruncated(family)
    linear = run(untruncated, rule)
    rows = [("time step", "detailed against SciPy's DOP853", fine, detailed)]
    if isinstance(untruncated, ReducedExternal):
        every = replace(untruncated, kept=parts.external_units, boundary=BoundaryCoupling.LAGGED)
        lagged = run(every, _HYBRID)
        rows += [("coupling", "lagged, nothing linear, against detailed", detailed, lagged)]
    rows += [
        ("linearization", "no truncation, against detailed", detailed, linear),
        ("truncation", "against the same without truncation", linear, run(exact, rule)),
        ("all", "the model as chosen against detailed", detailed, run(family, rule)),
    ]
    units = [unit for unit in parts.study_units if unit not in detailed.models[-1].state.units_out]
    found = []
    for source, changed, before, after in rows:
        complete = before.status is after.status is Status.COMPLETED
        error = compare(before, after, units).worst if complete else None
        found.append(BudgetRow(source, changed, error, after.status))
    return ErrorBudget(tuple(found))


def _without_lag(family: Ladder | ReducedExternal) -> Ladder | ReducedExternal:
    if isinstance(family, Ladder):
        return family
    return replace(family, boundary=BoundaryCoupling.EXACT)


def _untruncated(family: Ladder | ReducedExternal) -> Ladder | ReducedExternal:
    """The same models with all states of the external area."""
    if isinstance(family, Ladder):
        areas = tuple(fold(area.parts, area.retained, Unreduced()) for area in family.areas)
        return replace(family, areas=areas)
    return replace(reduce_external(family.parts, Unreduced()), kept=family.kept)
