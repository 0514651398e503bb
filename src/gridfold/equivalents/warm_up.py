"""Compile beforehand what simulations need; the code is kept on disk for each version."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.device import batch_kernel, compiled_kernel
from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.network import LoadModel, NetworkBackend
from gridfold.dynamics.registry import DEVICES
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.choice import ModelSettings
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import STUDY_AREAS, ModelKind
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.tolerant import TolerantModel
from gridfold.grid.criteria import AngleSeparation
from gridfold.grid.events import BusFault
from gridfold.io.case_folder import read_case
from gridfold.numerics.kernel_cache import kept_code
from gridfold.numerics.steppers import AdamsBashforthMoulton4, ImplicitTrapezoidal, RungeKutta4
from gridfold.partition import partition, study_buses
from gridfold.runs.batch import simulate_batch
from gridfold.runs.simulate import simulate
from gridfold.runs.small_signal import small_signal

_CASE, _T_END = "npcc", 0.2
_FAULT = BusFault(3, start=0.0, duration=0.02)
_REDUCED = (
    ModelSettings(ModelKind.ADAPTIVE),
    ModelSettings(ModelKind.ADAPTIVE, tolerance_deg=1.0),
    ModelSettings(ModelKind.WHOLE),
    ModelSettings(ModelKind.PAPER),
    ModelSettings(ModelKind.PAPER, coupling=BoundaryCoupling.LAGGED),
    ModelSettings(ModelKind.PAPER_WHOLE),
)


@dataclass(frozen=True)
class WarmUp:
    """What was made ready.

    Parameters
    ----------
    folder : str
        Where the compiled code is kept.
    functions : int
        Compiled functions there.
    temporary : bool
        Whether the folder is gone when this process ends, because nothing else can be written.
    seconds : float
        Time it took.
    """

    folder: str
    functions: int
    temporary: bool
    seconds: float


def warm_up(on_step: Callable[[int, int], None] | None = None) -> WarmUp:
    """Compile what every device, solver and kind of model needs, and keep it on disk.

    Parameters
    ----------
    on_step : callable, optional
        Called with the number of steps that are done and that of all.

    Returns
    -------
    WarmUp
        Where the code is kept.
    """
    began = time.perf_counter()
    steps = list(_steps())
    for done, step in enumerate(steps, start=1):
        step()
        if on_step is not None:
            on_step(done, len(steps))
    kept = kept_code()
    seconds = time.perf_counter() - began
    return WarmUp(str(kept.folder), kept.functions, kept.temporary, seconds)


def _steps() -> Iterator[Callable[[], object]]:
    for device in DEVICES.values():
        for kernel in (device.source, device.output, device.derivative):
            if kernel is not None:
                yield lambda kernel=kernel: compiled_kernel(kernel)  # type: ignore[misc]
                yield lambda kernel=kernel: batch_kernel(kernel)  # type: ignore[misc]
                yield lambda kernel=kernel: compiled_kernel(kernel, True)  # type: ignore[misc]
    yield _run_detailed
    for settings in _REDUCED:
        yield lambda settings=settings: _run_reduced(settings)  # type: ignore[misc]


def _run_detailed() -> None:
    case = read_case(_CASE)
    for backend in (NetworkBackend.DENSE, NetworkBackend.SPARSE):
        for loads in ("z", "0.4,0.3,0.3"):
            model = build_model(case, backend=backend, loads=LoadModel.parse(loads))
            for stepper in (RungeKutta4(), AdamsBashforthMoulton4(), ImplicitTrapezoidal()):
                simulate(model, [_FAULT], _T_END, stepper)
    small_signal(build_model(case))
    _solve_sparse(build_model(case))
    list(simulate_batch(build_model(case), [[_FAULT]], _T_END, RungeKutta4()))


def _solve_sparse(model: DetailedModel) -> None:
    resolvent, rhs = grid_descriptor(model, model.x0).at(1j), np.zeros((model.n_states, 1))
    resolvent.solve(rhs)
    resolvent.solve_adjoint(rhs)


def _run_reduced(settings: ModelSettings) -> None:
    model = build_model(read_case(_CASE))
    parts = partition(model, study_buses(model.case, areas=STUDY_AREAS[_CASE]))
    family = settings.build(parts)
    if settings.tolerance_deg is not None and isinstance(family, Ladder):
        tolerant = TolerantModel(family, settings.tolerance_deg)
        run = tolerant.run(model, [_FAULT], _T_END, criteria=[AngleSeparation(360.0)])
        _ = run.error_causes
        return
    small = SmallModels(family)
    for stepper in (RungeKutta4(), AdamsBashforthMoulton4()):
        simulate_adaptive(model, small, settings.rule, [_FAULT], _T_END, stepper)
