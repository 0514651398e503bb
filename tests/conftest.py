"""Models that many tests look at, built once."""

from __future__ import annotations

import os
import tempfile

import pytest

# Processes that fill one cache of compiled code at the same time can mix up its files, so each process
# of a parallel run has its own. Where it is has to be known before anything compiled is imported.
if "PYTEST_XDIST_WORKER" in os.environ:
    _cache = tempfile.TemporaryDirectory(prefix="gridfold-tests-")
    os.environ["NUMBA_CACHE_DIR"] = _cache.name

from cases import npcc_model_on

import gridfold as gf


@pytest.fixture(scope="session")
def npcc() -> gf.DetailedModel:
    """The built-in NPCC system at its equilibrium."""
    return npcc_model_on(gf.NetworkBackend.DENSE)


@pytest.fixture(scope="session")
def npcc_sparse() -> gf.DetailedModel:
    """The same system with the sparse network solver."""
    return npcc_model_on(gf.NetworkBackend.SPARSE)
