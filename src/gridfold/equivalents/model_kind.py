"""Names of models, and the thresholds by which the paper switches between them."""

from __future__ import annotations

from enum import Enum

from gridfold.errors import OptionError
from gridfold.reduction import BalancedTruncation, ModalTruncation, Reducer


class ModelKind(Enum):
    """Which model is simulated."""

    DETAILED = "detailed"
    LINEAR = "linear"
    PROJECTED = "projected"
    HYBRID = "hybrid"
    ADAPTIVE = "adaptive"
    WHOLE = "whole"


class ReducerKind(Enum):
    """Reducers by name."""

    BALANCED = "balanced"
    MODAL = "modal"

    def build(
        self,
        tolerance: float | None = None,
        order: int | None = None,
        slow_modes: float | None = None,
    ) -> Reducer:
        """The reducer; the balanced one is that of the paper if neither tolerance nor order is given.

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
        bound = TOLERANCE if order is None and tolerance is None else tolerance
        return BalancedTruncation(bound, order, slow_modes)


#: Thresholds of the angle deviation in degrees by which the paper switches.
ANGLES_DEG = {ModelKind.ADAPTIVE: 67.0, ModelKind.WHOLE: 6.0}
#: Time (s) above the threshold after which the operating point is looked for anew.
LONGEST_ABOVE = 5.0
#: Bound of the balanced truncation in the paper.
TOLERANCE = 1e-5
#: Areas that are the study area of a built-in case if nothing else is asked for.
STUDY_AREAS = {"npcc": (1,), "npcc-pst": (1,)}
