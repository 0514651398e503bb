"""Rotor angles of a run against a largest separation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gridfold.grid.case import UnitKey
from gridfold.grid.criteria import AngleSeparation
from gridfold.runs.criteria.course import Course
from gridfold.runs.criteria.finding import Finding, Verdict
from gridfold.runs.parts import Part
from gridfold.runs.synchronism import angle_frame


@dataclass
class AngleWatch:
    """Takes the parts of a run: the two machines of an island that are furthest apart."""

    criterion: AngleSeparation
    machines: Sequence[UnitKey]
    course: Course
    largest: float = -1.0
    at: float = 0.0
    pair: tuple[UnitKey, ...] = ()

    def take(self, part: Part) -> None:
        """The next part of the run."""
        frame, wanted = angle_frame(part.model), set(self.machines)
        angles = np.rad2deg(part.states_at(frame.slots))
        for island in range(len(frame.fixed)):
            here = [
                k
                for k, (unit, its) in enumerate(zip(frame.units, frame.island, strict=True))
                if its == island and unit in wanted
            ]
            if not here:
                continue
            those = angles[:, here]
            apart = np.ptp(those, axis=1)
            row = int(apart.argmax())
            if apart[row] > self.largest:
                ends = those[row].argmax(), those[row].argmin()
                self.largest, self.at = float(apart[row]), float(part.times[row])
                self.pair = tuple(frame.units[here[k]] for k in ends)

    def finding(self) -> Finding:
        """What they came to."""
        limit = self.criterion.limit_deg
        if not self.pair:
            told = "none of the machines is in service"
            return Finding(self.criterion, Verdict.OPEN, told=told)
        margin = limit - self.largest
        where = f"machines {self.pair[0]} and {self.pair[1]}"
        finding = Finding(
            self.criterion,
            Verdict.VIOLATED if margin < 0 else Verdict.KEPT,
            self.largest,
            limit,
            margin,
            margin / limit,
            "deg",
            ",".join(f"angle_coi_deg:{unit}" for unit in self.pair),
            where,
            self.at,
            f"{where} are {self.largest:.1f} degrees apart at {self.at:g} s",
        )
        return self.course.answer(finding)
