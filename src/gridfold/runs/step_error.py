"""How wrong the time step makes a run, and the longest step that is right enough.

A run is repeated with half the step. Of a rule of order p the coarser one errs by 2^p / (2^p - 1) of
the difference (Richardson; Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, 2nd
ed., section II.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.events import Event
from gridfold.numerics.steppers import ImplicitTrapezoidal, Stepper
from gridfold.runs.longer_step import LARGEST_ERROR_DEG, difference_deg, shortest_fault
from gridfold.runs.method import Choice, Method, choose_stepper, fault_doubt
from gridfold.runs.simulate import ModelStore, simulate
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion
from gridfold.runs.trajectory import Trajectory

#: Steps that are tried, in s, the longest first.
STEPS = (0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125)
#: Orders of the rules whose step is halved: of the implicit one, and of the others.
_IMPLICIT_ORDER, _ORDER = 2, 4


def step_error_deg(run: Trajectory, finer: Trajectory) -> float:
    """Error of the worst rotor angle of `run` that its step makes, by one with half the step.

    Root mean square against the centre of inertia while both go on, in degrees; infinite where one ends
    otherwise than the other.
    """
    if run.status is not finer.status:
        return inf
    order = _IMPLICIT_ORDER if isinstance(run.stepper, ImplicitTrapezoidal) else _ORDER
    factor: int = 2**order
    return difference_deg(finer, run) * factor / (factor - 1)


def choose_step(
    model: DetailedModel,
    events: Sequence[Event],
    method: Method | str = Method.AUTO,
    *,
    allowed_deg: float = LARGEST_ERROR_DEG,
    t_end: float = 16.0,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
) -> Choice:
    """The longest step of :data:`STEPS` whose error is at most `allowed_deg` in this run.

    Steps that are unstable, too coarse for the fastest swing, or longer than a fault are not tried.

    Parameters
    ----------
    model : DetailedModel
        The model that the run starts from.
    events : sequence of Event
        What happens.
    method : Method, or its name
        The integration rule; AUTO chooses one for each step.
    allowed_deg : float
        Root mean square error of the worst rotor angle against the centre of inertia, in degrees.
    t_end, criterion
        Of the run.

    Raises
    ------
    OptionError
        No step is fine enough.
    """
    store: ModelStore = {}
    known: dict[Stepper, Trajectory] = {}
    fault, smallest = shortest_fault([events]), inf

    def run(stepper: Stepper) -> Trajectory:
        if stepper not in known:
            known[stepper] = simulate(model, events, t_end, stepper, criterion, store)
        return known[stepper]

    for step in STEPS:
        try:
            choice = choose_stepper(model, method, step)
        except OptionError:  # unstable
            continue
        stepper = choice.stepper
        if choice.doubts or fault_doubt(stepper, fault) is not None:
            continue
        error = step_error_deg(
            run(stepper), run(choose_stepper(model, stepper.name, step / 2).stepper)
        )
        if error <= allowed_deg:
            text = f"{stepper.name} at {step:g} s: {error:.2g} degree from half the step"
            return Choice(stepper, text)
        smallest = min(smallest, error)
    raise OptionError(
        f"no step of {STEPS[-1]:g} s or more is right within {allowed_deg:g} degrees: the smallest "
        f"error was {smallest:.2g}; give a step, or allow more"
    )
