"""How many machines to retain: the smallest number that leaves little enough error."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, inf, log2

from gridfold.equivalents.fit import TriedCount

#: Part of a detailed step that a step of the rung may cost.
AFFORDABLE = 0.8
#: Numbers that are tried at most: each is a reduction of its own.
MOST_TRIED = 3
#: What twice as many machines leave of the error at most, if it is worth to try still more.
_GAIN = 0.65
_FEWEST = 2
#: Largest number that is tried first: with many machines there are many ports, and what is behind them
#: takes minutes to reduce.
_FIRST = 8


def try_counts(
    linear_deg: float, wanted_deg: float, most: int, attempt: Callable[[int], TriedCount]
) -> tuple[TriedCount, ...]:
    """Try powers of two until one leaves `wanted_deg`, in the order in which they were tried.

    Parameters
    ----------
    linear_deg : float
        Error with no machine retained, in degrees.
    wanted_deg : float
        Error that may be left, in degrees.
    most : int
        Largest number.
    attempt : callable
        Tries a number.

    Returns
    -------
    tuple of TriedCount
        Begins where the error should be small enough if it halves with each doubling, but with few
        machines; goes on with twice as many where it is not, and with half as many where a step costs
        too much.
    """
    if linear_deg <= wanted_deg or most < _FEWEST:
        return ()
    largest = 2 ** int(log2(most))
    needed = _FIRST if linear_deg == inf else 2 ** ceil(log2(linear_deg / wanted_deg))
    count, tried = min(max(needed, _FEWEST), _FIRST, largest), list[TriedCount]()
    while len(tried) < MOST_TRIED:
        known = {item.count for item in tried}
        tried.append(attempt(count))
        dear, enough = tried[-1].cost > AFFORDABLE, tried[-1].error_deg <= wanted_deg
        slow = len(tried) > 1 and tried[-1].error_deg > _GAIN * tried[-2].error_deg
        count = count // 2 if dear else 2 * count
        if (not dear and (enough or slow)) or count in known or not _FEWEST <= count <= largest:
            break
    return tuple(tried)


def best_count(
    tried: tuple[TriedCount, ...], linear_deg: float, wanted_deg: float, allowed_deg: float
) -> int:
    """The number to retain, 0 for none.

    Of those that are cheap enough the smallest that leaves `wanted_deg`, else the one with the smallest
    error, if that is below `allowed_deg` and half of the error with no machine retained.
    """
    cheap = sorted((item for item in tried if item.cost <= AFFORDABLE), key=lambda t: t.count)
    good = [item for item in cheap if item.error_deg <= wanted_deg]
    if good:
        return good[0].count
    worth = [item for item in cheap if item.error_deg <= min(allowed_deg, linear_deg / 2)]
    return min(worth, key=lambda item: item.error_deg).count if worth else 0
