"""The same function with elementary functions that become vector instructions.

A loop that calls the sine of the C library takes one number after the other. Here a function and
all compiled functions that it reaches are copied, their source unchanged, so that ``np.sin``,
``np.cos``, ``np.exp`` and ``np.log``, or those of ``math``, are those of
:mod:`gridfold.numerics.elementary`. The copies take real numbers only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from numba import njit

from gridfold.numerics.code_copies import CodeCopies
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
    copies = CodeCopies(_NUMBERS, njit(**CALLBACK_OPTIONS))
    copy: Callable[..., Any] = copies.function(function)
    return copy
