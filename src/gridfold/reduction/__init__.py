"""Linear reduction: from a linear system to a smaller one, with a way back to full states."""

from gridfold.reduction.balanced import BalancedTruncation, SingularPerturbation
from gridfold.reduction.base import Reducer, Reduction
from gridfold.reduction.modal import ModalTruncation
from gridfold.reduction.unreduced import Unreduced

__all__ = [
    "BalancedTruncation",
    "ModalTruncation",
    "Reducer",
    "Reduction",
    "SingularPerturbation",
    "Unreduced",
]
