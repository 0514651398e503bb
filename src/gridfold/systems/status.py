"""How a run ended."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """Outcome of a run; each member explains itself through :attr:`advice`."""

    COMPLETED = "completed"
    LOST_SYNCHRONISM = "lost synchronism"
    OFF_SPEED = "off speed"
    NOT_FINITE = "not finite"

    @property
    def advice(self) -> str:
        """What the outcome means, in one sentence."""
        return _ADVICE[self]


_ADVICE = {
    Status.COMPLETED: (
        "The run reached its end time, and no machine left synchronism or its range of speeds if that "
        "was watched."
    ),
    Status.LOST_SYNCHRONISM: (
        "A rotor angle left the band of the synchronism criterion; the run was ended there."
    ),
    Status.OFF_SPEED: (
        "A rotor left the range of speeds of the criterion, as a part of the grid does that runs away "
        "or falls behind on its own; the run was ended there."
    ),
    Status.NOT_FINITE: (
        "A state became infinite or not a number; the run was cut before that sample. "
        "Try a smaller time step, and look at the device that is named."
    ),
}
