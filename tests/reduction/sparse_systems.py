"""Random large systems by sparse blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csc_array, diags_array, random_array

from gridfold.systems import DescriptorSystem


def random_descriptor(seed, n, k, m, p, modes=()):
    """Oscillators and lags in a sparse network of `k` unknowns; stable but for `modes`.

    The rightmost pole of the random part is shifted to -0.1. Each of `modes` is an eigenvalue of a
    further state (or two of a pair), which all inputs reach and all outputs see.
    """
    rng = np.random.default_rng(seed)
    blocks = [rng.normal(size=(2, 2)) + np.array([[0, 3], [-3, 0]]) for _ in range((n + 1) // 2)]
    a11 = np.zeros((2 * len(blocks),) * 2)
    for i, block in enumerate(blocks):
        a11[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
    a11 = a11[:n, :n]
    a12, a21 = (_sparse(rng, *shape) for shape in ((n, k), (k, n)))
    a22 = _sparse(rng, k, k) + 5 * diags_array(np.ones(k), shape=(k, k))
    b1, b2, c = (rng.normal(size=shape) for shape in ((n, m), (k, m), (p, n)))
    system = DescriptorSystem(a11, a12, a21, a22, b1, b2, c)
    rightmost = np.linalg.eigvals(system.dense().a).real.max()
    system = replace(system, a11=csc_array(a11 - (rightmost + 0.1) * np.eye(n)))
    for value in modes:
        system = _with_mode(system, value, rng)
    return system


def _with_mode(system, value, rng):
    size = 2 if np.imag(value) else 1
    own = np.array([[np.real(value), np.imag(value)], [-np.imag(value), np.real(value)]])
    n, k = system.n, system.a22.shape[0]
    a11 = np.zeros((n + size, n + size))
    a11[:n, :n] = system.a11.toarray()
    a11[n:, n:] = own[:size, :size]
    a11[:n, n:] = 0.3 * rng.normal(size=(n, size))
    return DescriptorSystem(
        a11,
        np.vstack([system.a12.toarray(), np.zeros((size, k))]),
        np.hstack([system.a21.toarray(), 0.1 * rng.normal(size=(k, size))]),
        system.a22,
        np.vstack([system.b1, rng.normal(size=(size, system.m))]),
        system.b2,
        np.hstack([system.c, rng.normal(size=(system.p, size))]),
    )


def _sparse(rng, rows, columns):
    return csc_array(random_array((rows, columns), density=0.2, rng=rng, data_sampler=rng.normal))
