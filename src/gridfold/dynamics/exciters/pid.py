"""Parameters of regulators that are a PID: AC8B, ESAC8B, DC4B, ST6B."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from gridfold.dynamics.device import Bound, Parameter


def gains(suffix: str) -> tuple[Parameter, ...]:
    """KP, KI, KD and TD with what the model adds to their symbols."""
    return (
        Parameter("proportional_gain", f"KP{suffix}", "p.u.", Bound.NOT_NEGATIVE),
        Parameter("integral_gain", f"KI{suffix}", "1/s", Bound.NOT_NEGATIVE),
        Parameter("derivative_gain", f"KD{suffix}", "s", Bound.NOT_NEGATIVE),
        Parameter("derivative_time", f"TD{suffix}", "s", Bound.NOT_NEGATIVE),
    )


PID = gains("R")


def some_gain(parameters: Mapping[str, float]) -> Iterator[str]:
    """A fault where nothing holds the voltage in steady state."""
    if parameters["proportional_gain"] == 0 and parameters["integral_gain"] == 0:
        yield "proportional_gain and integral_gain are both 0: nothing holds the voltage"
