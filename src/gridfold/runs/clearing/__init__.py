"""Critical clearing times: the bisection, its trials on all cores, what came of them."""

from gridfold.runs.clearing.found import ClearingTime, ClearingTimes, Fault
from gridfold.runs.clearing.many import critical_clearing_times
from gridfold.runs.clearing.single import critical_clearing_time

__all__ = [
    "ClearingTime",
    "ClearingTimes",
    "Fault",
    "critical_clearing_time",
    "critical_clearing_times",
]
