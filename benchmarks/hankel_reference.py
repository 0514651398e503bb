"""Hankel singular values of the external area of NPCC in extended precision, for a test.

They are the square roots of the eigenvalues of Wc Wo, as in the definition: with 512 bits the digits
lost on the way do not matter, and no factors are needed. The same with fewer bits tells how many
digits are right. Needs ``pip install 'gridfold[precision]'``; takes several minutes.

Source of the doubling iteration: R. A. Smith, "Matrix Equation XA + BX = C", SIAM Journal on Applied
Mathematics 16 (1968), pp. 198-201.
"""

from __future__ import annotations

import datetime
import platform
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import flint
import numpy as np
import scipy
from flint import acb_mat, arb, arb_mat, ctx, nmod_mat
from numpy.typing import NDArray
from report import ROOT, one_thread

from gridfold import __version__, build_model, load_case
from gridfold.partition import linearize_external, partition
from gridfold.systems import LinearSystem

COMMAND = "python benchmarks/hankel_reference.py"
TARGET = ROOT / "tests" / "reduction" / "npcc_hankel_values.csv"
CASE, STUDY_BUSES = "npcc", range(1, 37)
BITS, FEWER_BITS = 512, 384
DIGITS = 20
PRIME = 2**61 - 1


@dataclass(frozen=True)
class Gramians:
    """Both Gramians, doubling steps, and residuals of the Lyapunov equations.

    A residual is the largest entry of A W + W A^T + B B^T over the largest of A W.
    """

    controllability: arb_mat
    observability: arb_mat
    steps: int
    residuals: tuple[float, float]


@dataclass(frozen=True)
class Reference:
    """Hankel singular values in falling order, and the Gramians they come from."""

    values: list[arb]
    gramians: Gramians

    @property
    def rank(self) -> int:
        """Number of values above rounding."""
        return sum(value > 0 for value in self.values)


