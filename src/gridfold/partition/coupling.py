"""How near each external machine is to the boundary.

Each tie line is a fictitious generator of the external area: a voltage behind the tie line's impedance.
The column norms (13) of the admittances between these and the machines tell whose functions to keep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from gridfold.cards import Card, first_few
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.admittance import branch_admittances
from gridfold.grid.case import UnitKey
from gridfold.partition.areas import Partition

#: Base voltage in kV to which the paper converts thresholds, second equation (19).
THRESHOLD_BASE_KV = 20.0


@dataclass(frozen=True)
class ExternalNetwork:
    """The external area's network, with the boundary voltages as sources.

    Terminal voltages of the external machines are V = impedance @ I + transfer @ V_boundary.

    Parameters
    ----------
    impedance : ndarray of complex, shape (n_external, n_external)
        From the machines' Norton currents, by unit.
    transfer : ndarray of complex, shape (n_external, n_boundary)
        From the voltages of the study area's boundary buses.
    tie_admittance : ndarray of complex, shape (n_ties, n_external)
        Y21 of (12): current in each tie line for one volt behind each machine's reactance, or for
        the rated current of a converter, which has none.
    """

    impedance: NDArray[np.complex128]
    transfer: NDArray[np.complex128]
    tie_admittance: NDArray[np.complex128]


@dataclass(frozen=True, repr=False)
class Coupling(Card):
    """Column norms of the external machines.

    Parameters
    ----------
    units : tuple of UnitKey
        External machines.
    norms : ndarray, shape (n_external,)
        Column norm (13) of each in per unit.
    base_mva : float
        Base power of the per-unit values.
    rotors : frozenset of UnitKey
        Those of the machines that have a rotor; an infinite bus has none.
    """

    units: tuple[UnitKey, ...]
    norms: NDArray[np.float64]
    base_mva: float
    rotors: frozenset[UnitKey]

    def _facts(self) -> dict[str, object]:
        largest = sorted(zip(self.norms.tolist(), self.units, strict=True), reverse=True)
        return {
            "external machines": f"of {len(self.units)} external machines",
            "largest column norms": first_few(f"{unit} {norm:.3g}" for norm, unit in largest),
        }

    def kept(self, threshold: float) -> tuple[UnitKey, ...]:
        """Machines whose norm is at least `threshold` (p.u.): their functions stay nonlinear."""
        if not threshold >= 0:
            raise OptionError(f"the column-norm threshold must be 0 or more, not {threshold!r}")
        return tuple(u for u, norm in zip(self.units, self.norms, strict=True) if norm >= threshold)

    @property
    def reference(self) -> UnitKey | None:
        """The machine with a rotor that has the smallest norm: the reference of angle deviations.

        None where no external machine has a rotor: deviations are then those from the infinite bus,
        which turns at synchronous speed.
        """
        norms = zip(self.norms.tolist(), self.units, strict=True)
        turning = [(norm, unit) for norm, unit in norms if unit in self.rotors]
        return min(turning, key=lambda pair: pair[0])[1] if turning else None

    def siemens(self, threshold: float) -> float:
        """A threshold in per unit as an admittance in siemens at 20 kV (second equation (19))."""
        return threshold * self.base_mva / THRESHOLD_BASE_KV**2

    def per_unit(self, siemens: float) -> float:
        """A threshold in siemens at 20 kV in per unit on this system's base power."""
        return siemens * THRESHOLD_BASE_KV**2 / self.base_mva


def couple(parts: Partition) -> Coupling:
    """Column norms of all external machines."""
    admittance = external_network(parts).tie_admittance
    norms = np.sqrt((np.abs(admittance) ** 2).sum(axis=0))
    rotors = frozenset(parts.external_units) & frozenset(parts.model.machines)
    return Coupling(parts.external_units, norms, parts.model.case.base_mva, rotors)


def external_network(parts: Partition, loads: Sequence[int] = ()) -> ExternalNetwork:
    """Cut the external area's network out of the whole, at the boundary buses.

    The rows and columns of `loads`, bus numbers of the external area, follow those of the machines.
    The half of a tie line's charging at the external end stays; the far half does not matter.
    """
    model, case = parts.model, parts.model.case
    equations = model.equations
    row = {k: at for k, at in enumerate(equations.bus_rows.tolist()) if at >= 0}
    outside_buses = [k for k, b in enumerate(case.buses) if b.number not in parts.study_buses]
    outside = list(dict.fromkeys(row[k] for k in outside_buses if k in row))
    boundary = [row[case.bus_index[bus]] for bus in parts.boundary_buses]
    if len(set(boundary)) < len(boundary) or set(boundary) & set(outside):
        raise OptionError(
            "a branch without impedance joins boundary buses of the study area to each other or to the "
            "external area: give it an impedance, or put both of its buses well into one area"
        )
    matrix = equations.matrix.tocsr()
    factors = splu(matrix[outside][:, outside].tocsc())
    place = {bus: position for position, bus in enumerate(outside)}
    buses = [*(unit.bus for unit in parts.external_units), *loads]
    at = [place[row[case.bus_index[bus]]] for bus in buses]
    injected = np.zeros((len(outside), len(at)), dtype=np.complex128)
    injected[at, np.arange(len(at))] = 1.0
    from_currents = factors.solve(injected)
    from_boundary = factors.solve(-matrix[outside][:, boundary].toarray())
    ends = [place[row[case.bus_index[tie.external_bus]]] for tie in parts.tie_lines]
    given = _given_currents(model, parts.external_units)
    ties = _tie_series(parts)[:, None] * from_currents[ends, : len(given)] * given
    return ExternalNetwork(from_currents[at], from_boundary[at], ties)


def _given_currents(model: DetailedModel, units: Sequence[UnitKey]) -> NDArray[np.complex128]:
    """Current in p.u. that each unit gives for one volt behind its reactance; converters: rated."""
    case, machines = model.case, model.injections.machine
    rated = {g.key: g.base_mva / case.base_mva for g in case.generators}
    given = [machines[unit] if unit in machines else rated[unit] for unit in units]
    return np.array(given, dtype=np.complex128)


def _tie_series(parts: Partition) -> NDArray[np.complex128]:
    """Transfer admittance of each tie line from its external to its study end."""
    branches = [parts.model.case.branches[tie.branch] for tie in parts.tie_lines]
    y = branch_admittances(branches)
    starts_outside = np.array(
        [b.from_bus == t.external_bus for b, t in zip(branches, parts.tie_lines, strict=True)]
    )
    return np.where(starts_outside, y.to_from, y.from_to)
