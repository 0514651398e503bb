"""Cases as a person edits them: tables, edits that give a new checked case, files to keep it."""

from gridfold.editing.editor import CaseEditor, apply_edits, edit_case
from gridfold.editing.edits import EDITS, Add, Edit, Remove, ScaleLoad, Set, Switch
from gridfold.editing.frames import case_frame
from gridfold.editing.saving import save_case

__all__ = [
    "EDITS",
    "Add",
    "CaseEditor",
    "Edit",
    "Remove",
    "ScaleLoad",
    "Set",
    "Switch",
    "apply_edits",
    "case_frame",
    "edit_case",
    "save_case",
]
