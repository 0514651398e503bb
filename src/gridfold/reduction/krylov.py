"""Compress a large sparse system to a dense one with the same transfer matrix.

Two-sided tangential rational interpolation. A sample at j omega solves (j omega I - A) X = B and
measures the error E = C X - G_k of what there is. Its singular vectors with values above the
tolerance are the directions in which the bases may grow, V by X z_i and W by
(j omega I - A)^-H C^T u_i. Of all directions of all samples those with the largest Hankel singular
values are taken. Where to sample next is told by the difference between the last two models and by
the gaps between samples. Unstable modes are split off exactly.

Source: K. Gallivan, A. Vandendorpe, P. Van Dooren, "Model Reduction of MIMO Systems via Tangential
Interpolation", SIAM Journal on Matrix Analysis and Applications 26 (2004), pp. 328-349.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from gridfold.errors import OptionError
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.spectral_split import STABILITY_MARGIN, InvariantPart
from gridfold.reduction.petrov import Bases, Directions, SpannedPart, reals
from gridfold.reduction.sampling import Spectrum, first_points, next_points, widths
from gridfold.reduction.true_modes import no_part, refined, stable_rest
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem

Matrix = NDArray[np.float64]
ComplexMatrix = NDArray[np.complex128]

#: Part of the tolerance below which a direction of the error is left alone.
_LEFT_ALONE = 0.3

#: Hankel singular value of the error, in parts of the tolerance, below which the bases do not grow.
_DROPPED = 0.02

#: Tolerance at which unstable modes are looked for first, with so many inputs and outputs.
_COARSE, _FEW = 0.1, 5

#: Rounds of samples; and times that unstable modes may come up.
_ROUNDS, _PASSES = 40, 6

#: Relative error that is accepted where rounding leaves no better one; and rounds in which bases do not
#: grow before it is.
_ROUNDING, _IDLE = 1e-8, 3


@dataclass(frozen=True, eq=False)
class Compressed:
    """A system as the sum of an exact unstable part and a small stable part.

    Parameters
    ----------
    whole : DescriptorSystem
        What was compressed.
    unstable : InvariantPart
        The unstable or marginal modes, true ones of the whole.
    stable : SpannedPart
        The projected rest.
    error : float
        Largest error of the transfer matrix at the last samples, in parts of its size.
    """

    whole: DescriptorSystem
    unstable: InvariantPart
    stable: SpannedPart
    error: float

    @property
    def system(self) -> LinearSystem:
        """The compressed system of k states, the unstable modes first."""
        kept, rest, whole = self.unstable, self.stable, self.whole
        return LinearSystem(
            block_diag(kept.matrix, rest.matrix),
            np.vstack([kept.coordinates(whole.b), rest.coordinates(whole.b)]),
            np.hstack([kept.outputs(whole.c), rest.outputs(whole.c)]),
            input_names=whole.input_names, output_names=whole.output_names,
        )  # fmt: skip


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
    exact, wanted = no_part(system.n), max(tolerance, _COARSE)
    for _ in range(_PASSES):
        few = None if wanted == tolerance else _FEW
        bases, spectrum, error = _converged(Bases.empty(system, exact, few), wanted)
        more = refined(system, bases, spectrum.values, limit, exact)
        if more.order > exact.order:
            exact = more
        elif wanted == tolerance:
            return Compressed(system, exact, stable_rest(bases, spectrum, limit), error)
        wanted = tolerance
    raise OptionError("the unstable modes of a large system were not found")


def _converged(bases: Bases, tolerance: float) -> tuple[Bases, Spectrum, float]:
    """Sample until nothing above the tolerance is found where it is to be expected, and elsewhere."""
    radius = bases.system.radius
    now, size = Spectrum.of(bases.reduced), 0.0
    points, sampled, idle = first_points(radius), np.zeros(0), 0
    for _ in range(_ROUNDS):
        sampled = np.append(sampled, points)
        grown, size, error = _sampled(bases, now, points, size, tolerance)
        idle = 0 if grown.k > bases.k else idle + 1
        before, now = now, now if grown is bases else Spectrum.of(grown.reduced)
        bases, accepted = grown, tolerance if idle < _IDLE else max(tolerance, _ROUNDING)
        if error <= accepted * size and len(sampled) > len(points):
            return bases, now, error / size if size else 0.0
        points = next_points(now, before, sampled, radius, tolerance * size)
    raise OptionError(
        f"a large system was not compressed to {tolerance:g}: the error is {error / size:.1e}"
    )


def _sampled(
    bases: Bases, model: Spectrum, points: Matrix, size: float, tolerance: float
) -> tuple[Bases, float, float]:
    """Bases after samples at `points` in rad/s, size of the transfer matrix, largest error."""
    worst = 0.0
    found: list[tuple[Directions, ComplexMatrix, ComplexMatrix]] = []
    for omega, width, known in zip(points, widths(points), model.response(points), strict=True):
        resolvent = bases.system.at(1j * omega)
        states = resolvent.solve(bases.b)
        response = (bases.c @ reals(states)).view(np.complex128)
        size = max(size, float(np.linalg.norm(response, 2)))
        left, errors, right = np.linalg.svd(response - known)
        count = int(np.count_nonzero(errors > _LEFT_ALONE * tolerance * size))
        worst = max(worst, float(errors[0]) if len(errors) else 0.0)
        if count:
            weight = np.sqrt(width / np.pi)
            u, z = weight * left[:, :count], weight * right[:count].conj().T
            dual = resolvent.solve_adjoint(bases.c.T @ u)
            found.append((Directions.at(1j * omega, response, u, z), states @ z, dual))
    if not found:
        return bases, size, worst
    new, x, y = zip(*found, strict=True)
    samples = Directions.joined(*new), np.hstack(x), np.hstack(y)
    return bases.extended(*samples, _DROPPED * tolerance * size), size, worst
