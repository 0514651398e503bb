"""What follows from the branches that are in service in a case is found once."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import wraps
from typing import Protocol, TypeVar

from gridfold.grid.case import Case

Found = TypeVar("Found", covariant=True)


class OfBranches(Protocol[Found]):
    """Finds something of a case with open branches at the positions `branches_out`, or with its own."""

    def __call__(self, case: Case, branches_out: Collection[int] | None = None) -> Found:
        """What it finds."""


def intact_once(find: Callable[[Case, Collection[int]], Found]) -> OfBranches[Found]:
    """Keep with a case what `find` gives for its own open branches; most states have the same.

    Without `branches_out` these are meant. What is found is shared: nobody may write into it.
    """
    name = f"{find.__module__}.{find.__qualname__}"

    @wraps(find)
    def known(case: Case, branches_out: Collection[int] | None = None) -> Found:
        if branches_out is not None and frozenset(branches_out) != case.branches_out:
            return find(case, branches_out)
        if name not in vars(case):
            vars(case)[name] = find(case, case.branches_out)
        found: Found = vars(case)[name]
        return found

    return known
