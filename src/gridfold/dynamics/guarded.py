"""Run a device's kernel in plain Python on matrices that check every access.

Compiled kernels are called by address, where nothing is checked. A kernel that nobody has tried
therefore runs here first: an index beyond the rows, a row that is not set or not to be set is a
:class:`SlipError` with its place, and not a wild access to memory.
"""

from __future__ import annotations

import operator
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CellType, CodeType, FunctionType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, Kernel
from gridfold.numerics.code_files import PACKAGE, is_installed, package_name

#: What each matrix of a kernel holds, for messages.
_CONTENTS = {"x": "states", "u": "inputs", "p": "parameters", "y": "outputs", "dx": "derivatives"}
_ORDERING = "not supported between instances"


class SlipError(Exception):
    """What is wrong with a kernel, in words."""


class NoNumberError(Exception):
    """The kernel has no value at the point tried, such as a division by zero."""


@dataclass
class GuardedMatrix:
    """A matrix (rows, units) of a kernel: indexed by row and unit, and by nothing else.

    Parameters
    ----------
    role : str
        Its name in kernels: x, u, p, y or dx.
    names : sequence of str
        Names of its rows; none where the kernel has no business with it.
    values : ndarray, shape (rows, units)
        Its entries, NaN where nothing is set.
    writable : range
        Rows that the kernel is to set.
    """

    role: str
    names: Sequence[str]
    values: NDArray[Any]
    writable: range = range(0)
    set_by_now: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.set_by_now = np.ones(self.values.shape, dtype=bool)
        self.set_by_now[list(self.writable)] = False

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and units."""
        return len(self.names), self.values.shape[1]

    def __getitem__(self, index: Any) -> Any:
        row, unit = self._place(index)
        if not self.set_by_now[row, unit]:
            raise SlipError(f"{self._row(row)} is read before it is set")
        value = self.values[row, unit]
        return complex(value) if np.iscomplexobj(self.values) else value

    def __setitem__(self, index: Any, value: Any) -> None:
        row, unit = self._place(index)
        if row not in self.writable:
            raise SlipError(f"{self._row(row)} is set, which is not this kernel's to set")
        if isinstance(value, bool | np.bool_) or np.ndim(value) or not isinstance(
            value, int | float | complex | np.number
        ):  # fmt: skip
            raise SlipError(f"{self._row(row)} is set to {_short(value)}, which is not a number")
        if isinstance(value, complex) and not np.iscomplexobj(self.values):
            raise SlipError(f"{self._row(row)} is set to the complex number {_short(value)}")
        self.values[row, unit] = value
        self.set_by_now[row, unit] = True

    def unset(self) -> Iterator[str]:
        """Rows that the kernel should have set and has not."""
        for row in self.writable:
            lacking = np.flatnonzero(~self.set_by_now[row])
            if len(lacking) == self.shape[1]:
                yield f"{self._row(row)} is not set"
            elif len(lacking):
                yield f"{self._row(row)} is not set for unit {lacking[0]} of {self.shape[1]}"

    def _place(self, index: Any) -> tuple[int, int]:
        if not isinstance(index, tuple) or len(index) != 2:
            raise SlipError(f"{self.role}[{_shown(index)}] is not indexed by row and unit")
        return self._position(index, 0), self._position(index, 1)

    def _position(self, index: tuple[Any, Any], axis: int) -> int:
        item, size = index[axis], self.shape[axis]
        if isinstance(item, slice):
            raise SlipError(
                f"{self.role}[{_shown(index)}] is a slice; kernels are loops over units"
            )
        try:
            if isinstance(item, bool | np.bool_):
                raise TypeError
            position = operator.index(item)
        except TypeError:
            what = ("row", "unit")[axis]
            raise SlipError(
                f"{self.role}[{_shown(index)}]: a {what} is a whole number, not {_short(item)}"
            ) from None
        if not 0 <= position < size:
            raise SlipError(f"{self.role}[{_shown(index)}] is beyond {self._extent(axis)}")
        return position

    def _extent(self, axis: int) -> str:
        if axis == 1:
            return f"the units 0 to {self.shape[1] - 1}"
        if not self.names:
            return f"its rows: this kernel has no {_CONTENTS[self.role]}"
        listed = ", ".join(f"{k} {name}" for k, name in enumerate(self.names))
        return f"its rows ({listed})"

    def _row(self, row: int) -> str:
        return f"row {row} of {self.role} ({self.names[row]})"


def run_guarded(
    device: Device,
    stage: str,
    kernel: Kernel,
    matrices: dict[str, NDArray[Any]],
    may_divide_by_zero: bool = True,
) -> dict[str, GuardedMatrix]:
    """Run the kernel of a stage; `matrices` are x, u, p and y, from which y is set further.

    A division by zero is no value where it `may_divide_by_zero` not: compiled for complex numbers a
    kernel ends there, whatever becomes of the quotient.

    Returns
    -------
    dict
        The matrices after the run.

    Raises
    ------
    SlipError
        The kernel does something that it must not, or fails; with the line of the file.
    NoNumberError
        It has no value here.
    """
    guarded = _matrices(device, stage, matrices)
    try:
        with np.errstate(all="ignore", divide="ignore" if may_divide_by_zero else "raise"):
            kernel(*guarded.values())
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, ArithmeticError) or "math domain" in str(error):
            raise NoNumberError(f"{_line(kernel, error)}{type(error).__name__}: {error}") from error
        raise SlipError(f"{_line(kernel, error)}{type(error).__name__}: {error}") from error
    except NoNumberError:
        raise
    except SlipError as error:
        raise SlipError(f"{_line(kernel, error)}{error}") from error
    except Exception as error:
        hint = ""
        if isinstance(error, TypeError) and _ORDERING in str(error) and "complex" in str(error):
            hint = "; compare real parts, .real"
        raise SlipError(f"{_line(kernel, error)}{type(error).__name__}: {error}{hint}") from error
    lacking = [text for matrix in guarded.values() for text in matrix.unset()]
    if lacking:
        raise SlipError(f"{kernel_place(kernel)}: {'; '.join(lacking)}")
    return guarded


def _matrices(
    device: Device, stage: str, given: dict[str, NDArray[Any]]
) -> dict[str, GuardedMatrix]:
    """The five matrices as the kernel of a stage sees them."""
    n, first = len(device.signal_rows), len(device.sources)
    to_set = {"source": range(first), "output": range(first, n)}.get(stage, range(0))
    rates = device.states if stage == "derivative" else ()
    y, dx = given["y"].copy(), np.full((len(rates), given["p"].shape[1]), np.nan, given["p"].dtype)
    y[list(to_set)] = np.nan
    return {
        "x": GuardedMatrix("x", device.states, given["x"]),
        "u": GuardedMatrix("u", () if stage == "source" else device.inputs, given["u"]),
        "p": GuardedMatrix("p", device.parameter_rows, given["p"]),
        "y": GuardedMatrix(
            "y", device.sources if stage == "source" else device.signal_rows, y, to_set
        ),
        "dx": GuardedMatrix("dx", rates, dx, range(len(rates))),
    }


def interpreted(function: Any) -> Any:
    """A copy of a function in which all that Numba compiles, there and in what it calls, is Python."""
    return _Copies().of(function)


class _Copies:
    """Copies of functions, one of each."""

    def __init__(self) -> None:
        self.known: dict[int, Any] = {}

    def of(self, item: Any) -> Any:
        plain = item.py_func if isinstance(item, Dispatcher) else item
        if not isinstance(plain, FunctionType) or not (
            package_name(plain.__module__) or not is_installed(plain.__code__.co_filename)
        ):
            return item
        if id(plain) not in self.known:
            names = dict(plain.__globals__)
            cells = tuple(CellType() for _ in plain.__closure__ or ())
            copy = FunctionType(
                plain.__code__, names, plain.__name__, plain.__defaults__, cells or None
            )
            copy.__kwdefaults__ = plain.__kwdefaults__
            self.known[id(plain)] = copy
            for name in _names_in(plain.__code__):
                if name in names:
                    names[name] = self.of(names[name])
            for cell, old in zip(cells, plain.__closure__ or (), strict=True):
                try:
                    cell.cell_contents = self.of(old.cell_contents)
                except ValueError:
                    continue
        return self.known[id(plain)]


def _names_in(code: CodeType) -> set[str]:
    inner = (item for item in code.co_consts if isinstance(item, CodeType))
    return set(code.co_names).union(*(_names_in(item) for item in inner))


def kernel_place(kernel: Callable[..., Any]) -> str:
    """File and first line of a kernel."""
    code = kernel.__code__
    return f"{code.co_filename}:{code.co_firstlineno}"


def _line(kernel: Callable[..., Any], error: BaseException) -> str:
    """File and line of a user's own from which an error came, ``"FILE:LINE: "``."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if is_own_file(f.filename)]
    return f"{frames[-1].filename}:{frames[-1].lineno}: " if frames else f"{kernel_place(kernel)}: "


def is_own_file(file: str) -> bool:
    """Whether a file is neither one of this package nor of an installed one."""
    return not is_installed(file) and PACKAGE not in Path(file).resolve().parents


def _shown(index: Any) -> str:
    parts = index if isinstance(index, tuple) else (index,)
    return ", ".join(":" if isinstance(item, slice) else _short(item) for item in parts)


def _short(value: Any) -> str:
    text = repr(value.item() if isinstance(value, np.generic) else value)
    return text if len(text) <= 40 else text[:40] + " ..."
