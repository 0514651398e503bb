"""Which lines of kernels, and of what they call in a user's own files, have not run.

No kernel runs on for ever while it is watched.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import CodeType, FrameType, FunctionType
from typing import Any

from gridfold.dynamics.guarded import NoNumberError, is_own_file

#: Lines that a kernel runs at one point, at most: what takes more is taken not to end.
_LONGEST = 20_000


class LineWatch:
    """Lines of functions and of what they call, those of installed packages apart."""

    def __init__(self, functions: Iterable[Any]):
        self.left: dict[CodeType, set[int]] = {}
        for function in functions:
            self._add(function)
        self.total = sum(map(len, self.left.values()))
        self.now = 0

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Lines that run in the meantime count; a debugger is let go on afterwards.

        A :class:`NoNumberError` ends what runs more of them than any kernel has at one point.
        """
        before, self.now = sys.gettrace(), 0
        sys.settrace(self._enter)
        try:
            yield
        finally:
            sys.settrace(before)

    @property
    def places(self) -> list[str]:
        """``FILE:LINE`` of each line that has not run."""
        lines = {(code.co_filename, line) for code, rest in self.left.items() for line in rest}
        return [f"{file}:{line}" for file, line in sorted(lines)]

    def _add(self, item: Any) -> None:
        if not isinstance(item, FunctionType) or not is_own_file(item.__code__.co_filename):
            return
        code = item.__code__
        if code in self.left:
            return
        lines = {line for _, _, line in code.co_lines() if line and line > code.co_firstlineno}
        self.left[code] = lines
        for name in code.co_names:
            self._add(item.__globals__.get(name))

    def _enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        return self._line if frame.f_code in self.left else None

    def _line(self, frame: FrameType, event: str, argument: Any) -> Any:
        if event == "line":
            self.left[frame.f_code].discard(frame.f_lineno)
            self.now += 1
            if self.now > _LONGEST:
                place = f"{frame.f_code.co_filename}:{frame.f_lineno}"
                raise NoNumberError(f"{place}: it does not end within {_LONGEST} lines")
        return self._line
