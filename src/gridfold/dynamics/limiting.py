"""Which limits of a device act at a given state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, Limit
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage

#: Value of a limit that is not there, and the change that counts as acting.
NO_LIMIT, ACTING = 1e9, 1e-9


def without_limits(device: Device, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """A copy of parameter rows, (n_rows, n_units), with every limit out of the way."""
    free = parameters.copy()
    for limit in device.limits:
        free[_row(device, limit)] = limit.side.value * NO_LIMIT
    return free


def acting_limits(
    device: Device,
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    p: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Which limits bind at states x, inputs u and parameters p, shape (n_limits, n_units).

    A limit acts where a state is beyond it, or where derivatives or outputs change without it.
    """
    found = np.zeros((len(device.limits), x.shape[1]), dtype=bool)
    if not device.limits:
        return found
    bound = _evaluate(device, x, u, p)
    with np.errstate(invalid="ignore"):
        # Most units are within all of their limits: nothing changes there without any of them.
        change = np.abs(_evaluate(device, x, u, without_limits(device, p)) - bound)
        some = np.flatnonzero(~(change <= ACTING).all(axis=0))
        for k, limit in enumerate(device.limits if len(some) else ()):
            free = p.take(some, axis=1)
            free[_row(device, limit)] = limit.side.value * NO_LIMIT
            without = _evaluate(device, x.take(some, axis=1), u.take(some, axis=1), free)
            found[k, some] = (np.abs(without - bound[:, some]) > ACTING).any(axis=0)
    for k, limit in enumerate(device.limits):
        if limit.state is not None:
            beyond = x[device.states.index(limit.state)] - limit_value(device, limit, p)
            found[k] |= limit.side.value * beyond > ACTING
    return found


def limit_value(device: Device, limit: Limit, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Value of a limit at the parameters p (n_rows, n_units): shape (n_units,)."""
    value = p[_row(device, limit)]
    if limit.added_to is not None:
        value = value + p[device.parameter_rows.index(limit.added_to)]
    return np.asarray(value, dtype=float)


def limit_symbol(device: Device, limit: Limit) -> str:
    """Symbol of a limit, as in the docs."""
    name = limit.parameter if limit.added_to is None else limit.added_to
    return device.parameters[device.parameter_rows.index(name)].symbol


def bounds_state(
    device: Device,
    limit: Limit,
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    p: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether a limit bounds its state as it stands, shape (n_units,).

    It does not where it has no state, or where a time constant of zero leaves that state idle:
    then nothing depends on how far the state is beyond the limit.
    """
    if limit.state is None:
        return np.zeros(x.shape[1], dtype=bool)
    free, side = p.copy(), limit.side.value
    free[_row(device, limit)] = side * NO_LIMIT
    row, value = device.states.index(limit.state), limit_value(device, limit, p)

    def effect(state: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = x.copy()
        moved[row] = state
        return _evaluate(device, moved, u, free) - _evaluate(device, moved, u, p)

    return np.asarray((np.abs(effect(value + side) - effect(value - side)) > ACTING).any(axis=0))


def tightened(device: Device, p: NDArray[np.float64], part: float) -> NDArray[np.float64]:
    """Parameters with every limit moved inwards by `part` of its size.

    A limit of a state moves by at least `part`. Any other that is zero stays: that may mean none.
    """
    result = p.copy()
    for limit in device.limits:
        size = np.abs(limit_value(device, limit, p))
        if limit.state is not None:
            size = np.maximum(size, 1.0)
        result[_row(device, limit)] -= limit.side.value * part * size
    return result


def widened(
    device: Device,
    k: int,
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    p: NDArray[np.float64],
) -> float:
    """Value to which limit `k` has to be moved for one unit (one column each) not to act."""
    limit = device.limits[k]
    row, side = _row(device, limit), limit.side.value
    tried = p.copy()

    def acts(value: float) -> bool:
        tried[row] = value
        return bool(acting_limits(device, x, u, tried)[k, 0])

    inside = float(p[row, 0])
    step = max(abs(inside), 1.0) * 1e-3
    outside = inside + side * step
    while acts(outside) and abs(outside) < NO_LIMIT:
        inside, step = outside, 2 * step
        outside = inside + side * step
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if acts(middle) else (inside, middle)
    return outside


def _row(device: Device, limit: Limit) -> int:
    return device.parameter_rows.index(limit.parameter)


def _evaluate(
    device: Device, x: NDArray[np.float64], u: NDArray[np.float64], p: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Outputs and derivatives, one below the other."""
    states, inputs, parameters = (np.asarray(m, dtype=np.complex128) for m in (x, u, p))
    y = output_stage(device, states, inputs, parameters, source_stage(device, states, parameters))
    dx = derivative_stage(device, states, inputs, parameters, y)
    return np.concatenate([y.real, dx.real])
