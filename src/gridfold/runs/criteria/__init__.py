"""Runs held against criteria: what is kept, what is violated, and by how much."""

from gridfold.runs.criteria.doubt import doubt_of
from gridfold.runs.criteria.finding import Finding, Verdict
from gridfold.runs.criteria.judge import judge

__all__ = ["Finding", "Verdict", "doubt_of", "judge"]
