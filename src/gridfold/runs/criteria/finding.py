"""What a criterion says of a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from gridfold.cards import Card
from gridfold.grid.criteria import Criterion

#: What separates names of criteria where several stand in a text.
BETWEEN = "; "


class Verdict(Enum):
    """Whether a criterion is fulfilled; a run that ends too early may leave that open."""

    KEPT = "kept"
    VIOLATED = "violated"
    OPEN = "not judged"


@dataclass(frozen=True, repr=False)
class Finding(Card):
    """A criterion held against a run.

    Parameters
    ----------
    criterion : Criterion
        What was asked.
    verdict : Verdict
        The answer.
    value, limit : float, optional
        What decides, and what it is compared with, in `unit`.
    margin : float, optional
        What is left until the limit, in `unit`; negative if it is violated.
    share : float, optional
        The margin as a part of the limit; for frequencies of the distance from nominal to the limit.
    unit : str
        ``deg``, ``p.u.``, ``s``, ``Hz`` or ``%``.
    signal : str
        What decides as a column of tables: ``voltage_pu:5``, ``frequency_hz``, ``angle_deg:3:1`` or two
        of these by a comma.
    where : str
        The same in words: ``bus 5``.
    at : float, optional
        When, in seconds.
    told : str
        What was found, as a sentence without its full stop.
    notes : tuple of str
        What limits the answer.
    """

    criterion: Criterion
    verdict: Verdict
    value: float | None = None
    limit: float | None = None
    margin: float | None = None
    share: float | None = None
    unit: str = ""
    signal: str = ""
    where: str = ""
    at: float | None = None
    told: str = ""
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the criterion."""
        return str(self.criterion)

    def _facts(self) -> dict[str, object]:
        margin = "" if self.margin is None else f"{self.margin:+.3g} {self.unit}"
        facts = {
            "title": self.name,
            "verdict": self.verdict.value,
            "margin": margin,
            "why": self.told,
        }
        return {name: text for name, text in facts.items() if text}

    def noted(self, *notes: str) -> Finding:
        """The same with further notes."""
        return replace(self, notes=(*self.notes, *notes))

    def within(self, error: float) -> bool:
        """Whether an error of the value, in its unit, could turn the verdict."""
        return self.margin is not None and abs(self.margin) < error

    def record(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "name": self.name,
            "verdict": self.verdict.value,
            "value": self.value,
            "limit": self.limit,
            "margin": self.margin,
            "unit": self.unit,
            "signal": self.signal,
            "where": self.where,
            "at": self.at,
            "told": self.told,
            "notes": list(self.notes),
        }
