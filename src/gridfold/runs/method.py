"""Which integration rule suits a model: the explicit ones need a step that its fastest mode allows.

An explicit rule multiplies the mode lambda by its growth(h lambda) in every step h. Where that is more
than the mode itself does, the run is lost within a few steps, whatever happens to the system. Hairer &
Wanner, Solving Ordinary Differential Equations II, 2nd ed., section IV.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from gridfold.dynamics.fast_modes import Mode
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError, StepWarning, warn_caller
from gridfold.numerics.steppers import (
    AdamsBashforthMoulton4,
    ImplicitTrapezoidal,
    RungeKutta4,
    Stepper,
)

#: Steps of a run in seconds: others make no sense of rotors that swing with periods of 0.2 to 10 s.
SHORTEST_STEP, LONGEST_STEP = 1e-6, 1.0
#: Steps that the fastest swing of a rotor takes at least, if its angle is to be right.
STEPS_A_SWING = 10
#: |h lambda| up to which a mode is resolved by the step, whatever it does.
_RESOLVED = 0.5
#: Growth beyond that of the mode itself that is put down to rounding.
_ROUNDING = 1e-6


class Method(Enum):
    """Integration rules by name; AUTO chooses one."""

    AUTO = "auto"
    RK4 = "rk4"
    ABM4 = "abm4"
    TRAPEZOIDAL = "trapezoidal"


@dataclass(frozen=True)
class Choice:
    """A stepper, why it was chosen, in one sentence, and what speaks against it.

    `reason` is None for a stepper that was given.
    """

    stepper: Stepper
    reason: str | None
    doubts: tuple[str, ...] = ()

    def record(self) -> dict[str, object]:
        """All of it, ready for JSON."""
        return {
            "method": self.stepper.name,
            "method_reason": self.reason,
            "method_doubts": list(self.doubts),
        }


def choose_stepper(
    model: DetailedModel, method: Method | str = Method.AUTO, step: float | None = None
) -> Choice:
    """The stepper of a method; AUTO is Runge-Kutta if it is stable at the step, else trapezoidal.

    Parameters
    ----------
    model : DetailedModel
        The model at its equilibrium, whose fastest modes decide. They are looked for once.
    method : Method, or its name
        The integration rule.
    step : float, optional
        Time step in seconds, from 1e-6 to 1; by default that of the method, with AUTO that of
        Runge-Kutta.

    Raises
    ------
    OptionError
        The step is out of range, or an explicit method that was asked for by name is unstable at it:
        names the mode, its device, and the largest step that would do.
    """
    try:
        asked = Method(method)
    except ValueError:
        raise OptionError(f"there is no method {method!r}") from None
    if asked is Method.TRAPEZOIDAL:
        why = "trapezoidal: as asked for; stable at every step"
        return _with_doubts(model, _implicit(step), why)
    kind = AdamsBashforthMoulton4 if asked is Method.ABM4 else RungeKutta4
    stepper = kind() if step is None else kind(step)
    check_run_step(stepper)
    blame = _unstable(model, stepper)
    if blame is None:
        return _with_doubts(model, stepper, f"{stepper.name}: {_praise(model, stepper)}")
    if asked is Method.AUTO:
        return _with_doubts(model, _implicit(stepper.step), f"trapezoidal: {blame}")
    raise OptionError(f"{blame}; the implicit method trapezoidal does with any step")


def fit_stepper(model: DetailedModel, stepper: Stepper | None) -> Choice:
    """The stepper of a run: that of :func:`choose_stepper` if none is given.

    Warns with :class:`StepWarning` of one that is unstable or too coarse for the model.

    Raises
    ------
    OptionError
        It is no stepper, or its step is out of range.
    """
    if stepper is None:
        return choose_stepper(model)
    if not hasattr(stepper, "integrate"):
        raise OptionError(
            f"the stepper must be one such as RungeKutta4(step=0.01), not {stepper!r}"
        )
    check_run_step(stepper)
    blame = _unstable(model, stepper)
    if blame is not None:
        blame += "; without a stepper one that suits is chosen"
    found = _with_doubts(model, stepper, None, () if blame is None else (blame,))
    for doubt in found.doubts:
        warn_caller(doubt, StepWarning)
    return found


def check_run_step(stepper: Stepper) -> None:
    """Raise :class:`OptionError` where a step is no step of a run."""
    if not SHORTEST_STEP <= stepper.step <= LONGEST_STEP:
        raise OptionError(
            f"the time step must lie between {SHORTEST_STEP:g} and {LONGEST_STEP:g} s, not "
            f"{stepper.step:g} s: the default is {RungeKutta4().step:g} s"
        )


def fault_doubt(stepper: Stepper, shortest: float) -> str | None:
    """What is to be said where a step is longer than the shortest fault of a run, in s."""
    if not stepper.fixed_step or stepper.step <= shortest * (1 + 1e-9):
        return None
    return (
        f"the time step of {stepper.step:g} s is longer than the shortest fault of {shortest:g} s: "
        "what happens in it is followed in one step"
    )


def _implicit(step: float | None) -> ImplicitTrapezoidal:
    return ImplicitTrapezoidal() if step is None else ImplicitTrapezoidal(step)


def _with_doubts(
    model: DetailedModel, stepper: Stepper, reason: str | None, doubts: tuple[str, ...] = ()
) -> Choice:
    """The choice, with a doubt where a swing is given too few steps."""
    check_run_step(stepper)
    period = model.fast_modes.swing_period
    if stepper.fixed_step and stepper.step > period / STEPS_A_SWING:
        doubts += (
            f"{stepper.name} at {stepper.step:g} s is coarse: the fastest swing of a rotor has a "
            f"period of {_three_digits(period)} s, take at most "
            f"{_rounded_down(period / STEPS_A_SWING):g} s",
        )
    return Choice(stepper, reason, doubts)


def _praise(model: DetailedModel, stepper: Stepper) -> str:
    modes = model.fast_modes.modes
    if not modes:
        return "the model has no states"
    return f"fastest mode {modes[0].value} ({modes[0].state}) is stable at {stepper.step:g} s"


def _unstable(model: DetailedModel, stepper: Stepper) -> str | None:
    """Which mode a stepper makes unstable, and what step would do; None if there is none."""
    modes = model.fast_modes.modes
    limits = {mode: _largest_step(stepper, mode.eigenvalue) for mode in modes}
    worst: Mode | None = min(modes, key=limits.__getitem__, default=None)
    if worst is None or limits[worst] == stepper.step:
        return None
    return (
        f"{stepper.name} at {stepper.step:g} s would be unstable, {worst} needs at most "
        f"{_rounded_down(limits[worst]):g} s"
    )


def _stable(stepper: Stepper, z: complex) -> bool:
    """Whether a step leaves a mode, z = h lambda, no larger than it may become by itself."""
    own = math.exp(min(max(z.real, 0.0), 100.0))
    return abs(z) <= _RESOLVED or stepper.growth(z) <= own * (1 + _ROUNDING)


def _largest_step(stepper: Stepper, eigenvalue: complex) -> float:
    """The largest stable step in seconds that is not above that of the stepper, by bisection."""
    if _stable(stepper, stepper.step * eigenvalue):
        return stepper.step
    low, high = _RESOLVED / abs(eigenvalue), stepper.step
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if _stable(stepper, middle * eigenvalue) else (low, middle)
    return low


def _three_digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}"


def _rounded_down(value: float) -> float:
    """Two digits of a positive number."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.floor(value / unit) * unit
