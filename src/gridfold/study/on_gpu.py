"""Whether the contingencies of a study run on a GPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gridfold.dynamics.cuda.precision import Precision
from gridfold.errors import GpuError, OptionError
from gridfold.grid.change import Event
from gridfold.grid.events import EVENTS, Redispatch, SetParameter
from gridfold.numerics.cuda_device import simulated, why_no_gpu
from gridfold.runs.cuda import simulate_on_gpu, why_not_on_gpu
from gridfold.study.generate import Contingency
from gridfold.study.prepare import Prepared
from gridfold.study.single_precision import SingleError, single_error
from gridfold.study.solve import in_words, why_by_itself
from gridfold.study.study_file import RunsOn, Study

#: Events whose contingencies run by themselves: they start or go on with other parameters.
_ALONE = (Redispatch, SetParameter)


@dataclass(frozen=True)
class Chosen:
    """What contingencies run on.

    Parameters
    ----------
    on_gpu : bool
        A GPU, or the CPU.
    words : tuple of str
        What is to be said of that.
    single : SingleError, optional
        What single precision costs, where it is used.
    """

    on_gpu: bool
    words: tuple[str, ...] = ()
    single: SingleError | None = None


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


def with_precision(study: Study, precision: Precision | str | None) -> Study:
    """The study with another precision, if one is given: its rows are others then.

    Raises
    ------
    OptionError
        It is neither double nor single.
    """
    if precision is None:
        return study
    try:
        wanted = Precision(precision)
    except ValueError:
        raise OptionError(f"precision must be double or single, not {precision!r}") from None
    return study.model_copy(update={"run": study.run.model_copy(update={"precision": wanted})})


def refuse_single_elsewhere(device: RunsOn, precision: Precision) -> None:
    """Raise an OptionError if single precision is asked for and no GPU is."""
    if precision is Precision.SINGLE and device is not RunsOn.CUDA:
        raise OptionError(
            f"precision single is for the device cuda, not {device.value}; the CPU computes in double "
            "precision"
        )


def choose_device(
    asked: RunsOn, prepared: Prepared, contingencies: Sequence[Contingency]
) -> Chosen:
    """Whether contingencies run on a GPU, and what is to be said of that.

    A GPU is taken with ``auto`` too, if one is there; a simulated one only if it is asked for.

    Raises
    ------
    GpuError
        A GPU is asked for, and fails when it is tried.
    """
    if asked is RunsOn.CPU:
        return Chosen(False)
    if asked is RunsOn.AUTO and (simulated() or why_no_gpu() is not None):
        return Chosen(False)
    alone = {c.number: _alone(c) for c in contingencies}
    together = [c.events for c in contingencies if not alone[c.number]]
    reason, single = _why_not(prepared), None
    if reason is None:
        reason, single = _tried(prepared, together)
        if reason is not None and asked is RunsOn.CUDA:
            raise GpuError(f"device cuda: the GPU failed: {reason}; auto and cpu run on the CPU")
    if reason is not None:
        return Chosen(False, (f"contingencies run on the CPU, not on a GPU: {reason}",))
    words = [] if single is None else [f"single precision: {single}"]
    if kinds := sorted(set().union(*alone.values())):
        words.append(f"contingencies with {', '.join(kinds)} run on the CPU, the others on a GPU")
    return Chosen(True, tuple(words), single)


def _why_not(prepared: Prepared) -> str | None:
    """Why contingencies of a study are not made for a GPU; None if they are."""
    if prepared.small is not None:
        return "they are simulated on reduced models"
    return why_by_itself(prepared) or why_not_on_gpu(prepared.model, prepared.method.stepper)


def _alone(contingency: Contingency) -> set[str]:
    """Kinds of events for which a contingency runs by itself."""
    found = {type(event) for event in contingency.events if isinstance(event, _ALONE)}
    return {kind for kind, event in EVENTS.items() if event in found}


def _tried(
    prepared: Prepared, together: Sequence[Sequence[Event]]
) -> tuple[str | None, SingleError | None]:
    """What is wrong with a GPU that is tried; and what its single precision costs, if it is used."""
    stepper = prepared.method.stepper
    rest = (stepper.step, stepper, prepared.criterion, dict(prepared.intact))
    precision = prepared.study.run.precision
    try:
        if precision is Precision.SINGLE:
            return None, single_error(prepared, together)
        list(simulate_on_gpu(prepared.model, [()], *rest, precision=precision))
    except Exception as error:  # of the compiler or the driver, of whatever kind
        return in_words(error), None
    return None, None
