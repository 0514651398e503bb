"""What is fastest in a model: modes that bound an explicit step, and the quickest swing of a rotor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from gridfold.dynamics.jacobian import Partials
from gridfold.dynamics.layout import Layout
from gridfold.errors import InitializationError
from gridfold.numerics.blas import one_blas_thread

#: How many of the fastest modes are looked at.
_COUNT = 6
#: States below which all eigenvalues are computed.
_DENSE = 200
#: Accuracy, size of the basis and patience of the iteration above; the second row where eigenvalues lie
#: so close together that the first does not end.
_TRIES = ((1e-6, 20, 100), (1e-2, 40, 30))
#: States up to which units are joined by the network; above, each is looked at alone, at constant
#: voltage: what is fastest is at home in one unit.
JOINED = 10_000
#: Products with which the fastest swing is found, to a few percent.
_PRODUCTS = 40


@dataclass(frozen=True)
class Mode:
    """A mode of the linearized model and where it is at home.

    Parameters
    ----------
    eigenvalue : complex
        In 1/s and rad/s; of a pair the one with the positive imaginary part.
    state : str
        ``name:BUS:ID`` of the state with the largest participation factor.
    device : str
        The device model that has this state.
    """

    eigenvalue: complex
    state: str
    device: str

    @property
    def value(self) -> str:
        """The eigenvalue for people."""
        real, imag = _three_digits(self.eigenvalue.real), _three_digits(self.eigenvalue.imag)
        return f"{real} 1/s" if self.eigenvalue.imag == 0 else f"{real} ± {imag}j 1/s"

    def __str__(self) -> str:
        name, _, unit = self.state.partition(":")
        return f"mode {self.value} in {name} of {self.device} {unit}"


@dataclass(frozen=True)
class FastModes:
    """What is fastest in the linearized model.

    Parameters
    ----------
    modes : tuple of Mode
        The largest eigenvalues by magnitude, the fastest first, about six.
    swing_period : float
        Period in s of the fastest swing of the rotors against each other with all other states held;
        infinite where none is held back.
    """

    modes: tuple[Mode, ...] = ()
    swing_period: float = math.inf


@one_blas_thread
def find_fast_modes(
    partials: Partials, network: NDArray[np.float64] | None, layout: Layout, count: int = _COUNT
) -> FastModes:
    """The fastest modes of a model from its slopes and those of its network.

    Without a network (more than JOINED states) each unit is alone, and the fastest swing is not known.

    A pair of complex eigenvalues is one mode, and so are equal eigenvalues of the same state.
    """
    if layout.n_states == 0:
        return FastModes()
    strange = np.flatnonzero(~np.isfinite(partials.states.sum(axis=1)))
    if len(strange):
        name, _, unit = layout.state_names[strange[0]].partition(":")
        raise InitializationError(
            f"unit {unit}: how {name} changes with the states has no finite value at the start; a "
            "parameter is too small or too large"
        )
    jacobian = None if network is None else _Jacobian(partials, network)
    found = None if jacobian is None else jacobian.largest(min(count, layout.n_states))
    values, left, right = found or _of_units(partials, count)
    factors = np.abs(left.conj() * right)
    homes = np.argmax(np.round(factors / np.maximum(factors.max(axis=0), 1e-300), 3), axis=0)
    devices = {
        int(state): block.device.model
        for block in layout.blocks
        for state in block.state_index.ravel()
    }
    modes: dict[tuple[str, str], Mode] = {}
    for k in np.argsort(-np.abs(values), kind="stable"):
        real, imag, home = values[k].real, abs(values[k].imag), int(homes[k])
        # Of eigenvalues that nearly coincide the iteration makes pairs.
        value = complex(real, imag if imag > 1e-5 * abs(real) else 0.0)
        mode = Mode(value, layout.state_names[home], devices[home])
        modes.setdefault((f"{mode.eigenvalue:.4g}", mode.state), mode)
    period = math.inf if jacobian is None else _swing_period(jacobian, layout)
    return FastModes(tuple(modes.values()), period)


def _of_units(partials: Partials, count: int) -> _Eigen:
    """The same as of the whole for units that do not see each other."""
    _, member = connected_components(partials.states, directed=False)
    order, n = np.argsort(member, kind="stable"), len(member)
    found = []
    for states in np.split(order, np.flatnonzero(np.diff(member[order])) + 1):
        values, left, right = eig(partials.states[states][:, states].toarray(), left=True)
        found += [(value, states, left[:, k], right[:, k]) for k, value in enumerate(values)]
    found = sorted(found, key=lambda item: -abs(item[0]))[:count]
    vectors = np.zeros((2, n, len(found)), dtype=np.complex128)
    for k, (_, states, left, right) in enumerate(found):
        vectors[0, states, k], vectors[1, states, k] = left, right
    return np.array([item[0] for item in found]), vectors[0], vectors[1]


def _swing_period(jacobian: _Jacobian, layout: Layout) -> float:
    """2 pi / omega, where -omega^2 is the largest eigenvalue by magnitude of angles' accelerations."""
    slots = layout.signal_slots
    n = layout.n_states
    units = [unit for unit in layout.speed_states if slots.get((unit, "rotor_angle"), n) < n]
    if not units:
        return math.inf
    angles = np.array([slots[unit, "rotor_angle"] for unit in units])
    speeds = np.array([layout.speed_states[unit] for unit in units])
    torques = jacobian.block(speeds, angles)
    rates = jacobian.partials.states[angles, speeds]
    accelerations = torques * np.asarray(rates)[:, None]
    swing = np.random.default_rng(0).standard_normal(len(units))
    size = 0.0
    for _ in range(_PRODUCTS):
        swing = accelerations @ swing
        size = float(np.linalg.norm(swing))
        if not (0 < size < math.inf):
            return math.inf
        swing /= size
    return 2 * math.pi / math.sqrt(size)


