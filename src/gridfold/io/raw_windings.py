"""Impedances of transformers that are given on the nominal voltages of their windings.

With CZ = 2 or 3 an impedance is in per unit of the nominal voltage NOMV of a winding: of the first for
the pair 1-2, of the second for 2-3, of the third for 3-1. Where NOMV is given and is not the base
voltage of the winding's bus, per unit of the bus is something else, by the square of the ratio. powerio
takes it for the same. PSS/E Program Operation Manual, transformer data.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence

_PAIRS = ("1-2", "2-3", "3-1")
_ENDS = ("I", "J", "K")
_ON_WINDINGS = ("2", "3")  # CZ
#: Line of a record in which the first winding stands.
_FIRST = 2


def refer_to_buses(lines: Sequence[MutableMapping[str, str]], kilovolts: Mapping[str, str]) -> None:
    """Write impedances in per unit of the buses' base voltages.

    Parameters
    ----------
    lines : sequence of mappings
        The lines of a record, by column; changed in place.
    kilovolts : mapping
        Base voltage of each bus.
    """
    first, pairs = lines[0], lines[1]
    squares = [
        _square(line["NOMV"], kilovolts.get(first[end], ""))
        for end, line in zip(_ENDS, lines[_FIRST:], strict=False)
    ]
    if first["CZ"] in _ON_WINDINGS:
        for pair, square in zip(_PAIRS, squares, strict=False):
            for name in (f"R{pair}", f"X{pair}"):
                if name in pairs:
                    pairs[name] = _times(pairs[name], square)


def _square(nominal: str, base: str) -> float:
    """(NOMV / base voltage)^2; 1 where one of them is not given."""
    try:
        ratio = float(nominal) / float(base)
    except (ValueError, ZeroDivisionError):
        return 1.0
    return ratio * ratio if ratio > 0 else 1.0


def _times(text: str, factor: float) -> str:
    """A number in a record times a factor; anything else stays, to be told where it is read."""
    try:
        return text if factor == 1 else repr(float(text) * factor)
    except ValueError:
        return text
