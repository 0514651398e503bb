"""Runs as lists of segments. Knows systems and steppers, no power systems."""

from gridfold.simulation.run import Plan, Run, run_plan, run_segments
from gridfold.simulation.segment import Piece, Segment

__all__ = ["Piece", "Plan", "Run", "Segment", "run_plan", "run_segments"]
