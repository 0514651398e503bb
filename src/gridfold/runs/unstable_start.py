"""Whether the operating point is stable by itself: what a run shows is else no answer to its events.

A step of the trapezoidal rule multiplies the mode lambda by (1 + gamma lambda)/(1 - gamma lambda),
which is more than 1 in magnitude just where the mode grows. So the modes that grow are those of largest
magnitude under this map, and Arnoldi's method finds them first, with the sparse solver of the implicit
rule. Two steps gamma see slow and fast modes apart from the rest. Saad, Numerical Methods for Large
Eigenvalue Problems, 2nd ed., 2011, section 8.1.3 (Cayley transform).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, eigs

from gridfold.dynamics.descriptor import grid_descriptor
from gridfold.dynamics.fast_modes import Mode
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.numerics.blas import one_blas_thread

#: Growth (1/s) up to which a mode counts as one of the zeros of angle and speed, found to rounding.
TOLERANCE = 1e-3
#: States below which all eigenvalues are computed.
_DENSE = 150
#: The steps gamma (s), and how many modes are looked for in a space of how many directions.
_GAMMAS, _COUNT, _SPACE = (0.2, 0.01), 6, 40
#: Accuracy of the iteration, and how often it starts again.
_ACCURACY, _RESTARTS = 1e-6, 60


def with_start_checked(model: DetailedModel) -> DetailedModel:
    """The same model, with a warning if its operating point is unstable."""
    mode = growing_mode(model)
    if mode is None:
        return model
    return replace(model, warnings=(*model.warnings, unstable_text(mode)))


def unstable_text(mode: Mode) -> str:
    """What is told of a mode that grows."""
    seconds = float(f"{1 / mode.eigenvalue.real:.2g}")
    return f"the operating point is unstable: {mode} grows by itself, e-fold every {seconds:g} s"


@one_blas_thread
def growing_mode(model: DetailedModel) -> Mode | None:
    """The mode that grows fastest at the equilibrium; None if there is none.

    All modes are computed up to 150 states. Beyond that those are found that grow clearly; one that
    grows by less than about 0.01 1/s may be missed among others that hardly decay.
    """
    if model.n_states < _DENSE:
        values = np.linalg.eigvals(model.jacobian(model.x0))
    else:
        values = np.concatenate([_largest(model, gamma) for gamma in _GAMMAS])
    growing = values[values.real > TOLERANCE]
    if not len(growing):
        return None
    value = complex(growing[np.argmax(growing.real)])
    return _mode_at(model, complex(value.real, abs(value.imag)))


def _largest(model: DetailedModel, gamma: float) -> NDArray[np.complex128]:
    """Eigenvalues of largest magnitude under the map of a step of 2 gamma."""
    solver = model.compiled.solver
    assert solver is not None
    solve = solver(model.x0, gamma)
    n = model.n_states
    step = LinearOperator((n, n), matvec=lambda v: 2 * solve(v.ravel()) - v.ravel(), dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    try:
        found = eigs(
            step, _COUNT, v0=start, ncv=_SPACE, tol=_ACCURACY, maxiter=_RESTARTS,
            return_eigenvectors=False,
        )  # fmt: skip
    except ArpackNoConvergence as error:
        found = error.eigenvalues
    except ArpackError:
        return np.zeros(0, dtype=np.complex128)
    found = found[found != -1]
    return np.asarray((found - 1) / (found + 1) / gamma, dtype=np.complex128)


def _mode_at(model: DetailedModel, value: complex) -> Mode:
    """The mode with the eigenvalue `value`, and the state that takes part in it most."""
    right = left = np.random.default_rng(0).standard_normal((model.n_states, 1)).astype(complex)
    system = grid_descriptor(model, model.x0)
    try:
        resolvent = system.at(value * (1 + 1e-7) + 1e-9)
        for _ in range(3):
            right, left = resolvent.solve(right), resolvent.solve_adjoint(left)
            right, left = right / np.linalg.norm(right), left / np.linalg.norm(left)
    except OptionError:  # the value itself, to the last digit
        pass
    home = int(np.argmax(np.abs(left.conj() * right)))
    devices = {
        int(state): block.device.model
        for block in model.layout.blocks
        for state in block.state_index.ravel()
    }
    return Mode(value, model.state_names[home], devices[home])
