"""All kinds of edits.

An edit says what becomes of a case: ``apply(case, devices)`` gives the changed one and what was done,
in words (:class:`~gridfold.editing.edit.Edit`). To add one, write a frozen dataclass with that method
and put it into :data:`EDITS`.
"""

from __future__ import annotations

from collections.abc import Mapping

from gridfold.editing.edit import Edit
from gridfold.editing.power_edits import Dispatch, ScaleLoad
from gridfold.editing.record_edits import Add, Remove, Set, Switch

#: Name of each kind of edit in files.
EDITS: Mapping[str, type] = {
    "scale-load": ScaleLoad,
    "set": Set,
    "switch": Switch,
    "redispatch": Dispatch,
    "add": Add,
    "remove": Remove,
}

__all__ = ["EDITS", "Add", "Dispatch", "Edit", "Remove", "ScaleLoad", "Set", "Switch"]
