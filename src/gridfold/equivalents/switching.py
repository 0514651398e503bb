"""When the adaptive algorithm uses which model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gridfold.equivalents.families import Mode
from gridfold.errors import OptionError


class Band(NamedTuple):
    """Range of deviations in degrees in which a model is used."""

    mode: Mode
    highest: float
    lowest: float


@dataclass(frozen=True)
class SwitchingRule:
    """When which model is used; by default as in the paper.

    Parameters
    ----------
    angle_deg : float
        Threshold of the angle deviation in degrees; 0 is the most exact model all the time, infinity
        the next one.
    longest_above : float
        Time in seconds above the threshold after which the operating point is looked for anew.
    limits : bool
        Whether the detailed model is used where a limit of a linear unit is reached; limits that are
        passed are told in any case.
    whole_deg : float
        Angle deviation in degrees up to which everything is linear, in families that have three models.
    dwell : float
        Time in seconds for which the deviation has to stay below a threshold before a cheaper model
        takes over: a swinging angle passes through zero.
    """

    angle_deg: float
    longest_above: float = 5.0
    limits: bool = True
    whole_deg: float = 0.0
    dwell: float = 0.0

    def __post_init__(self) -> None:
        for name, words in (("angle_deg", "the angle threshold"), ("whole_deg", "whole_deg")):
            if not getattr(self, name) >= 0:
                raise OptionError(f"{words} must be 0 degrees or more, not {getattr(self, name)!r}")
        if not self.longest_above > 0:
            raise OptionError(f"longest_above must be positive, not {self.longest_above!r}")
        if not 0 <= self.dwell < np.inf:
            raise OptionError(f"dwell must be 0 seconds or more, not {self.dwell!r}")

    def bands(self, modes: Sequence[Mode]) -> tuple[Band, ...]:
        """The models of a family with the deviations in degrees at which they are used.

        From the highest band downwards; neighbours with the same model are one band.
        """
        ends = (self.angle_deg, min(self.whole_deg, self.angle_deg))[: len(modes) - 1]
        bands = [Band(modes[0], np.inf, 0.0)]
        for mode, end in zip(modes[1:], ends, strict=True):
            if end > 0 and mode is not bands[-1].mode:
                last = bands.pop()
                bands += [] if end == last.highest else [Band(last.mode, last.highest, end)]
                bands += [Band(mode, end, 0.0)]
        return tuple(bands)
