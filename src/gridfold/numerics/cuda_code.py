"""The same function for a GPU: what CUDA's compiler does not know of NumPy is put in its place here.

A function and all compiled functions that it reaches are copied, their source unchanged, and become
device functions. There ``np.sin`` and its like are those of ``math``, which take one number.
"""

from __future__ import annotations

import dis
import math
from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from gridfold.numerics.code_copies import CodeCopies, codes, used_names


def _larger(a, b):
    return a if a >= b or a != a else b


def _smaller(a, b):
    return a if a <= b or a != a else b


def _sign(x):
    return 1.0 if x > 0 else (-1.0 if x < 0 else 0.0 * x)


def _floor(x):
    return float(math.floor(x))


def _ceil(x):
    return float(math.ceil(x))


#: Written here, and compiled with what uses them.
_OWN = {"maximum": _larger, "minimum": _smaller, "sign": _sign, "floor": _floor, "ceil": _ceil}
#: What stands for a function of NumPy, or of ``math`` under the same name.
_NUMBERS: Mapping[str, Any] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arcsin": math.asin,
    "arccos": math.acos,
    "arctan": math.atan,
    "arctan2": math.atan2,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "hypot": math.hypot,
    "abs": abs,
    "fabs": math.fabs,
    "isfinite": math.isfinite,
    "isnan": math.isnan,
    "pi": math.pi,
    "e": math.e,
    "inf": math.inf,
    "nan": math.nan,
}
#: Names of ``np`` and ``math`` that a function may use on a GPU.
KNOWN_NAMES = frozenset(_NUMBERS) | frozenset(_OWN)
_KNOWN_VALUES = frozenset(map(id, (np, math, *_NUMBERS.values())))
_BUILT_IN = frozenset({"abs", "float", "int", "len", "max", "min", "range"})


def device_code(
    function: Callable[..., Any],
    number: type[np.floating[Any]] = np.float64,
    compiled: Callable[[Any], Any] | None = None,
) -> Any:
    """`function` as a device function of CUDA; it uses no more than :func:`unknown_names` lets it.

    Parameters
    ----------
    number : type
        That of all numbers that stand in its source, so that they make none of its numbers double.
    compiled : callable, optional
        What compiles it, and what it calls, instead of CUDA's compiler.
    """
    if compiled is None:
        from numba import cuda

        compiled = cuda.jit(device=True)
    literal = None if number is np.float64 else number
    known = {
        name: number(item) if isinstance(item, float) else item for name, item in _NUMBERS.items()
    }
    parts = CodeCopies(known, compiled, literal)
    own = {name: compiled(parts.function(part)) for name, part in _OWN.items()}
    return compiled(CodeCopies({**known, **own}, compiled, literal).function(function))


def unknown_names(function: Any) -> list[str]:
    """What a function, or one that it calls, uses and CUDA does not know, such as ``np.interp``."""
    return sorted(set(_unknown(function, set())))


def _unknown(function: Any, seen: set[int]) -> Iterator[str]:
    if id(function) in seen:
        return
    seen.add(id(function))
    for code in codes(function.__code__):
        yield from _unknown_attributes(code, function.__globals__)
    for code in codes(function.__code__):
        for instruction in dis.get_instructions(code):
            name = instruction.argval
            known = name in function.__globals__ or name in _BUILT_IN
            if instruction.opname == "LOAD_GLOBAL" and not known:
                yield str(name)
    values = {name: function.__globals__[name] for name in used_names(function)}
    closed = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    values |= {name: cell.cell_contents for name, cell in closed}
    for name, value in values.items():
        if isinstance(value, Dispatcher):
            yield from _unknown(value.py_func, seen)
        elif not _is_constant(value) and id(value) not in _KNOWN_VALUES:
            yield name


def _unknown_attributes(code: Any, names: Mapping[str, Any]) -> Iterator[str]:
    """What is taken of ``np`` and ``math`` and is not known."""
    module = ""
    for instruction in dis.get_instructions(code):
        taken = module and instruction.opname in ("LOAD_ATTR", "LOAD_METHOD")
        if taken and instruction.argval not in KNOWN_NAMES:
            yield f"{module}.{instruction.argval}"
        value = names.get(instruction.argval) if instruction.opname == "LOAD_GLOBAL" else None
        module = instruction.argval if isinstance(value, ModuleType) else ""


def _is_constant(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return isinstance(value, bool | int | float | np.number)
