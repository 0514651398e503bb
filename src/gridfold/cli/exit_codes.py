"""How the command ends."""

from __future__ import annotations

from enum import IntEnum

EXIT_CODES = (
    "Exit codes: 0 completed; 2 bad input or options; 3 a machine lost synchronism or was off "
    "speed; 4 contingencies or samples failed; 5 a run was completed and violates a criterion; 130 "
    "interrupted; 1 anything else, such as non-finite states."
)


class ExitCode(IntEnum):
    """Exit codes of the command."""

    COMPLETED = 0
    FAILED = 1
    BAD_INPUT = 2
    LOST_SYNCHRONISM = 3
    ROWS_FAILED = 4
    VIOLATED = 5
    INTERRUPTED = 130
