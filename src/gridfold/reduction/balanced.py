"""Balanced truncation and balanced singular perturbation.

Equations are numbered as in Osipov & Sun. Both methods share the projection; they differ in what
they do with the states that are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.gramians import gramian_factors
from gridfold.reduction.base import Parts, Reduction
from gridfold.reduction.order import OrderRule, numerical_rank
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem
from gridfold.systems.statemap import StateMap

Matrix = NDArray[np.float64]

#: Part of the size of a state below which what a reduced system lacks of it is rounding.
_KNOWN = 1e-10


@dataclass(frozen=True)
class BalancedTruncation:
    """Balanced truncation: leave out the states that are weakly controllable and observable.

    Equations (4) to (9), by the square-root method in its balancing-free form: the reduced states
    span the same subspaces as the balanced ones of (7), but have an orthonormal lift matrix T~.
    The transfer matrix is the same, and T T~ = I holds to rounding even where the Hankel
    singular values kept span many decades. Give exactly one of the two options.

    Source: A. Varga, "Efficient Minimal Realization Procedure Based on Balancing", IMACS Symposium
    on Modelling and Control of Technological Systems (1991), vol. 2, pp. 42-47.

    Parameters
    ----------
    tolerance : float, optional
        The order is the smallest for which the bound (6) does not exceed it. In units of output
        per input; unstable and marginal modes are kept besides.
    order : int, optional
        Number of states of the reduced system, with unstable and marginal modes.
    slow_modes : float, optional
        Modes of a whole grid that decay more slowly than this (1/s), or grow, stay exact: whoever
        reduces an area of it gives their states to :meth:`reduce`. They are kept besides.

    Raises
    ------
    OptionError
        If not exactly one option is given, or it is not positive; in :meth:`reduce`, if the order
        exceeds the number of states that stand above rounding, or is below that of unstable modes.
    """

    tolerance: float | None = None
    order: int | None = None
    slow_modes: float | None = None

    def __post_init__(self) -> None:
        OrderRule(self.tolerance, self.order)
        if self.slow_modes is not None and not 0 < self.slow_modes < np.inf:
            raise OptionError(
                f"the decay of slow modes must be a positive number of 1/s, not {self.slow_modes}"
            )

    @one_blas_thread
    def reduce(
        self,
        system: LinearSystem | DescriptorSystem,
        reference: Matrix,
        include: Matrix | None = None,
    ) -> Reduction:
        """Reduce `system`, whose states are deviations from `reference`, shape (n,).

        Deviations `include`, shape (n, k), are states of the reduced system too, besides those of
        the order. The projection then is the one that is orthogonal in x^T Wo x, as that of
        balanced truncation itself: a stable system stays stable, but (6) is no bound any more.

        A DescriptorSystem is compressed first. What no output sees of `include` joins the lift
        matrix without a state of its own.
        """
        rule = OrderRule(self.tolerance, self.order)
        return BalancedSystem.of(system).truncated(rule, reference, include)


@dataclass(frozen=True, eq=False)
class BalancedSystem:
    """A system that is balanced once, to be truncated to several orders.

    Build it with :meth:`of`.
    """

    system: LinearSystem | DescriptorSystem
    parts: Parts
    balance: _Balance

    @classmethod
    @one_blas_thread
    def of(cls, system: LinearSystem | DescriptorSystem) -> BalancedSystem:
        """Balance `system`."""
        parts = Parts.of(system)
        return cls(system, parts, _balance(parts.stable_system))

    @one_blas_thread
    def truncated(
        self, rule: OrderRule, reference: Matrix, include: Matrix | None = None
    ) -> Reduction:
        """Truncate it; `reference` and `include` as in :meth:`BalancedTruncation.reduce`."""
        parts, balance, stable = self.parts, self.balance, self.parts.stable_system
        r = rule.choose(balance.values, self.system, parts.kept)
        lift, restrict = balance.projection(slice(0, r))
        if include is not None:
            lift, restrict = balance.extended(lift, restrict, parts.stable.coordinates(include))
        reduced = LinearSystem(restrict @ stable.a @ lift, restrict @ stable.b, stable.c @ lift)
        found = _finish(parts, reduced, lift, restrict, balance.values, reference)
        if include is not None:
            found = replace(found, state_map=_reaching(found.state_map, include))
        return found if reduced.n == r else replace(found, bound=None)


@dataclass(frozen=True)
class SingularPerturbation:
    """Balanced singular perturbation: the weak states follow the strong ones at once.

    The states that balanced truncation leaves out are set to their steady values instead,
    0 = A21 z1 + A22 z2 + B2 u. The DC gain is exact, and the bound (6) holds too; the price is
    a feed-through D. The lift matrix of the state map is that for u = 0: the part of the full
    state that follows an input at once is in the outputs only, through D. Options and errors
    as for :class:`BalancedTruncation`.

    Source: Y. Liu, B. D. O. Anderson, "Singular Perturbation Approximation of Balanced Systems",
    International Journal of Control 50 (1989), pp. 1379-1405.
    """

    tolerance: float | None = None
    order: int | None = None

    def __post_init__(self) -> None:
        OrderRule(self.tolerance, self.order)

    @one_blas_thread
    def reduce(self, system: LinearSystem | DescriptorSystem, reference: Matrix) -> Reduction:
        """Reduce `system`, whose states are deviations from `reference`, shape (n,)."""
        parts = Parts.of(system)
        stable = parts.stable_system
        balance = _balance(stable)
        r = OrderRule(self.tolerance, self.order).choose(balance.values, system, parts.kept)
        lift, restrict = balance.all_states(r)
        a, b = restrict @ stable.a @ lift, restrict @ stable.b
        try:
            slave = -np.linalg.solve(a[r:, r:], np.hstack([a[r:, :r], b[r:]]))
        except np.linalg.LinAlgError:
            raise OptionError(
                f"the states left out at order {r + parts.kept} have no steady value; "
                "choose another order"
            ) from None
        follow, jump = slave[:, :r], slave[:, r:]
        full_lift = lift[:, :r] + lift[:, r:] @ follow
        reduced = LinearSystem(
            a[:r, :r] + a[:r, r:] @ follow,
            b[:r] + a[:r, r:] @ jump,
            stable.c @ full_lift,
            stable.c @ lift[:, r:] @ jump,
        )
        return _finish(parts, reduced, full_lift, restrict[:r], balance.values, reference)


@dataclass(frozen=True, eq=False)
class _Balance:
    """Gramian factors of a stable system and the decomposition Lo^T Lc = U diag(values) V^T."""

    reachable: Matrix
    observable: Matrix
    left: Matrix
    values: Matrix
    right: Matrix

    def projection(self, block: slice) -> tuple[Matrix, Matrix]:
        """Lift (n, k) and restrict (k, n) matrix of the balanced states in `block`.

        Lc V spans the balanced states, Lo U their duals; both are made orthonormal first.
        """
        lift = np.linalg.qr(self.reachable @ self.right[:, block])[0]
        dual = np.linalg.qr(self.observable @ self.left[:, block])[0]
        restrict: Matrix = np.linalg.solve(dual.T @ lift, dual.T)
        return lift, restrict

    def extended(self, lift: Matrix, restrict: Matrix, include: Matrix) -> tuple[Matrix, Matrix]:
        """The maps of :meth:`projection`, with the states `include` (n, k) in the lift's range."""
        rest = include
        for _ in range(2):  # the second time for what rounding has left
            rest = rest - lift @ (restrict @ rest)
        left, sizes, _ = np.linalg.svd(rest, full_matrices=False)
        new = left[:, sizes > _KNOWN * np.linalg.norm(include)]
        dual = self.observable @ (self.observable.T @ new)
        dual -= restrict.T @ (lift.T @ dual)
        try:
            restrict_new = np.linalg.solve(dual.T @ new, dual.T)
        except np.linalg.LinAlgError:
            raise OptionError("a state to be included has no effect on any output") from None
        return np.hstack([lift, new]), np.vstack([restrict, restrict_new])

    def all_states(self, r: int) -> tuple[Matrix, Matrix]:
        """Lift and restrict matrix of all states above rounding, the first `r` in front."""
        rank = numerical_rank(self.values)
        strong, weak = self.projection(slice(0, r)), self.projection(slice(r, rank))
        lift: Matrix = np.hstack([strong[0], weak[0]])
        restrict: Matrix = np.vstack([strong[1], weak[1]])
        corrected = np.linalg.solve(restrict @ lift, restrict)
        return lift, np.asarray(corrected, dtype=np.float64)


