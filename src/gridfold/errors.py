"""The exceptions of gridfold, all under one root.

::

    GridfoldError
    ├── CaseError             the case data are wrong (lists every fault found)
    │   └── CaseFileError     a case file cannot be read
    ├── DeviceError           a device model of one's own is wrong (lists every fault found)
    ├── EventError            an event is malformed, or names something that is not in the case
    ├── OptionError           a setting (step, criterion, method ...) is out of its range
    ├── PowerFlowError        the power flow has no solution, or none was found
    ├── InitializationError   the dynamic model has no equilibrium at the power-flow solution
    ├── NetworkError          the network equations of one network state cannot be solved
    ├── GpuError              a GPU does not take the runs that it is given
    ├── TimeLimitError        something took longer than it was allowed
    └── OutputError           a result cannot be written

    GridfoldWarning           root of its warnings (Python's ``warnings``)
    ├── SaveWarning           a file cannot hold all that was saved
    └── StepWarning           a time step is too long for the model or the fault

What a simulation *finds* (loss of synchronism, non-finite states) is not an exception: it is the
:class:`gridfold.Status` of the result.
"""

from __future__ import annotations

import copyreg
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

#: Characters of a value that a message shows.
_SHOWN = 60


class GridfoldError(Exception):
    """Root of everything that gridfold raises on purpose.

    Parameters
    ----------
    text : str
        What is wrong.
    advice : sequence of str
        Options that would make something else of it, one line each; they come last.
    """

    def __init__(self, text: str = "", advice: Sequence[str] = ()):
        self.text, self.advice = text, tuple(advice)
        super().__init__("\n".join([text, *self.advice]))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as it is: made anew from its whole text it would say all of it twice."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class CaseError(GridfoldError):
    """The case data are wrong.

    Parameters
    ----------
    faults : sequence of str
        Every fault found, one line each.
    where : str
        The case or file in which they were found.
    advice : sequence of str
        Options that would make something else of them.
    """

    def __init__(
        self, faults: Sequence[str] | str, where: str = "case", advice: Sequence[str] = ()
    ):
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        count = "1 fault" if len(self.faults) == 1 else f"{len(self.faults)} faults"
        listed = "\n".join(f"  {fault}" for fault in self.faults)
        super().__init__(f"{where}: {count}\n{listed}", advice)

    def joined(self, later: GridfoldError) -> CaseError:
        """An error that also says what is wrong `later`; the options that answer both come last."""
        both = CaseError(
            [*self.faults, *getattr(later, "faults", [later.text])],
            advice=tuple(dict.fromkeys((*self.advice, *later.advice))),
        )
        both.text = f"{self.text}\n{later.text}"
        both.args = ("\n".join([both.text, *both.advice]),)
        return both


class CaseFileError(CaseError):
    """A case file is missing or cannot be read."""


class DeviceError(GridfoldError):
    """A device model of a user's own is wrong: names file, device, and kernel and row where it is one.

    Parameters
    ----------
    faults : sequence of str
        Every fault found, one line each.
    """

    def __init__(self, faults: Sequence[str] | str):
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        super().__init__("\n".join(self.faults))


class EventError(GridfoldError):
    """An event is malformed, or names something that is not in the case."""


class OptionError(GridfoldError):
    """A setting is out of its range."""


class PowerFlowError(GridfoldError):
    """The power flow has no solution, or none was found."""


class InitializationError(GridfoldError):
    """The dynamic model has no equilibrium at the power-flow solution."""


class NetworkError(GridfoldError):
    """The network equations of one network state cannot be solved."""


class GpuError(GridfoldError):
    """A GPU does not take what it is given: it cannot be compiled for it, has no room, or fails."""


class TimeLimitError(GridfoldError):
    """Something took longer than it was allowed."""


class OutputError(GridfoldError):
    """A result cannot be written."""


class GridfoldWarning(UserWarning):
    """Root of every warning of gridfold."""


class SaveWarning(GridfoldWarning):
    """A file cannot hold all that was saved: the text lists what is not in it."""


class StepWarning(GridfoldWarning):
    """A time step is too long for the model or the fault: the result may be wrong."""


def warn_caller(text: str, category: type[GridfoldWarning]) -> None:
    """Warn, with the line outside the package that called it."""
    inside, depth, frame = str(Path(__file__).parent) + os.sep, 1, sys._getframe(0)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(inside):
        frame, depth = frame.f_back, depth + 1
    warnings.warn(text, category, stacklevel=depth)


def require_list(items: object, fits: Callable[[Any], bool], what: str, example: str) -> None:
    """Raise an OptionError unless `items` is a list, or the like, whose items all fit.

    Parameters
    ----------
    items : object
        What was given.
    fits : callable
        Whether an item is one of those that are wanted.
    what : str
        What they are called.
    example : str
        How such a list is written.
    """
    listed = isinstance(items, Iterable) and not isinstance(items, str | bytes)
    given = list(items) if isinstance(items, Iterable) and listed else []
    wrong = [item for item in given if not fits(item)] if listed else [items]
    if wrong:
        raise OptionError(f"{what} are a list such as {example}, not {_short(wrong[0])}")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ..."
