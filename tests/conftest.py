"""Models that many tests look at, built once."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases import FALLING, npcc_model_on

import gridfold as gf
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.swings import Swings, sample_swings
from gridfold.numerics.steppers import Stepper

#: Buses of the external machines that the paper keeps nonlinear.
NEAR_BOUNDARY = (42, 50, 51, 78, 134)


@pytest.fixture(scope="session")
def npcc() -> gf.DetailedModel:
    """The built-in NPCC system at its equilibrium."""
    return npcc_model_on(gf.NetworkBackend.DENSE)


@pytest.fixture(scope="session")
def npcc_sparse() -> gf.DetailedModel:
    """The same system with the sparse network solver."""
    return npcc_model_on(gf.NetworkBackend.SPARSE)


@pytest.fixture(scope="session")
def npcc_parts(npcc: gf.DetailedModel) -> gf.Partition:
    """Its area 1 as study area."""
    return gf.partition(npcc, range(1, 37))


@pytest.fixture(scope="session")
def npcc_swings(npcc_parts: gf.Partition) -> Swings:
    """Sample swings after faults at the boundary."""
    return sample_swings(npcc_parts)


@pytest.fixture(scope="session")
def npcc_linear(npcc_parts: gf.Partition, npcc_swings: Swings) -> FoldedArea:
    """The external area folded, all of its machines linear."""
    return gf.fold(npcc_parts, swings=npcc_swings)


@pytest.fixture(scope="session")
def npcc_retained(npcc_parts: gf.Partition, npcc_swings: Swings) -> FoldedArea:
    """The same with machines near the boundary exact."""
    near = [unit for unit in npcc_parts.external_units if unit.bus in NEAR_BOUNDARY]
    return gf.fold(npcc_parts, near, swings=npcc_swings)


@pytest.fixture
def falling_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every rung of a ladder is cheaper than the one above, so that runs do not hang on a clock."""

    def measured(ladder: Ladder, stepper: Stepper | None = None) -> Ladder:
        return replace(ladder, step_seconds={m: FALLING[m] for m in (Mode.DETAILED, *ladder.rungs)})

    monkeypatch.setattr(Ladder, "measured", measured)
