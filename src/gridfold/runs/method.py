"""Which integration rule suits a model: the explicit ones need a step that its fastest mode allows.

An explicit rule multiplies the mode lambda by its growth(h lambda) in every step h. Where that is more
than the mode itself does, the run is lost within a few steps, whatever happens to the system. Hairer &
Wanner, Solving Ordinary Differential Equations II, 2nd ed., section IV.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from gridfold.dynamics.jacobian import Partials
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.steppers import (
    AdamsBashforthMoulton4,
    ImplicitTrapezoidal,
    RungeKutta4,
    Stepper,
)

#: How many of the fastest modes are looked at.
_COUNT = 6
#: States below which all eigenvalues are computed, and accuracy and patience of the iteration above.
_DENSE, _ACCURACY, _RESTARTS = 200, 1e-6, 100
#: |h lambda| up to which a mode is resolved by the step, whatever it does.
_RESOLVED = 0.5
#: Growth beyond that of the mode itself that is put down to rounding.
_ROUNDING = 1e-6


class Method(Enum):
    """Integration rules by name; AUTO chooses one."""

    AUTO = "auto"
    RK4 = "rk4"
    ABM4 = "abm4"
    TRAPEZOIDAL = "trapezoidal"


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
class Choice:
    """A stepper, and why it was chosen, in one sentence."""

    stepper: Stepper
    reason: str

    def record(self) -> dict[str, str]:
        """Both, ready for JSON."""
        return {"method": self.stepper.name, "method_reason": self.reason}


def choose_stepper(
    model: DetailedModel, method: Method | str = Method.AUTO, step: float | None = None
) -> Choice:
    """The stepper of a method; AUTO is Runge-Kutta if it is stable at the step, else trapezoidal.

    Parameters
    ----------
    model : DetailedModel
        The model at its equilibrium, whose fastest modes decide.
    method : Method, or its name
        The integration rule.
    step : float, optional
        Time step in seconds; by default that of the method, with AUTO that of Runge-Kutta.

    Raises
    ------
    OptionError
        An explicit method that was asked for by name is unstable at this step: names the mode, its
        device, and the largest step that would do.
    """
    try:
        asked = Method(method)
    except ValueError:
        raise OptionError(f"there is no method {method!r}") from None
    if asked is Method.TRAPEZOIDAL:
        return Choice(_implicit(step), "trapezoidal: as asked for; stable at every step")
    kind = AdamsBashforthMoulton4 if asked is Method.ABM4 else RungeKutta4
    stepper = kind() if step is None else kind(step)
    modes = fastest_modes(model)
    limits = {mode: _largest_step(stepper, mode.eigenvalue) for mode in modes}
    worst = min(modes, key=limits.__getitem__, default=None)
    if worst is None:
        return Choice(stepper, f"{stepper.name}: the model has no states")
    if limits[worst] == stepper.step:
        text = f"fastest mode {modes[0].value} ({modes[0].state}) is stable at {stepper.step:g} s"
        return Choice(stepper, f"{stepper.name}: {text}")
    blame = f"{stepper.name} at {stepper.step:g} s would be unstable, {worst} needs at most "
    blame += f"{_rounded_down(limits[worst]):g} s"
    if asked is Method.AUTO:
        return Choice(_implicit(stepper.step), f"trapezoidal: {blame}")
    raise OptionError(f"{blame}; the implicit method trapezoidal does with any step")


def _implicit(step: float | None) -> ImplicitTrapezoidal:
    return ImplicitTrapezoidal() if step is None else ImplicitTrapezoidal(step)


def _stable(stepper: Stepper, z: complex) -> bool:
    """Whether a step leaves a mode, z = h lambda, no larger than it may become by itself."""
    own = math.exp(min(max(z.real, 0.0), 100.0))
    return abs(z) <= _RESOLVED or stepper.growth(z) <= own * (1 + _ROUNDING)


def _largest_step(stepper: Stepper, eigenvalue: complex) -> float:
    """The largest stable step in seconds that is not above that of the stepper, by bisection."""
    if _stable(stepper, stepper.step * eigenvalue):
        return stepper.step
    low, high = _RESOLVED / abs(eigenvalue), stepper.step
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if _stable(stepper, middle * eigenvalue) else (low, middle)
    return low


def _three_digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}"


def _rounded_down(value: float) -> float:
    """Two digits of a positive number."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.floor(value / unit) * unit


@one_blas_thread
def fastest_modes(model: DetailedModel, count: int = _COUNT) -> tuple[Mode, ...]:
    """Modes with the largest eigenvalues by magnitude at the equilibrium, the fastest first.

    About `count` of them; a pair of complex eigenvalues is one mode, and so are equal eigenvalues of
    the same state.
    """
    if model.n_states == 0:
        return ()
    jacobian = _Jacobian(model.partials(model.x0), model.network_response(model.x0))
    values, left, right = jacobian.largest(min(count, model.n_states))
    factors = np.abs(left.conj() * right)
    homes = np.argmax(np.round(factors / np.maximum(factors.max(axis=0), 1e-300), 3), axis=0)
    devices = {
        int(state): block.device.model
        for block in model.layout.blocks
        for state in block.state_index.ravel()
    }
    modes: dict[tuple[str, str], Mode] = {}
    for k in np.argsort(-np.abs(values), kind="stable"):
        real, imag, home = values[k].real, abs(values[k].imag), int(homes[k])
        # Of eigenvalues that nearly coincide the iteration makes pairs.
        value = complex(real, imag if imag > 1e-5 * abs(real) else 0.0)
        mode = Mode(value, model.state_names[home], devices[home])
        modes.setdefault((f"{mode.eigenvalue:.4g}", mode.state), mode)
    return tuple(modes.values())


_Eigen = tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]


@dataclass(frozen=True)
class _Jacobian:
    """A + B Z C of a detailed model, by its parts."""

    partials: Partials
    network: NDArray[np.float64]

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

    def largest(self, count: int) -> _Eigen:
        """Eigenvalues (k,) of largest magnitude, their left and right eigenvectors (n, k)."""
        if self.partials.states.shape[0] >= _DENSE:
            try:
                return self._iterated(count)
            except ArpackError:
                pass
        values, left, right = eig(self.partials.close(self.network), left=True, right=True)
        first = np.argsort(-np.abs(values), kind="stable")[:count]
        return values[first], left[:, first], right[:, first]

    def _iterated(self, count: int) -> _Eigen:
        """By Arnoldi's method with a fixed start."""
        start = np.random.default_rng(0).standard_normal(self.operator.shape[0])
        options = {"k": count, "v0": start, "tol": _ACCURACY, "maxiter": _RESTARTS}
        values, right = eigs(self.operator, **options)
        others, vectors = eigs(self.operator.H, **options)
        # w^T J = lambda w^T; the left eigenvector is the conjugate of w.
        nearest = np.abs(values[:, None] - others[None, :]).argmin(axis=1)
        return values, vectors[:, nearest].conj(), right
