"""Copies of functions, their source unchanged, that reach other elementary functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher


class CodeCopies:
    """Copies of functions and modules, each made once.

    Parameters
    ----------
    numbers : mapping
        What stands for a function of ``np`` or ``math``, by name.
    compiled : callable
        Compiles the copy of a function that was compiled.
    literal : type, optional
        The type of number that floats in the sources of functions, and their global floats, become.
    """

    def __init__(
        self,
        numbers: Mapping[str, Any],
        compiled: Callable[[Any], Any],
        literal: Callable[[float], Any] | None = None,
    ) -> None:
        self.numbers, self.compiled, self.literal = numbers, compiled, literal
        self.known: dict[int, Any] = {}

    def function(self, function: Any) -> Any:
        """The copy of a function, and of all that it reaches."""
        if id(function) in self.known:
            return self.known[id(function)]
        names: dict[str, Any] = {}
        copy = FunctionType(
            self._code(function.__code__),
            names,
            function.__name__,
            self._number(function.__defaults__),
            tuple(CellType(self.value(cell.cell_contents)) for cell in function.__closure__ or ()),
        )
        copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
        self.known[id(function)] = copy
        names["__name__"] = function.__module__
        names["__builtins__"] = function.__globals__["__builtins__"]
        for name in used_names(function):
            names[name] = self.value(function.__globals__[name])
        return copy

    def value(self, item: Any) -> Any:
        """What stands for a global value."""
        if id(item) in self.known:
            return self.known[id(item)]
        if item is np or item is math:
            found: Any = ModuleType(item.__name__)
            found.__dict__.update(item.__dict__)
            found.__dict__.update(self.numbers)
        elif isinstance(item, Dispatcher):
            found = self.compiled(self.function(item.py_func))
        else:
            return self._number(item)
        self.known[id(item)] = found
        return found

    def _code(self, code: CodeType) -> CodeType:
        """The code, with the numbers that stand in it in their type."""
        if self.literal is None:
            return code
        return code.replace(co_consts=tuple(map(self._number, code.co_consts)))

    def _number(self, item: Any) -> Any:
        """A number in its type; anything else as it is."""
        if self.literal is None:
            return item
        if isinstance(item, CodeType):
            return self._code(item)
        if isinstance(item, tuple):
            found = map(self._number, item)
            return item._make(found) if hasattr(item, "_make") else tuple(found)
        return self.literal(item) if isinstance(item, float) else item


def used_names(function: Any) -> set[str]:
    """Names of the globals that a function uses."""
    used = {name for code in codes(function.__code__) for name in code.co_names}
    return {name for name in used if name in function.__globals__}


def codes(code: Any) -> list[Any]:
    """A code object and those inside it."""
    inner = [part for part in code.co_consts if isinstance(part, type(code))]
    return [code, *(found for part in inner for found in codes(part))]
