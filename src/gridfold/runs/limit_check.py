"""Whether the limits of a device hold: on a bound its state goes no further, and comes back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, Limit, Side
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.limiting import NO_LIMIT, acting_limits, limit_symbol, limit_value

#: Rates per second that count as standing still, and as going somewhere.
_STILL, _MOVING = 1e-9, 1e-6
_PUSHES = (-100.0, -10.0, -1.0, -0.1, 0.1, 1.0, 10.0, 100.0)


@dataclass(frozen=True)
class LimitFound:
    """What was found about a limit; `holds` is None where nothing drives the device to it."""

    limit: Limit
    holds: bool | None
    text: str


@dataclass(frozen=True)
class _Point:
    """States, inputs and parameters of one unit, a column each."""

    x: NDArray[np.float64]
    u: NDArray[np.float64]
    p: NDArray[np.float64]


def limits_found(
    device: Device, x: NDArray[np.float64], u: NDArray[np.float64], p: NDArray[np.float64]
) -> Iterator[LimitFound]:
    """Each limit of a device about the start of one unit, (rows, 1) each."""
    for limit in device.limits:
        at = _Point(x, u, p)
        symbol = limit_symbol(device, limit)
        if limit.state is None:
            acts = any(acting_limits(device, q.x, q.u, q.p)[device.limits.index(limit), 0]
                       for q in (at, *_pushed(at)))  # fmt: skip
            text = f"{symbol} limits what it should" if acts else f"{symbol} never acts"
            yield LimitFound(limit, True if acts else None, text)
        else:
            yield _of_state(device, limit, symbol, limit.state, at)


def _of_state(device: Device, limit: Limit, symbol: str, state: str, at: _Point) -> LimitFound:
    row, side = device.states.index(state), limit.side.value
    bound = float(limit_value(device, limit, at.p)[0])
    free_row = device.parameter_rows.index(limit.parameter)
    x = at.x.copy()
    x[row] = bound
    pushed_out = came_back = False
    for point in _pushed(replace(at, x=x), apart_from=row):
        free = point.p.copy()
        free[free_row] = side * NO_LIMIT
        wanted = side * _rate(device, row, replace(point, p=free))
        rate = side * _rate(device, row, point)
        if wanted > _MOVING:
            pushed_out = True
            if not rate <= _STILL:
                text = (
                    f"on {symbol} = {bound:g} the state {state} goes on with {side * rate:.3g} 1/s"
                )
                return LimitFound(limit, False, text)
        elif wanted < -_MOVING:
            came_back = True
            if not rate < 0:
                text = f"the state {state} does not come back from {symbol} = {bound:g}"
                return LimitFound(limit, False, text)
    if not pushed_out:
        return LimitFound(limit, None, f"nothing drives {state} beyond {symbol} = {bound:g}")
    back = ", and comes back" if came_back else ""
    way = "above" if limit.side is Side.HIGHEST else "below"
    return LimitFound(limit, True, f"{state} goes not {way} {symbol} = {bound:g}{back}")


def _pushed(at: _Point, apart_from: int = -1) -> Iterator[_Point]:
    """The point with each input, and each other state, moved."""
    for name, rows in (("u", at.u), ("x", at.x)):
        for row in range(len(rows)):
            if name == "x" and row == apart_from:
                continue
            for push in _PUSHES:
                moved = rows.copy()
                moved[row] += push
                yield replace(at, **{name: moved})


def _rate(device: Device, row: int, at: _Point) -> float:
    """Derivative of a state."""
    x, u, p = (np.asarray(rows, dtype=complex) for rows in (at.x, at.u, at.p))
    y = output_stage(device, x, u, p, source_stage(device, x, p))
    return float(derivative_stage(device, x, u, p, y)[row, 0].real)
