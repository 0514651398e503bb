"""Names of models, and the thresholds by which the paper switches between them."""

from __future__ import annotations

from enum import Enum


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


#: Thresholds of the angle deviation in degrees by which the paper switches.
ANGLES_DEG = {ModelKind.ADAPTIVE: 67.0, ModelKind.WHOLE: 6.0}
#: Time (s) above the threshold after which the operating point is looked for anew.
LONGEST_ABOVE = 5.0
#: Bound of the balanced truncation in the paper.
TOLERANCE = 1e-5
#: Areas that are the study area of a built-in case if nothing else is asked for.
STUDY_AREAS = {"npcc": (1,), "npcc-pst": (1,)}
