"""Runs as lists of segments. Knows systems and steppers, no power systems."""

from gridfold.simulation.run import Run, run_segments
from gridfold.simulation.segment import Piece, Segment

__all__ = ["Piece", "Run", "Segment", "run_segments"]
