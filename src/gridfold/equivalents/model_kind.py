"""Names of models and of their options, and the thresholds by which the paper switches."""

from __future__ import annotations

from enum import Enum

from gridfold.errors import OptionError
from gridfold.reduction import BalancedTruncation, ModalTruncation, Reducer


class ModelKind(Enum):
    """Which model is simulated.

    AUTO: the detailed one, or the ladder where that is predicted to be cheaper. LINEAR: study area
    exact and the rest linear; everything linear while angles are near the operating point. RETAINED:
    machines near the boundary exact, too. ADAPTIVE: the ladder of detailed, retained, linear, and
    linear throughout. WHOLE: the same without the linear external area. PAPER and PAPER_WHOLE: as
    printed by Osipov & Sun, equations (14)-(15) and (16)-(17); HYBRID and PROJECTED: their upper model
    all the time, with the near or with all functions nonlinear.
    """

    AUTO = "auto"
    DETAILED = "detailed"
    LINEAR = "linear"
    RETAINED = "retained"
    ADAPTIVE = "adaptive"
    WHOLE = "whole"
    HYBRID = "hybrid"
    PROJECTED = "projected"
    PAPER = "paper"
    PAPER_WHOLE = "paper-whole"


class Outputs(Enum):
    """How linear machines act on the others.

    POLAR: through ports, whose currents are linear in logarithm and angle. STATES: their states are
    formed and enter the network as they are, as in the paper.
    """

    POLAR = "polar"
    STATES = "states"


class Weights(Enum):
    """What a balanced reduction weighs: what is caused at the ports, or all states alike."""

    INTERFACE = "interface"
    STATES = "states"


class ReducerKind(Enum):
    """Reducers by name."""

    BALANCED = "balanced"
    MODAL = "modal"

    def build(
        self,
        tolerance: float | None = None,
        order: int | None = None,
        slow_modes: float | None = None,
        default: float | None = None,
    ) -> Reducer:
        """The reducer; the balanced one has the `default` bound if neither of the first two is given.

        Raises
        ------
        OptionError
            An option is out of range, or is none of this reducer's.
        """
        if self is ReducerKind.MODAL:
            if tolerance is not None:
                raise OptionError("a tolerance has no effect on the modal reducer; give an order")
            if slow_modes is not None:
                raise OptionError("slow modes have no effect on the modal reducer")
            if order is None:
                raise OptionError("the modal reducer needs an order")
            return ModalTruncation(order)
        usual = TOLERANCE if default is None else default
        bound = usual if order is None and tolerance is None else tolerance
        return BalancedTruncation(bound, order, slow_modes)


#: Models whose linear machines act through ports, and those that are printed in the paper.
PORTED = (ModelKind.LINEAR, ModelKind.RETAINED, ModelKind.ADAPTIVE, ModelKind.WHOLE)
PRINTED = (ModelKind.HYBRID, ModelKind.PROJECTED, ModelKind.PAPER, ModelKind.PAPER_WHOLE)
#: Models without partition, whose reduction is none of the paper's.
WITHOUT_PARTITION = (ModelKind.PAPER_WHOLE,)
#: Thresholds of the angle deviation in degrees by which the paper switches.
ANGLES_DEG = {
    ModelKind.ADAPTIVE: 67.0,
    ModelKind.WHOLE: 6.0,
    ModelKind.PAPER: 67.0,
    ModelKind.PAPER_WHOLE: 6.0,
}
#: Angle deviation in degrees up to which everything is linear, in the ladder and the linear model.
WHOLE_DEG = 15.0
#: Time (s) for which the deviation stays below a threshold before the ladder takes a cheaper rung.
DWELL = 0.5
#: Time (s) above the threshold after which the operating point is looked for anew.
LONGEST_ABOVE = 5.0
#: Bound of the balanced truncation in the paper.
TOLERANCE = 1e-5
#: Areas that are the study area of a built-in case if nothing else is asked for.
STUDY_AREAS = {"npcc": (1,), "npcc-pst": (1,)}
