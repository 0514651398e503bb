"""Points at which the kernels of a device are tried: ordinary ones, extremes, and each limit acting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Bound, Device, Limit
from gridfold.dynamics.device_functions import parameter_faults

#: Ordinary points, and the units at each.
ORDINARY, UNITS = 4, 3
_SPREADS = (1.0, 5.0, 50.0)
_CODES = range(9)


@dataclass(frozen=True)
class TrialPoint:
    """States x, inputs u and parameters p, one column a unit, and whether the point is ordinary.

    At an ordinary point, with the parameters that are given and all else between 0.2 and 1.2, a kernel
    has to have values; elsewhere it has to keep to its rows.
    """

    x: NDArray[np.float64]
    u: NDArray[np.float64]
    p: NDArray[np.float64]
    is_ordinary: bool = False

    def with_row(self, name: str, row: int, value: float) -> TrialPoint:
        """The same point with one row of x, u or p at a value."""
        rows = getattr(self, name).copy()
        rows[row] = value
        return replace(self, **{name: rows}, is_ordinary=False)


def trial_points(
    device: Device, parameters: NDArray[np.float64], seed: int = 0
) -> Iterator[TrialPoint]:
    """Points about the parameters of units, (n_parameter_rows, n_units); the same ones every time.

    Set points may be NaN there.
    """
    random = np.random.default_rng(seed)
    n, m = len(device.states), len(device.inputs)

    def point(low: float, high: float, ordinary: bool) -> TrialPoint:
        columns = random.integers(0, parameters.shape[1], UNITS)
        p = parameters[:, columns].copy()
        p[np.isnan(p)] = random.uniform(low, high, p.shape)[np.isnan(p)]
        x, u = random.uniform(low, high, (n, UNITS)), random.uniform(low, high, (m, UNITS))
        return TrialPoint(x, u, p, ordinary)

    for _ in range(ORDINARY):
        yield point(0.2, 1.2, True)
    for spread in _SPREADS:
        for _ in range(2):
            yield point(-spread, spread, False)
    for _ in range(2):
        base = point(0.2, 1.2, False)
        yield replace(base, x=0.0 * base.x, u=0.0 * base.u)
        yield from _extremes(base)
        yield from _other_parameters(device, base)
        yield from _at_limits(device, base)


def _extremes(base: TrialPoint) -> Iterator[TrialPoint]:
    """Each state and each input far away."""
    for name, rows in (("x", base.x), ("u", base.u)):
        for row in range(len(rows)):
            for value in (-20.0, 0.0, 20.0):
                yield base.with_row(name, row, value)


def _other_parameters(device: Device, base: TrialPoint) -> Iterator[TrialPoint]:
    """Each parameter that may be 0 at 0, each code at other whole numbers; where no check objects."""
    for row, parameter in enumerate(device.parameters):
        values: tuple[float, ...] = ()
        if parameter.bound is Bound.INTEGER:
            values = tuple(float(code) for code in _CODES)
        elif parameter.bound is not Bound.POSITIVE:
            values = (0.0,)
        for value in values:
            tried = base.with_row("p", row, value)
            given = dict(zip((p.name for p in device.parameters), tried.p[:, 0], strict=False))
            if not parameter_faults(device, given):
                yield tried


def _at_limits(device: Device, base: TrialPoint) -> Iterator[TrialPoint]:
    """Each limit with its state, or else everything, on it and on both sides of it."""
    for limit in device.limits:
        for beyond in (-1.0, 0.0, 1.0):
            yield _near(device, limit, base, beyond)


def _near(device: Device, limit: Limit, base: TrialPoint, beyond: float) -> TrialPoint:
    row, side = device.parameter_rows.index(limit.parameter), limit.side.value
    if limit.state is None:
        return base.with_row("p", row, -side * (1.0 + beyond))
    x = base.x.copy()
    x[device.states.index(limit.state)] = base.p[row] + side * beyond
    return replace(base, x=x, is_ordinary=False)
