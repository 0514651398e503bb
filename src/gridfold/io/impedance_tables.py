"""Impedances of transformers that depend on their ratio or phase shift.

A correction table has a factor, complex since revision 34, for each of some ratios or shifts (degrees),
in ascending order. Between two of them it is on a straight line; beyond the last one it stays. PSS/E
Program Operation Manual, transformer impedance correction tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

_ANGLE = "angle"


def correction_factor(table: Mapping[str, Any], ratio: float, shift_deg: float) -> complex:
    """Factor of a table of powerio at the ratio and the shift of a winding.

    Raises
    ------
    ValueError
        The table has no points, or they are not in ascending order.
    """
    at = np.array([float(point["value"]) for point in table["points"]])
    name = f"impedance correction table {table['table']}"
    if not len(at):
        raise ValueError(f"{name} has no points")
    if not (np.diff(at) > 0).all():
        raise ValueError(f"the points of {name} are not in ascending order")
    place = shift_deg if table["variable"] == _ANGLE else ratio
    real, imag = (
        np.interp(place, at, [float(point[part]) for point in table["points"]])
        for part in ("factor_re", "factor_im")
    )
    return complex(real, imag)
