"""The study area and the external area: tie lines, boundary, and who is electrically near."""

from gridfold.partition.areas import (
    Partition,
    TieLine,
    chosen_study_buses,
    partition,
    study_buses,
)
from gridfold.partition.coupling import Coupling, couple
from gridfold.partition.linearize import linearize_external

__all__ = [
    "Coupling",
    "Partition",
    "TieLine",
    "chosen_study_buses",
    "couple",
    "linearize_external",
    "partition",
    "study_buses",
]