def _three_digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}"


_Eigen = tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]


@dataclass(frozen=True)
class _Jacobian:
    """A + B Z C of a detailed model, by its parts."""

    partials: Partials
    network: NDArray[np.float64]

    def block(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float64]:
        """A part of it, (n_rows, n_columns)."""
        a, b, c = self.partials.states, self.partials.voltages, self.partials.currents
        behind = (b[rows] @ self.network) @ c[:, columns].toarray()
        return np.asarray(a[rows][:, columns].toarray() + behind)

    @cached_property
    def operator(self) -> LinearOperator:
        """Its products, and those of its transpose."""
        a, b, c = self.partials.states, self.partials.voltages, self.partials.currents
        z = self.network
        return LinearOperator(
            a.shape,
            matvec=lambda v: a @ v + b @ (z @ (c @ v)),
            rmatvec=lambda w: a.T @ w + c.T @ (z.T @ (b.T @ w)),
            dtype=np.float64,
        )

    def largest(self, count: int) -> _Eigen | None:
        """Eigenvalues (k,) of largest magnitude, their left and right eigenvectors (n, k).

        None where the iteration does not find them.
        """
        if self.partials.states.shape[0] >= _DENSE:
            for accuracy, basis, restarts in _TRIES:
                try:
                    return self._iterated(count, accuracy, basis, restarts)
                except ArpackError:
                    continue
            return None
        values, left, right = eig(self.partials.close(self.network), left=True, right=True)
        first = np.argsort(-np.abs(values), kind="stable")[:count]
        return values[first], left[:, first], right[:, first]

    def _iterated(self, count: int, accuracy: float, basis: int, restarts: int) -> _Eigen:
        """By Arnoldi's method with a fixed start."""
        start = np.random.default_rng(0).standard_normal(self.operator.shape[0])
        options = {"k": count, "v0": start, "tol": accuracy, "ncv": basis, "maxiter": restarts}
        values, right = eigs(self.operator, **options)
        others, vectors = eigs(self.operator.H, **options)
        # w^T J = lambda w^T; the left eigenvector is the conjugate of w.
        nearest = np.abs(values[:, None] - others[None, :]).argmin(axis=1)
        return values, vectors[:, nearest].conj(), right
