"""Distributions of what a sample draws, from a number between 0 and 1."""

from __future__ import annotations

from math import inf
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, FiniteFloat, Tag, model_validator
from scipy.special import ndtr, ndtri

from gridfold.study.study_file import Section

#: Distance from 0 and 1 at which the ends of an unbounded distribution lie.
_EDGE = 1e-12
#: Probability that a normal distribution has to have within its bounds.
_LEAST = 1e-9


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise ValueError("the first number must be below the second")
    return pair


Range = Annotated[tuple[FiniteFloat, FiniteFloat], AfterValidator(_ascending)]


class Distribution(Section):
    """A distribution: one of `uniform`, `normal` and `choice`."""

    uniform: Range | None = Field(default=None, description="Lowest and highest value.")
    normal: tuple[FiniteFloat, Annotated[float, Field(gt=0, lt=inf)]] | None = Field(
        default=None, description="Mean and standard deviation."
    )
    within: Range | None = Field(
        default=None, description="Bounds of the normal distribution, which is cut there."
    )
    choice: tuple[FiniteFloat, ...] | None = Field(
        default=None, min_length=1, description="Values of which one is taken."
    )
    weights: tuple[Annotated[float, Field(gt=0, lt=inf)], ...] | None = Field(
        default=None, description="How often, in proportion; all alike by default."
    )

    @model_validator(mode="after")
    def _fits(self) -> Distribution:
        kinds = [
            name for name in ("uniform", "normal", "choice") if getattr(self, name) is not None
        ]
        if len(kinds) != 1:
            given = " and ".join(kinds) or "none of them"
            raise ValueError(f"give one of uniform, normal and choice, not {given}")
        if self.within is not None and self.normal is None:
            raise ValueError("within is for a normal distribution")
        if self.normal is not None and self._probabilities[1] < _LEAST:
            raise ValueError("the normal distribution has nothing within its bounds")
        if self.weights is not None and len(self.weights) != len(self.choice or ()):
            raise ValueError("weights are as many as the values of choice")
        return self

    def value(self, u: float) -> float:
        """The value below which a part `u`, from 0 to 1, of the distribution lies."""
        if self.uniform is not None:
            low, high = self.uniform
            return min(max(low + u * (high - low), low), high)
        if self.normal is not None:
            mean, deviation = self.normal
            below, inside = self._probabilities
            u = min(max(u, _EDGE), 1 - _EDGE)
            low, high = self.within or (-inf, inf)
            return min(max(mean + deviation * float(ndtri(below + u * inside)), low), high)
        assert self.choice is not None
        shares = np.cumsum(self.weights or np.ones(len(self.choice)))
        place = int(np.searchsorted(shares, u * shares[-1], side="right"))
        return self.choice[min(place, len(self.choice) - 1)]

    @property
    def _probabilities(self) -> tuple[float, float]:
        """Probability of the normal distribution below its bounds, and within them."""
        assert self.normal is not None
        mean, deviation = self.normal
        low, high = ((end - mean) / deviation for end in self.within or (-inf, inf))
        return float(ndtr(low)), float(ndtr(high) - ndtr(low))


def _kind(given: Any) -> str:
    plain = isinstance(given, int | float) and not isinstance(given, bool)
    return "number" if plain else "distribution"


#: A number, or a distribution of numbers.
Amount = Annotated[
    Annotated[FiniteFloat, Tag("number")] | Annotated[Distribution, Tag("distribution")],
    Discriminator(_kind),
]


def value_of(amount: float | Distribution, u: float) -> float:
    """The value of an amount for a number from 0 to 1."""
    return amount.value(u) if isinstance(amount, Distribution) else float(amount)
