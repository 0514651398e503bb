"""Systems that tests of reduction share."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from gridfold.systems import LinearSystem


def resistor_capacitor_line(n):
    """A symmetric chain of n capacitors, driven at one end and measured at the same end."""
    a = np.diag(np.full(n, -2.0)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
    end = np.eye(n)[:, :1]
    return LinearSystem(a, end, end.T)


def random_stable(seed, n, m, p):
    """A random system with its rightmost pole between -0.05 and -1."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    a -= (np.linalg.eigvals(a).real.max() + rng.uniform(0.05, 1)) * np.eye(n)
    return LinearSystem(a, rng.normal(size=(n, m)), rng.normal(size=(p, n)))


def with_integrator_and_unstable_mode(stable, seed=5):
    """`stable` with poles at 0 and 0.3 besides, all mixed by a well-conditioned change of states."""
    rng = np.random.default_rng(seed)
    n = stable.n + 2
    a = np.zeros((n, n))
    a[:-2, :-2] = stable.a
    a[-1, -1] = 0.3
    b = np.vstack([stable.b, rng.normal(size=(2, stable.m))])
    c = np.hstack([stable.c, rng.normal(size=(stable.p, 2))])
    mix = np.eye(n) + 0.3 * rng.normal(size=(n, n)) / np.sqrt(n)
    return LinearSystem(mix @ a @ np.linalg.inv(mix), mix @ b, c @ np.linalg.inv(mix))


stable_systems = st.builds(
    random_stable,
    st.integers(0, 2**32 - 1),
    st.integers(1, 14),
    st.integers(1, 3),
    st.integers(1, 4),
)

#: From far below to far above the poles of all systems here.
FREQUENCIES = 1j * np.concatenate([[0.0], np.logspace(-3, 3, 120)])


def peak_error(full, reduced, points=FREQUENCIES):
    """Largest singular value of the difference of two transfer matrices over `points`."""
    difference = full.transfer(points) - reduced.transfer(points)
    return np.linalg.norm(difference, 2, axis=(1, 2)).max()
