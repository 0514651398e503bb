"""The error of an approximate solution of x' = f(x), carried along in a few linear modes.

With the approximation y(t) and the error e = x - y,

    e' = f(y + e) - y'

exactly. For e = S^T w in modes that come close to those of f, w' = L w, the rest is slow and small:

    w' = L w + g(t, w),   g = T (f(y + S^T w) - y') - L w

What modes drive by links (:mod:`gridfold.numerics.mode_links`) is a part of g.

An exponential integrator solves it: the modes by their exponentials, g as a cubic over each step whose
slopes come from the neighbours (Hochbruck & Ostermann, Acta Numerica 19, 2010, pp. 209-286, section
2: the phi functions). It does so for a window of steps at a time, by repetition (waveform relaxation:
Lelarasmee, Ruehli & Sangiovanni-Vincentelli, IEEE Trans. CAD 1(3), 1982, pp. 131-145): with w of all
its instants known roughly, f is evaluated at all of them and w found anew, until it changes little. So
the ways between modes and states are products of matrices, and not of a matrix and a vector each.

Windows and steps follow the error: a window that does not converge becomes shorter, and steps become
longer where the same with every second of them says as much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.compiled import FAST, invoke, jit
from gridfold.numerics.error_modes import Modes, Way
from gridfold.numerics.modal_form import ModalForm
from gridfold.numerics.rhs import CompiledRhs

#: Change of the outputs, in parts of the largest so far, below which a window is not repeated.
CHANGE = 0.04
#: What twice the steps may change, in the same parts, for steps to become twice as long; they become
#: half as long where it is this many times as much.
COARSER, FINER = 0.05, 16.0
#: Most steps of a window, and how often one is repeated before it is cut.
LONGEST, REPEATS = 32, 6
#: Part of the change before above which a repeated window does not converge.
SLOWEST = 0.5
#: |L h| below which the phi functions are taken from their series, and its terms.
_SERIES, _TERMS = 1.0, 20


@dataclass(frozen=True, eq=False)
class Carried:
    """The error w at some rows of a solution, shape (m, n_modes), and g there.

    The last row is that of the solution, unless the error became too large to be followed.
    """

    rows: NDArray[np.int64]
    errors: NDArray[np.float64]
    rest: NDArray[np.float64]

    def between(self, form: ModalForm, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """The error at all rows up to the last of these, whose `times` are given: (n, n_modes)."""
        errors = np.empty((self.rows[-1] + 1, self.errors.shape[1]))
        errors[0] = self.errors[0]
        _between(
            form.eigenvalues, form.partner, self.rows, self.errors, self.rest,
            np.ascontiguousarray(times), errors,
        )  # fmt: skip
        return errors


def carry_error(
    rhs: CompiledRhs,
    modes: Modes,
    outputs: NDArray[np.float64],
    way: Way,
    own: CompiledRhs,
    times: NDArray[np.float64],
    states: NDArray[np.float64],
    start: NDArray[np.float64],
    steps: tuple[float, float],
    least: float,
    most: float = np.inf,
) -> Carried:
    """The error along an approximate solution, in modal coordinates.

    Parameters
    ----------
    rhs : CompiledRhs
        f.
    modes : Modes
        What errors travel in.
    outputs : ndarray, shape (n_outputs, n_modes)
        What of them is looked at, and says how exact they have to be; one or more.
    way : Way
        From the smaller system's states.
    own : CompiledRhs
        The smaller system, z' = own(z).
    times : ndarray, shape (n_times,)
        In seconds.
    states : ndarray, shape (n_times, n)
        z.
    start : ndarray, shape (n_modes,)
        w at the first time.
    steps : tuple of float
        Step to begin with and the longest one, in seconds; both are rounded to rows of the solution.
    least : float
        Size of the outputs below which they need not be exact.
    most : float
        Size of the outputs beyond which the error is not followed.

    Returns
    -------
    Carried
        The error at some rows of the solution, the first and, if it was followed so far, the last among
        them.

    Raises
    ------
    OptionError
        An array has another shape.
    """
    n_modes, n_times, n = len(modes.form.partner), len(times), own.n_states
    n_linear = len(modes.slopes)
    for name, array, shape in (
        ("slopes", modes.slopes, (n_linear, rhs.n_states)),
        ("outputs", outputs, (max(1, len(outputs)), n_modes)),
        ("lift", way.lift, (n_linear + len(way.linear), rhs.n_states)),
        ("pull", way.pull, (n_modes, n)),
        ("states", states, (n_times, n)),
        ("start", start, (n_modes,)),
    ):
        if array.shape != shape:
            raise OptionError(f"{name} has shape {array.shape}, expected {shape}")
    spacing = (times[-1] - times[0]) / max(1, n_times - 1)
    strides = [max(1, round(seconds / spacing)) for seconds in steps]
    rows = np.zeros(n_times, dtype=np.int64)
    errors, rest = np.empty((2, n_times, n_modes))
    errors[0] = start
    count = _carry(
        (rhs.address, rhs.integers, rhs.reals, np.zeros(rhs.work_size)),
        (own.address, own.integers, own.reals, np.zeros(own.work_size)),
        modes.form.eigenvalues, modes.form.partner, modes.places,
        *map(np.ascontiguousarray, (modes.into, modes.back, modes.restrict, outputs, times, states)),
        way.origin, way.exact, way.places, way.linear,
        *map(np.ascontiguousarray, (way.lift, way.pull)), *strides, least, most, rows, errors, rest,
    )  # fmt: skip
    return Carried(rows[:count], errors[:count], rest[:count])


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _carry(
    whole, own, eigenvalues, partner, kept, into, back, restrict, outputs, times, z,
    origin, exact, places, linear, lift, pull, stride, longest, least, most, rows, errors, rest,
):  # fmt: skip
    """Fill rows, errors and rest; their number."""
    last, n_modes = len(times) - 1, len(partner)
    other = np.empty((LONGEST + 1, n_modes))
    at = np.empty(len(times))
    at[0] = times[0]
    v, both = np.empty((LONGEST + 1, len(into))), np.empty((LONGEST + 1, len(lift)))
    x, dx = np.empty((LONGEST + 1, len(origin))), np.empty((LONGEST + 1, len(origin)))
    near, moved = np.empty((LONGEST + 1, z.shape[1])), np.empty((LONGEST + 1, z.shape[1]))
    factors = np.empty((2, 5, n_modes), dtype=np.complex128)
    lengths = np.full(2, -1.0)
    data = (whole, own, eigenvalues, partner, kept, into, back, restrict)
    way = (z, origin, exact, places, linear, lift, pull)
    space = (v, both, x, dx, near, moved)
    modes = (eigenvalues, partner, factors, lengths)
    _evaluate(data, way, space, rows, 0, 1, errors, rest)
    node, steps, contraction, known = 0, LONGEST // 4, 1.0, times[-1] - times[0]
    largest = max(least, np.abs(np.dot(errors[:1], outputs.T)).max())
    while rows[node] < last and largest <= most:
        end = node
        while end - node < steps and rows[end] < last:
            rows[end + 1] = min(rows[end] + stride, last)
            at[end + 1] = times[rows[end + 1]]
            end += 1
        span = at[end] - at[node]
        expected = min(1.0, contraction * max(1.0, (span / known) ** 2))
        turns, contraction, size = _settle(
            data, way, space, modes, outputs, rows, at, errors, rest, node, end, expected, largest
        )
        known = span
        if turns == 0 and steps > 1:
            steps = max(1, min(steps, end - node) // 2)
        elif turns == 0 and stride > 1:
            stride = max(1, stride // 2)
        else:
            largest = max(largest, size) if np.isfinite(size) else np.inf
            apart = _apart(modes, outputs, at, errors, rest, other, node, end) / largest
            if 0 <= apart <= COARSER:
                stride = min(2 * stride, longest)
            elif apart > FINER * COARSER:
                stride = max(1, stride // 2)
            if 0 < turns <= 2:
                steps = min(2 * steps, LONGEST)
            node = end
    return node + 1


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _settle(
    data, way, space, modes, outputs, rows, at, errors, rest, node, end, contraction, largest
):  # fmt: skip
    """Repeat a window until its outputs change little.

    Returns how often that was done (0 if it does not settle), by how much a change was smaller than the
    one before, and the largest output. What further turns would change follows from this contraction,
    at first from the one that the window before lets expect.
    """
    _solve(modes, at, rest, errors, node, end, 1, 0, False)
    before, size = 0.0, largest
    for turn in range(REPEATS):
        _evaluate(data, way, space, rows, node + 1, end + 1, errors, rest)
        kept = np.dot(errors[node + 1 : end + 1], outputs.T)
        _solve(modes, at, rest, errors, node, end, 1, 0, True)
        found = np.dot(errors[node + 1 : end + 1], outputs.T)
        change, size = np.abs(found - kept).max(), max(largest, np.abs(found).max())
        if turn > 0:
            contraction = change / before if before > 0 else 0.0
        if contraction * change <= (1 - contraction) * CHANGE * size or change == 0:
            return turn + 1, contraction, size
        if turn > 0 and not contraction < SLOWEST:
            break
        before = change
    return 0, 1.0, size


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _apart(modes, outputs, at, errors, rest, other, node, end):
    """How far the outputs of a window are from those with every second step; negative if it has few."""
    if end - node < 4 or (end - node) % 2 == 1:
        return -1.0
    other[0] = errors[node]
    _solve(modes, at, rest, other, node, end, 2, 1, True)
    apart = 0.0
    for k in range(1, (end - node) // 2 + 1):
        apart = max(apart, np.abs(np.dot(outputs, other[k] - errors[node + 2 * k])).max())
    return apart


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _evaluate(data, way, space, rows, first, stop, errors, rest):
    """The rest g at some nodes."""
    whole, own, eigenvalues, partner, kept, into, back, restrict = data
    z, origin, exact, places, linear, lift, pull = way
    v, both, x, dx, near, moved = space
    count, n_modes, n_kept = stop - first, len(partner), len(kept)
    n_rest = len(restrict)
    np.dot(errors[first:stop], into.T, v[:count])
    for k in range(count):
        row = rows[first + k]
        for i in range(n_rest):
            both[k, i] = v[k, n_kept + i]
        for i in range(len(linear)):
            both[k, n_rest + i] = z[row, linear[i]]
        near[k] = z[row]
    np.dot(both[:count], lift, x[:count])
    for k in range(count):
        x[k] += origin
        for i in range(n_kept):
            x[k, kept[i]] += v[k, i]
        for i in range(len(exact)):
            x[k, places[i]] += near[k, exact[i]]
        invoke(whole[0], (whole[1], whole[2], whole[3], x[k], dx[k]))
        invoke(own[0], (own[1], own[2], own[3], near[k], moved[k]))
        for i in range(n_kept):
            v[k, i] = dx[k, kept[i]]
    v[:count, n_kept:] = np.dot(dx[:count], restrict.T)
    rest[first:stop] = np.dot(v[:count], back.T)
    rest[first:stop] -= np.dot(moved[:count], pull.T)
    for node in range(first, stop):
        for i in range(n_modes):
            rest[node, i] -= (
                eigenvalues[i].real * errors[node, i]
                + eigenvalues[i].imag * errors[node, partner[i]]
            )


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _solve(modes, at, rest, result, node, end, skip, place, curved):
    """W at the nodes from `node` to `end`, of which every `skip`-th is used.

    `result` has them at their places, or one after the other from 0 (`skip` above 1).
    g is constant over the window unless it is `curved`.
    """
    eigenvalues, partner, factors, lengths = modes
    n_modes = len(partner)
    here, ahead = np.zeros(n_modes), np.zeros(n_modes)
    if curved:
        _slope(at, rest, node, end, skip, here)
    row = node if skip == 1 else 0
    for k in range(node, end, skip):
        h = at[k + skip] - at[k]
        if abs(h - lengths[place]) > 1e-9 * h:
            _factors(eigenvalues, h, factors[place])
            lengths[place] = h
        if curved:
            _slope(at, rest, k + skip, end, skip, ahead)
        f = factors[place]
        for i in range(n_modes):
            p = partner[i]
            a0, a1 = result[row, i], result[row, p]
            first = k if curved else node
            g0, g1 = rest[first, i], rest[first, p]
            value = f[0, i].real * a0 + f[0, i].imag * a1 + f[1, i].real * g0 + f[1, i].imag * g1
            if curved:
                rise, other = rest[k + skip, i] - g0, rest[k + skip, p] - g1
                c1, d1 = h * here[i], h * here[p]
                c2 = 3 * rise - h * (2 * here[i] + ahead[i])
                d2 = 3 * other - h * (2 * here[p] + ahead[p])
                c3 = h * (here[i] + ahead[i]) - 2 * rise
                d3 = h * (here[p] + ahead[p]) - 2 * other
                value += f[2, i].real * c1 + f[2, i].imag * d1
                value += f[3, i].real * c2 + f[3, i].imag * d2
                value += f[4, i].real * c3 + f[4, i].imag * d3
            result[row + 1, i] = value
        here[:] = ahead
        row += 1


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _between(eigenvalues, partner, rows, found, rest, times, errors):
    """W at all rows, from that at some of them, with g along a straight line between two of these."""
    n_modes = len(partner)
    factors, known = np.empty((5, n_modes), dtype=np.complex128), -1.0
    for node in range(len(rows) - 1):
        first, last = rows[node], rows[node + 1]
        span = times[last] - times[first]
        errors[first] = found[node]
        for row in range(first, last - 1):
            h = times[row + 1] - times[row]
            if abs(h - known) > 1e-9 * h:
                _factors(eigenvalues, h, factors)
                known = h
            gone, part = (times[row] - times[first]) / span, h / span
            for i in range(n_modes):
                p = partner[i]
                rise, other = rest[node + 1, i] - rest[node, i], rest[node + 1, p] - rest[node, p]
                errors[row + 1, i] = (
                    factors[0, i].real * errors[row, i]
                    + factors[0, i].imag * errors[row, p]
                    + factors[1, i].real * (rest[node, i] + gone * rise)
                    + factors[1, i].imag * (rest[node, p] + gone * other)
                    + factors[2, i].real * part * rise
                    + factors[2, i].imag * part * other
                )
    errors[rows[-1]] = found[-1]


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _slope(at, rest, k, end, skip, slope):
    """dg/dt at the node k, by the parabola through it and its neighbours."""
    low, high = k - skip, k + skip
    if low < 0 and high > end:
        slope[:] = 0.0
        return
    if low < 0:
        low, high = k + skip, k + 2 * skip
        if high > end:
            high = low
    elif high > end:
        low, high = k - skip, k - 2 * skip
        if high < 0:
            high = low
    a, b = at[low] - at[k], at[high] - at[k]
    if low == high:
        for i in range(len(slope)):
            slope[i] = (rest[low, i] - rest[k, i]) / a
        return
    wa, wb = b / (a * (b - a)), -a / (b * (b - a))
    for i in range(len(slope)):
        slope[i] = wa * (rest[low, i] - rest[k, i]) + wb * (rest[high, i] - rest[k, i])


@jit(nogil=True, error_model="numpy", fastmath=FAST)
def _factors(eigenvalues, h, factors):
    """exp(z) and h (j - 1)! phi_j(z) for j = 1 to 4 with z = L h, for each mode."""
    for i in range(len(eigenvalues)):
        z = eigenvalues[i] * h
        factors[0, i] = np.exp(z)
        if abs(z) < _SERIES:
            phi = 0j
            for k in range(_TERMS):
                phi = 1.0 + phi * z / (4 + _TERMS - k)
            phi /= 24.0
            factors[4, i] = 6 * h * phi
            phi = 1.0 / 6 + z * phi
            factors[3, i] = 2 * h * phi
            phi = 0.5 + z * phi
            factors[2, i] = h * phi
            factors[1, i] = h * (1.0 + z * phi)
        else:
            phi = (factors[0, i] - 1.0) / z
            factors[1, i] = h * phi
            phi = (phi - 1.0) / z
            factors[2, i] = h * phi
            phi = (phi - 0.5) / z
            factors[3, i] = 2 * h * phi
            factors[4, i] = 6 * h * (phi - 1.0 / 6) / z
