from __future__ import annotations

import pytest

import gridfold as gf
from gridfold.partition import Partition, partition


@pytest.fixture(scope="package")
def parts(npcc: gf.DetailedModel) -> Partition:
    """NPCC with the study area of the paper."""
    return partition(npcc, range(1, 37))
