"""Models that many tests look at, built once."""

from __future__ import annotations

import pytest
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
