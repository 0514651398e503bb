"""The monitor language: what is watched of a run, as text.

A monitor is a list of quantities with what they are wanted of, and how often::

    voltage 1001-1050, area:2, flow 101-103, angle, every 5
    interface WEST = area:1 to area:2, area 1,2, field_voltage 101:1

A quantity begins with its word; what follows until the next one chooses the buses, lines or machines
(:mod:`gridfold.grid.selection_text`), all of them if nothing does. ``every 5`` keeps each fifth step;
alone it is about what tables hold by default.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gridfold.errors import OptionError
from gridfold.grid.selection_text import Word, parse_selection, pieces_of

#: What tables hold where nothing else is asked for.
DEFAULT_MONITOR = "angle, speed, voltage"
#: Quantities that are chosen as buses, as lines, and as areas and the like.
BUS_KINDS = ("voltage", "voltage_angle", "frequency", "load")
LINE_KINDS = ("flow", "current", "interface")
GROUP_KINDS = {"area": Word.AREA, "zone": Word.ZONE, "owner": Word.OWNER}
#: Quantities of machines, beside all of their signals.
MACHINE_KINDS = ("angle", "angle_coi", "speed", "generation")

_SELECTING = frozenset(
    ("bus", "buses", "areas", "zones", "owners", "kv", "line", "lines", "branch", "branches")
) | {"all", "none", "study", "except"}
_BEGINS = re.compile(r"([A-Za-z_]\w*)(?:\s+(?![<>=:])(.*))?", re.DOTALL)
_LABEL = re.compile(r"(\"[^\"]+\"|'[^']+'|[\w.-]+)\s*=\s*(.*)", re.DOTALL)
_SHOWN = 60


_UNITS = {"mw": "MW", "mvar": "Mvar", "pu": "pu", "deg": "deg", "hz": "Hz"}


def unit_of(column: str) -> str:
    """Unit of a column by its name; signals of machines are in per unit."""
    return _UNITS.get(column.partition(":")[0].rpartition("_")[2], "pu")


@dataclass(frozen=True)
class Statement:
    """A quantity, what it is wanted of (empty: everything), and the name of an interface."""

    kind: str
    places: str = "all"
    label: str | None = None

    @property
    def word(self) -> Word:
        """What numbers in `places` are first those of."""
        if self.kind in LINE_KINDS:
            return Word.LINE
        return GROUP_KINDS.get(self.kind, Word.BUS)


@dataclass(frozen=True)
class Monitor:
    """Quantities that are watched (none: those by default), and each how many-th step is kept."""

    statements: tuple[Statement, ...]
    every: int = 1


def parse_monitor(text: str, what: str = "monitor") -> Monitor:
    """A monitor from its text; `what` is where the text is from, for messages.

    Raises
    ------
    OptionError
        A part of the text has no meaning: names all such parts.
    """
    if not isinstance(text, str):
        raise OptionError(
            f"{what}: it is a text such as 'flow 101-103, voltage area:1', not {text!r}"
        )
    if not text.strip():
        raise OptionError(
            f"{what}: it is empty; it begins with a quantity, such as voltage or flow"
        )
    faults: list[str] = []
    steps: list[int] = []
    parts: list[tuple[str, list[str]]] = []
    for piece in pieces_of(text, what):
        begins = _BEGINS.fullmatch(piece)
        word = begins[1].lower() if begins else ""
        if not piece:
            faults.append(f"a comma of {text[:_SHOWN]!r} has nothing beside it")
        elif begins and word == "every":
            steps.append(_every(begins[2] or "", faults))
        elif begins and word not in _SELECTING:
            parts.append((begins[1], [begins[2] or ""]))
        elif parts and parts[-1][0].lower() == "interface" and _names_another(piece):
            parts.append(("interface", [piece]))
        elif parts:
            parts[-1][1].append(piece)
        else:
            faults.append(f"{piece[:_SHOWN]!r} has no quantity before it, such as voltage or flow")
    statements = [_statement(kind, places, what, faults) for kind, places in parts]
    faults.extend(_given_twice(statements, steps))
    if faults:
        raise OptionError(f"{what}: {'; '.join(faults)}")
    return Monitor(tuple(statements), steps[0] if steps else 1)


def _every(text: str, faults: list[str]) -> int:
    match = re.fullmatch(r"([0-9]{1,9})(?:\s*steps?)?", text.strip())
    if match is None or int(match[1]) < 1:
        instead = f", not {text!r}" if text else ""
        faults.append(f"'every' is followed by a number of steps, such as every 5{instead}")
        return 1
    return int(match[1])


def _names_another(piece: str) -> bool:
    """Whether a part of an interface's text begins the next one, as ``EAST = 104-105``."""
    labelled = _LABEL.fullmatch(piece)
    return labelled is not None and labelled[1].lower() not in _SELECTING | GROUP_KINDS.keys()


def _given_twice(statements: Sequence[Statement], steps: Sequence[int]) -> Iterator[str]:
    """What contradicts itself: an interface with other lines, other steps."""
    if len(set(steps)) > 1:
        yield f"'every' is given twice, with {steps[0]} and {steps[1]} steps"
    lines: dict[str, str] = {}
    for item in statements:
        if item.label is not None and lines.setdefault(item.label, item.places) != item.places:
            yield f"interface {item.label} is given twice, as {lines[item.label]} and {item.places}"


def _statement(kind: str, pieces: list[str], what: str, faults: list[str]) -> Statement:
    lower = kind.lower()
    known = (*BUS_KINDS, *LINE_KINDS, *GROUP_KINDS, *MACHINE_KINDS)
    name = lower if lower in known else kind
    places = ", ".join(pieces).strip()
    label = None
    if name == "interface":
        if labelled := _LABEL.fullmatch(places):
            label, places = labelled[1].strip("\"'"), labelled[2]
        if not places:
            faults.append("an interface is followed by its lines: interface area:1 to area:2")
            places = "all"
    statement = Statement(name, places or "all", label)
    try:
        parse_selection(statement.places, name, statement.word)
    except OptionError as error:
        faults.append(f"{error}{'' if name in known else _alike(name, known)}")
    return statement


def _alike(name: str, known: Sequence[str]) -> str:
    """A hint at the quantity that a word is like; it may be a signal of machines as it is."""
    close = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean {close[0]}?)" if close else ""