def hankel_values(a: arb_mat, b: arb_mat, c: arb_mat, shift: arb) -> Reference:
    """Hankel singular values of a stable system at the present precision.

    Eigenvalues that do not stand above rounding give the value zero.
    """
    gramians = solve_lyapunov(a, b, c, shift)
    product = acb_mat(_product(gramians.controllability, gramians.observability))
    squares = sorted((e.real.mid() for e in product.eig(algorithm="approx")), key=_by_size)
    rounding = squares[0] * arb(2) ** (-7 * ctx.prec // 8)
    values = [square.sqrt() if square > rounding else arb(0) for square in squares]
    reference = Reference(values, gramians)
    _say(f"{len(values)} eigenvalues, {reference.rank} of them above rounding")
    return reference


def solve_lyapunov(a: arb_mat, b: arb_mat, c: arb_mat, shift: arb) -> Gramians:
    """Gramians by Smith's doubling iteration on the bilinear transform of the system.

    With M = (s I - A)^-1 (s I + A) the equations are Wc = M Wc M^T + 2 s G G^T, G = (s I - A)^-1 B,
    and the like for Wo: sums over powers of M, whose terms are doubled in every step.
    """
    one = arb_mat(a.nrows(), a.nrows(), 1)
    inverse = (one * shift - a).inv().mid()
    power = _product(inverse, one * shift + a)
    reached, seen = _product(inverse, b), _product(c, inverse)
    wc = _product(reached, reached.transpose() * (2 * shift))
    wo = _product(seen.transpose(), seen * (2 * shift))
    steps, change = 0, 1.0
    while change > 2.0**-ctx.prec:
        more_wc = _product(power, wc, power.transpose())
        more_wo = _product(power.transpose(), wo, power)
        wc, wo, power = (wc + more_wc).mid(), (wo + more_wo).mid(), _product(power, power)
        steps, change = steps + 1, max(_ratio(more_wc, wc), _ratio(more_wo, wo))
        _say(f"doubling step {steps}: change {change:.1e}")
    at, bt, ct = a.transpose(), b.transpose(), c.transpose()
    residuals = (
        _ratio(a * wc + wc * at + b * bt, a * wc),
        _ratio(at * wo + wo * a + ct * c, at * wo),
    )
    return Gramians(wc, wo, steps, residuals)


def reachable_dimension(system: LinearSystem) -> int:
    """Rank of [B, AB, A^2 B, ...] in exact arithmetic modulo a prime.

    Doubles are fractions, so each has a residue. The rank can only come out too small; the number
    of Hankel singular values above rounding has to agree with it.
    """
    a, block = _residues(system.a), _residues(system.b)
    entries: list[flint.nmod] = []
    for _ in range(system.n):
        entries += block.transpose().entries()
        block = a * block
    krylov = nmod_mat(system.n * system.m, system.n, [int(entry) for entry in entries], PRIME)
    return int(krylov.rank())


def check_on_known_values() -> float:
    """Largest relative error for a system whose values are known, over 33 decades and a zero.

    A symmetric system with a_ij = -b_i b_j / (sigma_i + sigma_j) and c = b^T is balanced with the
    values sigma. A state that no input reaches is added, and all are mixed.
    """
    known = [arb(10) ** (-3 * i) for i in range(12)]
    n = len(known) + 1
    b = [(2 * value).sqrt().mid() for value in known]
    a, column = arb_mat(n, n), arb_mat(n, 1)
    for i, value in enumerate(known):
        column[i, 0] = b[i]
        for j, other in enumerate(known):
            a[i, j] = -b[i] * b[j] / (value + other)
    a[n - 1, n - 1] = -1
    rng = np.random.default_rng(0)
    mix = _exact(np.eye(n) + 0.3 * rng.normal(size=(n, n)) / np.sqrt(n))
    back = mix.inv()
    found = hankel_values(
        _product(mix, a, back), _product(mix, column), _product(column.transpose(), back), arb(1)
    ).values
    if found[-1] != 0:
        raise ArithmeticError("the state that no input reaches has a Hankel singular value")
    return _relative_difference(found[:-1], known)


def best_shift(poles: NDArray[np.complex128]) -> float:
    """The shift for which the powers of the bilinear transform fall fastest."""
    shifts = np.geomspace(np.abs(poles).min(), np.abs(poles).max(), 200)
    radii = np.abs((shifts[:, None] + poles) / (shifts[:, None] - poles)).max(axis=1)
    return float(shifts[np.argmin(radii)])


def main() -> None:
    """Compute the values twice, compare, and write the file."""
    case = load_case(CASE)
    system = linearize_external(partition(build_model(case), STUDY_BUSES)).system
    reachable = reachable_dimension(system)
    _say(f"{reachable} of {system.n} states can be reached")
    with ctx.workprec(BITS):
        known = check_on_known_values()
        reference = _of_system(system)
    with ctx.workprec(FEWER_BITS):
        rough = _of_system(system)
    if not reference.rank == rough.rank == reachable:
        raise ArithmeticError("too few bits to tell the smallest values from rounding")
    with ctx.workprec(BITS):
        difference = _relative_difference(rough.values[:reachable], reference.values[:reachable])
    residuals = " and ".join(f"{residual:.1e}" for residual in reference.gramians.residuals)
    header = (
        f"Hankel singular values of the external area of {CASE}, study area buses "
        f"{STUDY_BUSES[0]}-{STUDY_BUSES[-1]}, all states as outputs.",
        f"Command: {COMMAND}",
        f"Date: {datetime.date.today().isoformat()}",
        "Method: square roots of the eigenvalues of the product of the Gramians, which are found by "
        f"{reference.gramians.steps} doubling steps.",
        f"Precision: {BITS} bits, rounded to {DIGITS} digits.",
        f"Residuals of the Lyapunov equations, largest entry over that of A W: {residuals}.",
        f"Largest relative difference from the same with {FEWER_BITS} bits: {difference:.1e}.",
        f"Largest relative error for a system with known values over 33 decades: {known:.1e}.",
        f"The inputs reach {reachable} of {system.n} states (exact rank); the other values are zero.",
        f"Fingerprint of the case: {case.fingerprint}",
        f"Versions: python-flint {flint.__version__}, FLINT {flint.__FLINT_VERSION__}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}, Python {platform.python_version()}, "
        f"gridfold {__version__}.",
    )
    _write(header, reference.values)


def _of_system(system: LinearSystem) -> Reference:
    _say(f"values of the external area with {ctx.prec} bits")
    shift = arb(best_shift(system.poles))
    return hankel_values(_exact(system.a), _exact(system.b), _exact(system.c), shift)


def _write(header: Iterable[str], values: Iterable[arb]) -> None:
    lines = [f"# {line}" for line in header]
    lines.append("number,value")
    lines += [
        f"{number},{value.str(DIGITS, radius=False)}" for number, value in enumerate(values, 1)
    ]
    TARGET.write_text("\n".join(lines) + "\n", encoding="utf-8")
    _say(f"wrote {TARGET.relative_to(ROOT)}")


def _exact(matrix: NDArray[np.float64]) -> arb_mat:
    rows, columns = matrix.shape
    return arb_mat(rows, columns, [float(value) for value in matrix.ravel()])


def _residues(matrix: NDArray[np.float64]) -> nmod_mat:
    fractions = (float(value).as_integer_ratio() for value in matrix.ravel())
    residues = [p * pow(q, -1, PRIME) % PRIME for p, q in fractions]
    rows, columns = matrix.shape
    return nmod_mat(rows, columns, residues, PRIME)


def _product(*matrices: arb_mat) -> arb_mat:
    """Product rounded to the midpoints: error bounds would only grow from step to step."""
    return reduce(lambda left, right: (left * right).mid(), matrices)


def _ratio(matrix: arb_mat, base: arb_mat) -> float:
    """Largest entry of one matrix over that of another."""
    return float(_largest(matrix) / _largest(base))


def _largest(matrix: arb_mat) -> arb:
    return max(abs(entry) for entry in matrix.mid().entries())


def _relative_difference(values: list[arb], base: list[arb]) -> float:
    return max(float(abs(v / w - 1).mid()) for v, w in zip(values, base, strict=True))


def _by_size(value: arb) -> arb:
    return -value


def _say(text: str) -> None:
    print(f"{time.perf_counter() - _BEGAN:6.0f} s  {text}", flush=True)


_BEGAN = time.perf_counter()

if __name__ == "__main__":
    one_thread()
    main()
