"""How much a run takes: samples times states, and a model for each network state."""

from __future__ import annotations

from gridfold.ceilings import require_memory
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError

#: Bytes of a sampling time while a run is stepped, and of a state that is kept (once more when read).
_TIME, _STATE = 32, 16
#: Bytes of a model of a network state beside its arrays.
_MODEL = 20_000

#: Advice for runs that keep all of their states.
_SHORTER = (
    "A longer step or an earlier end takes less. A detailed run that writes tables alone is written "
    "piece by piece (--model detailed --csv FILE --monitor ...)."
)


def sample_count(t_end: float, step: float) -> float:
    """Number of samples of a run, infinite where it is beyond counting.

    Raises
    ------
    OptionError
        The end time is not a positive number of seconds.
    """
    if not 0 < t_end < float("inf"):
        raise OptionError(f"the end time must be a positive number of seconds, not {t_end!r}")
    return t_end / step + 1


def check_times(t_end: float, step: float) -> None:
    """Refuse a run whose sampling times alone are too many.

    Raises
    ------
    OptionError
        It takes too much memory, or its end is not a positive number of seconds.
    """
    samples = sample_count(t_end, step)
    what = f"a run of {_length(t_end, step)}"
    require_memory(what, samples * _TIME, "Choose a longer step or an earlier end.")


def check_states(model: DetailedModel, t_end: float, step: float, at_once: int = 1) -> None:
    """Refuse runs, so many at once, whose states are too many to be kept.

    Raises
    ------
    OptionError
        They take too much memory, or their end is not a positive number of seconds.
    """
    samples = sample_count(t_end, step)
    runs = "a run" if at_once == 1 else f"{at_once:,} runs at once"
    what = f"{runs} of {_length(t_end, step)} of {model.n_states:,} states"
    advice = (
        _SHORTER if at_once == 1 else "Fewer workers, a longer step or an earlier end take less."
    )
    require_memory(what, at_once * samples * (_TIME + _STATE * model.n_states), advice)


def check_models(model: DetailedModel, count: int) -> None:
    """Refuse events that lead through too many network states, each of which has a model.

    Raises
    ------
    OptionError
        The models take too much memory.
    """
    what = f"{count:,} different network states, each with a model,"
    require_memory(what, count * _model_size(model), "Give fewer events.")


def _length(t_end: float, step: float) -> str:
    samples = sample_count(t_end, step)
    count = f"{samples:,.0f}" if samples < 1e18 else f"{samples:.3g}"
    return f"{count} samples ({t_end:g} s by steps of {step:g} s)"


def _model_size(model: DetailedModel) -> int:
    """Bytes of a model of one network state beside what all of them share."""
    compiled, equations = model.compiled, model.equations
    network: int = equations.matrix.data.nbytes + equations.matrix.indices.nbytes
    return _MODEL + compiled.integers.nbytes + compiled.reals.nbytes + 4 * network
