"""Runs held against criteria: what is kept, what is violated, and by how much."""

from gridfold.runs.criteria.doubt import doubt_of
from gridfold.runs.criteria.finding import BETWEEN, Finding, Verdict
from gridfold.runs.criteria.judge import judge

__all__ = ["BETWEEN", "Finding", "Verdict", "doubt_of", "judge"]