def _reaching(states: StateMap, include: Matrix) -> StateMap:
    """The state map with the states `include` (n, k) in the range of its lift matrix.

    Of x - T~ T x, which a compressed system does not have, no output sees anything. With Z = T x,
    T~ + (x - T~ T x) Z^+ gives x back and leaves T T~ = I.
    """
    lift, restrict = states.lift_matrix, states.restrict_matrix
    z = restrict @ include
    missing = include - lift @ z
    for _ in range(2):  # the second time for what rounding has left
        missing = missing - lift @ (restrict @ missing)
    if np.linalg.norm(missing) <= _KNOWN * np.linalg.norm(include):
        return states
    return replace(states, lift_matrix=lift + missing @ np.linalg.pinv(z, rcond=_KNOWN))


def _balance(stable: LinearSystem) -> _Balance:
    if stable.n == 0:
        nothing = np.zeros((0, 0))
        return _Balance(nothing, nothing, nothing, np.zeros(0), nothing)
    reachable, observable = gramian_factors(stable.a, stable.b, stable.c)
    left, values, right = np.linalg.svd(observable.T @ reachable)
    return _Balance(reachable, observable, left, values, right.T)


def _finish(
    parts: Parts,
    reduced: LinearSystem,
    lift: Matrix,
    restrict: Matrix,
    values: Matrix,
    reference: Matrix,
) -> Reduction:
    joined = parts.join(reduced, lift, restrict)
    bound = 2 * float(values[reduced.n :].sum())
    return Reduction(joined.system, joined.map_from(reference), values, bound, parts.kept)
