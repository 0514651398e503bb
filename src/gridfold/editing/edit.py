"""What all edits have: they make another case of one, and say what was done."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from gridfold.dynamics.device import Device
from gridfold.grid.case import Case


class Edited(NamedTuple):
    """A changed case, what was done in words, and the names of the records that are changed."""

    case: Case
    text: str
    names: tuple[str, ...]


class Edit(Protocol):
    """What all edits have."""

    def apply(self, case: Case, devices: Mapping[str, Device]) -> Edited:
        """The case with the edit; `devices` are all models by name.

        Raises
        ------
        GridfoldError
            It names what is not there, or a value has no meaning.
        """
