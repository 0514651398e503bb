"""Where the error of a run came from."""

from __future__ import annotations

from dataclasses import dataclass

from gridfold.cards import Card


@dataclass(frozen=True, repr=False)
class ErrorCauses(Card):
    """What each cause alone contributes to the angle with the largest estimated error.

    Root mean squares over the run, in degrees against the centre of inertia. The contributions add up
    at each instant; these figures do not, since contributions may cancel.

    Parameters
    ----------
    truncation_deg : float
        The linear area has fewer states than its machines: driven by what its equations are lacking.
    linearization_deg : float
        Machines are linear that are not: the rest, and with it all that is of second order.
    jump_deg : float
        States that a model cannot take up when it takes over.
    """

    truncation_deg: float
    linearization_deg: float
    jump_deg: float

    def _facts(self) -> dict[str, object]:
        return {"causes": self.text}

    @property
    def text(self) -> str:
        """For people."""
        return (
            f"linearization {self.linearization_deg:.2g}, truncation {self.truncation_deg:.2g}, jumps "
            f"{self.jump_deg:.2g} degrees"
        )

    def record(self) -> dict[str, float]:
        """The same, ready for JSON."""
        return {
            "truncation": self.truncation_deg,
            "linearization": self.linearization_deg,
            "jump": self.jump_deg,
        }


#: Of a run without reduced models.
NO_CAUSES = ErrorCauses(0.0, 0.0, 0.0)
