"""Compress a large sparse system to a dense one with the same transfer matrix.

Two-sided tangential rational interpolation. A sample at j omega solves (j omega I - A) X = B and
measures the error E = C X - G_k of what there is. Its singular vectors with values above the
tolerance are the directions in which the bases may grow, V by X z_i and W by
(j omega I - A)^-H C^T u_i. Of all directions of a round of samples those with the largest Hankel
singular values are taken. Where to sample next is told by the difference between the last two models
and by the gaps between samples. Unstable modes are split off exactly.

Source: K. Gallivan, A. Vandendorpe, P. Van Dooren, "Model Reduction of MIMO Systems via Tangential
Interpolation", SIAM Journal on Matrix Analysis and Applications 26 (2004), pp. 328-349.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.spectral_split import STABILITY_MARGIN, InvariantPart
from gridfold.reduction.petrov import Bases, real_columns
from gridfold.reduction.sampling import Spectrum, first_points, next_points, widths
from gridfold.reduction.true_modes import no_part, refined, stable_rest
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]

#: Part of the tolerance below which a direction of the error is left alone.
_LEFT_ALONE = 0.3

#: Hankel singular value of the error, in parts of the tolerance, below which the bases do not grow.
_DROPPED = 0.02

#: Tolerance at which unstable modes are looked for first.
_COARSE = 0.1

#: Rounds of samples; and times that unstable modes may come up.
_ROUNDS, _PASSES = 40, 6

#: Relative error that is accepted where rounding leaves no better one.
_ROUNDING = 1e-8


@dataclass(frozen=True, eq=False)
class Compressed:
    """A system as the sum of an exact unstable part and a small stable part.

    Parameters
    ----------
    whole : DescriptorSystem
        What was compressed.
    unstable, stable : InvariantPart
        The unstable or marginal modes, true ones of the whole, and the projected rest.
    error : float
        Largest error of the transfer matrix at the last samples, in parts of its size.
    """

    whole: DescriptorSystem
    unstable: InvariantPart
    stable: InvariantPart
    error: float

    @property
    def system(self) -> LinearSystem:
        """The compressed system of k states, the unstable modes first."""
        kept, rest, whole = self.unstable, self.stable, self.whole
        a = np.zeros((kept.order + rest.order,) * 2)
        a[: kept.order, : kept.order] = kept.matrix
        a[kept.order :, kept.order :] = rest.matrix
        return LinearSystem(
            a, self.restrict @ whole.b, whole.c @ self.lift,
            input_names=whole.input_names, output_names=whole.output_names,
        )  # fmt: skip

    @property
    def lift(self) -> Matrix:
        """From states of the compressed system to full ones, shape (n, k)."""
        return np.hstack([self.unstable.lift, self.stable.lift])

    @property
    def restrict(self) -> Matrix:
        """From full states to those of the compressed system, shape (k, n); restrict lift = I."""
        return np.vstack([self.unstable.restrict, self.stable.restrict])


@one_blas_thread
def compress(system: DescriptorSystem, tolerance: float = 1e-10) -> Compressed:
    """Find a small system whose transfer matrix is that of `system` on the imaginary axis.

    An unstable mode that the inputs do not reach or the outputs do not see is no part of the
    transfer matrix, and is left out.

    Parameters
    ----------
    system : DescriptorSystem
    tolerance : float
        Largest error of the transfer matrix of the stable part, in parts of its largest value. No
        Hankel singular value is off by more.

    Raises
    ------
    OptionError
        If the tolerance is not between 0 and 1, or is not reached.
    """
    if not 0 < tolerance < 1:
        raise OptionError(f"the tolerance of a compression must be between 0 and 1: {tolerance}")
    limit = -STABILITY_MARGIN * system.radius
    exact, bases, wanted = no_part(system.n), Bases.empty(system), max(tolerance, _COARSE)
    for _ in range(_PASSES):
        bases, spectrum, error = _converged(bases, wanted)
        more = refined(system, bases, spectrum.values, limit, exact)
        if more.order > exact.order:
            exact = more
            bases = bases.without(exact)
        elif wanted == tolerance:
            return _together(system, exact, stable_rest(bases, spectrum, limit), error)
        wanted = tolerance
    raise OptionError("the unstable modes of a large system were not found")


def _together(
    system: DescriptorSystem, unstable: InvariantPart, stable: InvariantPart, error: float
) -> Compressed:
    """Both parts, with restrict lift = I to rounding."""
    lift = np.hstack([unstable.lift, stable.lift])
    restrict = np.vstack([unstable.restrict, stable.restrict])
    restrict = np.asarray(np.linalg.solve(restrict @ lift, restrict), dtype=np.float64)
    first, rest = restrict[: unstable.order], restrict[unstable.order :]
    return Compressed(
        system,
        InvariantPart(unstable.matrix, unstable.lift, first),
        InvariantPart(stable.matrix, stable.lift, rest),
        error,
    )


def _converged(bases: Bases, tolerance: float) -> tuple[Bases, Spectrum, float]:
    """Sample until nothing above the tolerance is found where it is to be expected, and elsewhere."""
    radius = bases.system.radius
    now, size = Spectrum.of(bases.reduced()), 0.0
    points, sampled = first_points(radius), np.zeros(0)
    for _ in range(_ROUNDS):
        sampled = np.append(sampled, points)
        grown, size, error = _sampled(bases, now, points, size, tolerance)
        before, bases, same = now, grown, grown.k == bases.k
        now = now if same else Spectrum.of(bases.reduced())
        if error <= tolerance * size and len(sampled) > len(points):
            return bases, now, error / size if size else 0.0
        if same and error > tolerance * size:
            if error > max(tolerance, _ROUNDING) * size:
                break
            return bases, now, error / size
        points = next_points(now, before, sampled, radius, tolerance * size)
    raise OptionError(
        f"a large system was not compressed to {tolerance:g}: the error is {error / size:.1e}"
    )


def _sampled(
    bases: Bases, model: Spectrum, points: Matrix, size: float, tolerance: float
) -> tuple[Bases, float, float]:
    """Bases after samples at `points` in rad/s, size of the transfer matrix, largest error."""
    worst, reached, duals = 0.0, [], []
    for omega, width, known in zip(points, widths(points), model.response(points), strict=True):
        resolvent = bases.system.at(1j * omega)
        states = resolvent.solve(bases.b)
        response = bases.c @ states
        size = max(size, float(np.linalg.norm(response, 2)))
        left, errors, right = np.linalg.svd(response - known)
        count = int(np.count_nonzero(errors > _LEFT_ALONE * tolerance * size))
        worst = max(worst, float(errors[0]) if len(errors) else 0.0)
        if count:
            weight = np.sqrt(width / np.pi)
            dual = resolvent.solve_adjoint(bases.c.T @ left[:, :count])
            duals.append(real_columns(weight * dual))
            reached.append(real_columns(weight * (states @ right[:count].conj().T)))
    if not duals:
        return bases, size, worst
    x, y, level = np.hstack(reached), np.hstack(duals), _DROPPED * tolerance * size
    grown = bases.extended(x, y, level)
    if grown.k == bases.k:
        grown = bases.extended(x, y)
    return (grown if grown.k > bases.k else bases.united(x, y)), size, worst
