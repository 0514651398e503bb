"""How many states balanced methods keep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.reduction.base import check_order
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem


@dataclass(frozen=True)
class OrderRule:
    """Either a tolerance for the bound (6) of Osipov & Sun, or the order itself.

    Parameters
    ----------
    tolerance : float or None
        Largest accepted 2 (sigma_(r+1) + ... + sigma_n).
    order : int or None
        Number of states of the reduced system.

    Raises
    ------
    OptionError
        If not exactly one of them is given, or it is not positive.
    """

    tolerance: float | None
    order: int | None

    def __post_init__(self) -> None:
        if (self.tolerance is None) == (self.order is None):
            raise OptionError("give either the tolerance or the order of a reduction")
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise OptionError(f"the tolerance of a reduction must be positive: {self.tolerance}")
        if self.order is not None and self.order < 1:
            raise OptionError(f"the order of a reduction must be at least 1: {self.order}")

    def choose(
        self, values: NDArray[np.float64], system: LinearSystem | DescriptorSystem, kept: int
    ) -> int:
        """Number of states r to keep of the stable part.

        Parameters
        ----------
        values : ndarray
            Hankel singular values of the stable part, in descending order.
        system : LinearSystem or DescriptorSystem
            The whole system.
        kept : int
            Number of states of unstable or marginal modes, kept besides.
        """
        rank = numerical_rank(values)
        if self.order is not None:
            check_order(self.order, system, kept)
            r = self.order - kept
        else:
            r = smallest_order(values, float(self.tolerance or 0.0))
        if r > rank:
            asked = f"tolerance {self.tolerance}" if self.order is None else f"order {self.order}"
            raise OptionError(
                f"{asked} asks for more than the {rank + kept} states that stand above rounding; "
                f"the bound at that order is {2 * values[rank:].sum():.3g}"
            )
        return r


def smallest_order(values: NDArray[np.float64], tolerance: float) -> int:
    """Smallest r with 2 (sigma_(r+1) + ... + sigma_n) <= `tolerance`."""
    tails = 2 * np.cumsum(values[::-1])[::-1]
    return int(np.count_nonzero(tails > tolerance))


def numerical_rank(values: NDArray[np.float64]) -> int:
    """How many of the descending Hankel singular values `values` stand above rounding."""
    noise = len(values) * np.finfo(np.float64).eps * values.max(initial=0.0)
    return int(np.count_nonzero(values > noise))
