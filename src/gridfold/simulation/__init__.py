"""Runs as lists of segments. Knows systems and steppers, no power systems."""

from gridfold.simulation.run import Plan, Run, Sink, run_plan, run_segments
from gridfold.simulation.segment import Monitor, Piece, Segment

__all__ = ["Monitor", "Piece", "Plan", "Run", "Segment", "Sink", "run_plan", "run_segments"]
