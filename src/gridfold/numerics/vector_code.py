"""The same function with elementary functions that become vector instructions.

A loop that calls the sine of the C library takes one number after the other. Here a function and
all compiled functions that it reaches are copied, their source unchanged, so that ``np.sin``,
``np.cos``, ``np.exp`` and ``np.log``, or those of ``math``, are those of
:mod:`gridfold.numerics.elementary`. The copies take real numbers only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import CellType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

from gridfold.numerics.compiled import CALLBACK_OPTIONS, compiled_part
from gridfold.numerics.elementary import exponential, logarithm, sine_cosine


@compiled_part
def _sine(x):
    return sine_cosine(x)[0]


@compiled_part
def _cosine(x):
    return sine_cosine(x)[1]


_NUMBERS: Mapping[str, Any] = {
    "sin": _sine,
    "cos": _cosine,
    "exp": exponential,
    "log": logarithm,
}


def vector_code(function: Callable[..., Any]) -> Callable[..., Any]:
    """A copy of `function` that reaches vector functions alone."""
    copy: Callable[..., Any] = _Copies().function(function)
    return copy


class _Copies:
    """Copies of functions and modules, each made once."""

    def __init__(self) -> None:
        self.known: dict[int, Any] = {}

    def function(self, function: Any) -> Any:
        if id(function) in self.known:
            return self.known[id(function)]
        names: dict[str, Any] = {}
        copy = FunctionType(
            function.__code__,
            names,
            function.__name__,
            function.__defaults__,
            tuple(CellType(self.value(cell.cell_contents)) for cell in function.__closure__ or ()),
        )
        copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
        self.known[id(function)] = copy
        used = {name for code in _codes(function.__code__) for name in code.co_names}
        names["__name__"] = function.__module__
        names["__builtins__"] = function.__globals__["__builtins__"]
        for name in used & function.__globals__.keys():
            names[name] = self.value(function.__globals__[name])
        return copy

    def value(self, item: Any) -> Any:
        """What stands for a global value."""
        if id(item) in self.known:
            return self.known[id(item)]
        if item is np or item is math:
            found: Any = _module(item)
        elif isinstance(item, Dispatcher):
            found = njit(**CALLBACK_OPTIONS)(self.function(item.py_func))
        else:
            return item
        self.known[id(item)] = found
        return found


def _module(original: ModuleType) -> ModuleType:
    """A module with the vector functions in place of its own."""
    found = ModuleType(original.__name__)
    found.__dict__.update(original.__dict__)
    found.__dict__.update(_NUMBERS)
    return found


def _codes(code: Any) -> list[Any]:
    inner = [part for part in code.co_consts if isinstance(part, type(code))]
    return [code, *(found for part in inner for found in _codes(part))]
