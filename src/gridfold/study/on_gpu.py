"""Whether the contingencies of a study run on a GPU."""

from __future__ import annotations

from collections.abc import Sequence

from gridfold.errors import OptionError
from gridfold.grid.events import EVENTS, Redispatch, SetParameter
from gridfold.numerics.cuda_device import simulated, why_no_gpu
from gridfold.runs.cuda import simulate_on_gpu, why_not_on_gpu
from gridfold.study.generate import Contingency
from gridfold.study.prepare import Prepared
from gridfold.study.solve import why_one_by_one
from gridfold.study.study_file import RunsOn

#: Events whose contingencies run by themselves: they start or go on with other parameters.
_ALONE = (Redispatch, SetParameter)


def device_asked_for(device: RunsOn | str) -> RunsOn:
    """What contingencies are to run on.

    Raises
    ------
    OptionError
        It is none of auto, cpu and cuda, or a GPU is asked for and there is none.
    """
    try:
        asked = RunsOn(device)
    except ValueError:
        raise OptionError(f"device must be auto, cpu or cuda, not {device!r}") from None
    if asked is RunsOn.CUDA and (reason := why_no_gpu()) is not None:
        raise OptionError(f"device cuda: {reason}; auto and cpu run on the CPU")
    return asked


def choose_device(
    asked: RunsOn, prepared: Prepared, contingencies: Sequence[Contingency]
) -> tuple[bool, tuple[str, ...]]:
    """Whether contingencies run on a GPU, and what is to be said of that.

    A GPU is taken with ``auto`` too, if one is there; a simulated one only if it is asked for.
    """
    if asked is RunsOn.CPU:
        return False, ()
    if asked is RunsOn.AUTO and (simulated() or why_no_gpu() is not None):
        return False, ()
    stepper = prepared.method.stepper
    reason = None if prepared.small is None else "they are simulated on reduced models"
    reason = reason or why_one_by_one(prepared) or why_not_on_gpu(prepared.model, stepper)
    reason = reason or _trial(prepared)
    if reason is not None:
        return False, (f"contingencies run on the CPU, not on a GPU: {reason}",)
    alone = sorted(
        kind
        for kind, event in EVENTS.items()
        if event in _ALONE and any(isinstance(e, event) for c in contingencies for e in c.events)
    )
    if alone:
        return True, (f"contingencies with {', '.join(alone)} run on the CPU, the others on a GPU",)
    return True, ()


def _trial(prepared: Prepared) -> str | None:
    """What is wrong with a GPU that is tried with one step of an undisturbed run."""
    stepper = prepared.method.stepper
    rest = (stepper.step, stepper, prepared.criterion, dict(prepared.intact))
    try:
        list(simulate_on_gpu(prepared.model, [()], *rest))
    except Exception as error:  # of the compiler or the driver, of whatever kind
        return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return None
