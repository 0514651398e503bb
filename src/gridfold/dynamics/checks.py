"""Checks that many models share, told by the names of parameters alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from gridfold.dynamics.device import Parameter

Check = Callable[[Mapping[str, float]], Iterable[str]]
Pair = tuple[str, str]


def checks(
    parameters: Iterable[Parameter],
    *,
    ordered: Iterable[Pair] = (),
    proper: Iterable[Pair] = (),
    more: Iterable[Check] = (),
) -> Check:
    """A device's `check`.

    Parameters
    ----------
    parameters : iterable of Parameter
        Those of the device.
    ordered : pairs of str
        Lowest and highest value of something, which must not cross.
    proper : pairs of str
        What makes the numerator of a block, and the time constant of its denominator: where the second
        is 0 the first must be 0 too, or the block would differentiate.
    more : iterable of callable
        Further checks.
    """
    symbols = {parameter.name: parameter.symbol for parameter in parameters}
    limits, blocks, others = tuple(ordered), tuple(proper), tuple(more)

    def check(values: Mapping[str, float]) -> Iterator[str]:
        for low, high in limits:
            if values[low] > values[high]:
                yield f"{low} {symbols[low]} is above {high} {symbols[high]}"
        for top, time in blocks:
            if values[time] == 0 and values[top] != 0:
                yield f"{time} {symbols[time]} is 0: {top} {symbols[top]} has to be 0 then"
        for other in others:
            yield from other(values)

    return check
