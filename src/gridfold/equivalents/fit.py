"""What a ladder was made for, and the errors that decided how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gridfold.cards import Card


@dataclass(frozen=True)
class TriedCount:
    """A number of retained machines that was tried.

    Parameters
    ----------
    count : int
        Machines from the top of the ranking.
    error_deg : float
        Error of the rung in sample swings, in degrees.
    cost : float
        A step of the rung, in steps of the detailed model.
    """

    count: int
    error_deg: float
    cost: float


@dataclass(frozen=True, repr=False)
class Fit(Card):
    """How a ladder was chosen for a tolerance; see :func:`gridfold.fit_ladder`.

    Errors are those of the worst rotor angle of the study area against the centre of inertia in sample
    swings, root mean square, in degrees.

    Parameters
    ----------
    tolerance_deg : float
        The tolerance.
    linear_deg : float
        Error of the linear rung.
    whole_deg : float
        Angle deviation in degrees up to which everything is linear.
    bound : float or None
        Bound of the reduction in p.u.; None where the reducer was given.
    truncation_deg : float or None
        What the truncation moves.
    count : int or None
        Machines of the ranking that are retained; None where they were given.
    tried : tuple of TriedCount
        The numbers that were tried.
    """

    tolerance_deg: float
    linear_deg: float
    whole_deg: float
    bound: float | None = None
    truncation_deg: float | None = None
    count: int | None = None
    tried: tuple[TriedCount, ...] = ()

    def _facts(self) -> dict[str, object]:
        return {"tolerance": f"for {self.tolerance_deg:g} degrees", "chosen": self.text}

    @property
    def text(self) -> str:
        """What was chosen, and why, for people."""
        parts = [f"the linear area errs by {self.linear_deg:.2g} degrees in sample swings"]
        if self.bound is not None:
            parts.append(f"bound {self.bound:g} p.u., which moves {self.truncation_deg:.2g}")
        parts += [
            f"{item.count} machines retained leave {item.error_deg:.2g} at {item.cost:.2f} of a "
            "detailed step"
            for item in self.tried
        ]
        if self.count is not None:
            parts.append(f"{self.count} taken" if self.tried else "no machine need be retained")
        return "; ".join([*parts, f"all linear up to {self.whole_deg:.3g} degrees"])

    def record(self) -> dict[str, Any]:
        """The same, ready for JSON."""
        names = ("tolerance_deg", "linear_deg", "whole_deg", "bound", "truncation_deg", "count")
        return {name: getattr(self, name) for name in names} | {
            "tried": [dict(vars(item)) for item in self.tried]
        }

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Fit:
        """That of a :meth:`record`.

        Raises
        ------
        LookupError, TypeError, ValueError
            Something is missing, or is of another type.
        """
        optional = {
            name: None if record[name] is None else float(record[name])
            for name in ("bound", "truncation_deg")
        }
        count = record["count"]
        return cls(
            float(record["tolerance_deg"]),
            float(record["linear_deg"]),
            float(record["whole_deg"]),
            **optional,
            count=None if count is None else int(count),
            tried=tuple(
                TriedCount(int(item["count"]), float(item["error_deg"]), float(item["cost"]))
                for item in record["tried"]
            ),
        )
