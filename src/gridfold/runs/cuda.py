"""Simulate many disturbances of one model on a GPU."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gridfold.dynamics.cuda.kernel import why_not
from gridfold.dynamics.cuda.networks import FULL_TERMINALS, gpu_network
from gridfold.dynamics.cuda.precision import Precision
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.change import Event
from gridfold.numerics.cuda_device import why_no_gpu
from gridfold.numerics.steppers import RungeKutta4, Stepper
from gridfold.runs.cuda_launch import Launch, room_for_launch
from gridfold.runs.members import Member, Outcome, Plans
from gridfold.runs.method import fit_stepper
from gridfold.runs.simulate import ModelStore
from gridfold.runs.size import check_states
from gridfold.runs.synchronism import DEFAULT_CRITERION, SynchronismCriterion


def why_not_on_gpu(model: DetailedModel, stepper: Stepper) -> str | None:
    """Why runs of a model are not made for a GPU; None if they are."""
    if not isinstance(stepper, RungeKutta4):
        return f"the method {stepper.name} is not made for GPUs; rk4 is"
    if model.injections.nonlinear is not None:
        return _loads_that_iterate(model)
    return why_not([block.device for block in model.layout.blocks])


def _loads_that_iterate(model: DetailedModel) -> str:
    loads = model.injections.nonlinear
    assert loads is not None
    few = ", ".join(map(str, loads.buses[:3]))
    more = f" and {len(loads.buses) - 3} more" if len(loads.buses) > 3 else ""
    place = f"bus {few}" if len(loads.buses) == 1 else f"buses {few}{more}"
    return f"loads that are no impedances, at {place}, need iterations of their own in every step"


def simulate_on_gpu(
    model: DetailedModel,
    disturbances: Sequence[Sequence[Event]],
    t_end: float = 16.0,
    stepper: Stepper | None = None,
    criterion: SynchronismCriterion | None = DEFAULT_CRITERION,
    store: ModelStore | None = None,
    every_state: bool = False,
    precision: Precision = Precision.DOUBLE,
    full_terminals: int = FULL_TERMINALS,
) -> Iterator[tuple[int, Outcome]]:
    """Simulate disturbances on a GPU, from the equilibrium at t = 0.

    Parameters and results are those of :func:`gridfold.simulate_batch`, and two more. A disturbance
    that cannot go side by side with others runs on the CPU, in double precision.

    Parameters
    ----------
    precision : Precision
        With how many digits the GPU computes.
    full_terminals : int
        Buses with machines up to which the network is solved by full matrices, else by sparse factors.

    Raises
    ------
    OptionError
        There is no GPU, or runs of this model or with this stepper are not made for one.
    GpuError
        The GPU does not take the runs.
    """
    method = fit_stepper(model, stepper)
    reason = why_no_gpu() or why_not_on_gpu(model, method.stepper)
    if reason is not None:
        raise OptionError(f"runs cannot be made on a GPU: {reason}")
    if every_state:
        check_states(model, t_end, method.stepper.step)
    store = {model.state: model} if store is None else store
    plans = Plans(model, t_end, method, criterion, store)
    network = gpu_network(model, full_terminals)
    launch = Launch(plans, plans.kept_states(every_state), network, precision)
    waiting: list[Member] = []
    size, most = 0, room_for_launch()
    for number, events in enumerate(disturbances):
        found = plans.ready(number, tuple(events))
        if not isinstance(found, Member):
            yield number, found
            continue
        waiting.append(found)
        size += launch.size(found)
        if size > most:
            yield from launch.runs(waiting)
            waiting, size = [], 0
    if waiting:
        yield from launch.runs(waiting)
