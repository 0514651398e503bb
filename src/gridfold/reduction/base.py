"""The contract of reducers, and what all of them share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from gridfold.errors import OptionError
from gridfold.numerics.spectral_split import InvariantPart, split_spectrum
from gridfold.reduction.krylov import compress
from gridfold.reduction.petrov import SpannedPart
from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem
from gridfold.systems.statemap import StateMap

Matrix = NDArray[np.float64]

#: Error of the transfer matrix of a compressed system, in parts of its size: Hankel singular values
#: are right to less than 1e-8 of the first.
COMPRESSION = 2e-9


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced linear system and the way back to full states.

    Parameters
    ----------
    system : LinearSystem
        The reduced system; inputs and outputs are those of the full one.
    state_map : StateMap
        x = x0 + T~ z and z = T (x - x0). Unstable or marginal modes come first in z.
    hankel_values : ndarray or None
        Hankel singular values of the stable part, all of them, in descending order; None if the
        method does not compute them.
    bound : float or None
        Upper limit of the H-infinity norm of the error of the transfer matrix, equation (6) of
        Osipov & Sun; None if the method has none.
    kept_exactly : int
        Number of states of unstable or marginal modes, which no method truncates.
    """

    system: LinearSystem
    state_map: StateMap
    hankel_values: Matrix | None
    bound: float | None
    kept_exactly: int

    @property
    def order(self) -> int:
        """Number of states of the reduced system."""
        return self.system.n


class Reducer(Protocol):
    """A method of linear reduction; its options are its fields."""

    def reduce(self, system: LinearSystem, reference: Matrix) -> Reduction:
        """Reduce `system`, whose states are deviations from `reference`, shape (n,).

        Those of this package take a DescriptorSystem as well.
        """


@dataclass(frozen=True, eq=False)
class Parts:
    """A system as the sum of its unstable or marginal part and its stable part."""

    whole: LinearSystem | DescriptorSystem
    unstable: InvariantPart
    stable: InvariantPart | SpannedPart

    @classmethod
    def of(cls, system: LinearSystem | DescriptorSystem) -> Parts:
        """Split `system`; of a large one the stable part is compressed."""
        if isinstance(system, DescriptorSystem):
            found = compress(system, COMPRESSION)
            return cls(system, found.unstable, found.stable)
        return cls(system, *split_spectrum(system.a))

    @property
    def kept(self) -> int:
        """Number of states that are kept exactly."""
        return self.unstable.order

    @property
    def stable_system(self) -> LinearSystem:
        """The stable part on its own, without feed-through."""
        part = self.stable
        return LinearSystem(part.matrix, part.coordinates(self.whole.b), part.outputs(self.whole.c))

    def join(self, reduced: LinearSystem, lift: Matrix, restrict: Matrix) -> _Joined:
        """Put the kept part and the `reduced` stable part together again.

        `lift` and `restrict` map between the states of the stable part and those of `reduced`. The
        two parts do not see each other, so the joint A is block-diagonal.
        """
        kept, whole = self.unstable, self.whole
        full_lift = np.hstack([kept.lift, self.stable.states(lift)])
        full_restrict = np.vstack([kept.restrict, self.stable.rows(restrict)])
        full_restrict = np.linalg.solve(full_restrict @ full_lift, full_restrict)
        system = LinearSystem(
            linalg.block_diag(kept.matrix, reduced.a) if kept.order else reduced.a,
            np.vstack([kept.restrict @ whole.b, reduced.b]),
            np.hstack([whole.c @ kept.lift, reduced.c]),
            whole.d + reduced.d,
            tuple(f"z{i + 1}" for i in range(kept.order + reduced.n)),
            whole.input_names,
            whole.output_names,
        )
        return _Joined(system, full_lift, full_restrict)


@dataclass(frozen=True, eq=False)
class _Joined:
    system: LinearSystem
    lift: Matrix
    restrict: Matrix

    def map_from(self, reference: Matrix) -> StateMap:
        """The state map with its origin at `reference`, shape (n,)."""
        return StateMap(reference, self.lift, self.restrict)


def check_order(order: int, system: LinearSystem | DescriptorSystem, kept: int) -> None:
    """Raise OptionError unless kept <= `order` <= n.

    Parameters
    ----------
    order : int
        Number of states asked for.
    system : LinearSystem
        The system to be reduced.
    kept : int
        Number of states that cannot be left out.
    """
    if order > system.n:
        raise OptionError(f"order {order} of the reduced system exceeds the {system.n} states")
    if order < kept:
        raise OptionError(
            f"order {order} is below the {kept} states of unstable or marginal modes, "
            "which are always kept"
        )
