"""Kernels that multiply where they divide by what parameters alone give.

A processor takes as long for a division of vectors as for some sixteen products. Time constants do not
change along a run: their inverses are found once, become further rows of the parameters, and the
kernel's divisions by them become products.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import CodeType, FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.numerics.code_files import package_name

#: Which of a kernel's matrices are the parameters.
_PARAMETERS = 2


@dataclass(frozen=True)
class Products:
    """A kernel without some of its divisions.

    Parameters
    ----------
    function : callable
        The kernel. Its last rows of parameters are those of :meth:`inverses`.
    divisors : tuple of callables
        What it divided by, of the parameters and a unit's place among them.
    """

    function: Callable[..., Any]
    divisors: tuple[Callable[..., Any], ...] = ()

    def inverses(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """The further rows (n_divisors, n_units) to parameters (n_rows, n_units)."""
        with np.errstate(divide="ignore", over="ignore"):
            found = [1 / divisor(parameters, slice(None)) for divisor in self.divisors]
        return np.array(found).reshape(len(found), parameters.shape[1])


@cache
def with_products(kernel: Callable[..., Any]) -> Products:
    """The kernel with products; as it is where it is none of the package's, or not a single loop."""
    function = _written(kernel)
    loops = (
        [] if function is None else [part for part in function.body if isinstance(part, ast.For)]
    )
    if function is None or len(loops) != 1 or not isinstance(loops[0].target, ast.Name):
        return Products(kernel)
    replaced = _Replaced(function.args.args[_PARAMETERS].arg, loops[0].target.id)
    replaced.visit(loops[0])
    if not replaced.divisors:
        return Products(kernel)
    for place, number in replaced.places:
        place.value = number - len(replaced.divisors)
    return Products(
        _compiled(ast.Module([function], []), "exec", kernel),
        tuple(
            _compiled(ast.Expression(replaced.as_function(item)), "eval", kernel)
            for item in replaced.divisors.values()
        ),
    )


def _written(kernel: Any) -> ast.FunctionDef | None:
    """A kernel of the package as it is written at the top of its file; None for another one."""
    if not package_name(kernel.__module__) or kernel.__closure__:
        return None
    try:
        lines, first = inspect.getsourcelines(kernel)
    except OSError:
        return None
    if lines[0].startswith((" ", "@")):
        return None
    found = ast.increment_lineno(ast.parse("".join(lines)), first - 1).body[0]
    return found if isinstance(found, ast.FunctionDef) else None


def _compiled(tree: Any, mode: str, kernel: Any) -> Callable[..., Any]:
    """The one function in a tree, with the names of `kernel`."""
    tree = ast.fix_missing_locations(tree)
    outer = compile(tree, kernel.__code__.co_filename, mode, dont_inherit=True)
    inner = next(part for part in outer.co_consts if isinstance(part, CodeType))
    function = FunctionType(inner, kernel.__globals__, kernel.__name__)
    function.__module__, function.__qualname__ = kernel.__module__, kernel.__qualname__
    return function


class _Replaced(ast.NodeTransformer):
    """Puts products in place of divisions by parameters of the unit at `index`.

    `divisors` are what it found, and `places` where the rows of their inverses are to be written.
    """

    def __init__(self, parameters: str, index: str):
        self.parameters, self.index = parameters, index
        self.divisors: dict[str, ast.expr] = {}
        self.places: list[tuple[ast.Constant, int]] = []

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        """A division becomes a product, if it is one by parameters."""
        if not (isinstance(node.op, ast.Div) and self._is_known(node.right)):
            self.generic_visit(node)
            return node
        text = ast.dump(node.right)
        self.divisors.setdefault(text, node.right)
        row = ast.Constant(0)
        self.places.append((row, list(self.divisors).index(text)))
        place = ast.Tuple([row, ast.Name(self.index, ast.Load())], ast.Load())
        inverse = ast.Subscript(ast.Name(self.parameters, ast.Load()), place, ast.Load())
        return ast.copy_location(ast.BinOp(self.visit(node.left), ast.Mult(), inverse), node)

    def as_function(self, divisor: ast.expr) -> ast.Lambda:
        """A divisor as a function of the parameters and the unit's place."""
        names = [ast.arg(self.parameters), ast.arg(self.index)]
        arguments = ast.arguments(
            posonlyargs=[], args=names, kwonlyargs=[], kw_defaults=[], defaults=[]
        )
        return ast.Lambda(arguments, divisor)

    def _is_known(self, divisor: ast.expr) -> bool:
        """Whether an expression is one of parameters of the unit, and not a mere number."""
        some = any(isinstance(part, ast.Subscript) for part in ast.walk(divisor))
        return some and self._has_nothing_else(divisor)

    def _has_nothing_else(self, part: ast.expr) -> bool:
        match part:
            case ast.BinOp(left, ast.Add() | ast.Sub() | ast.Mult() | ast.Div(), right):
                return self._has_nothing_else(left) and self._has_nothing_else(right)
            case ast.Constant(value):
                return isinstance(value, int | float)
            case ast.Subscript(ast.Name(matrix), ast.Tuple([ast.Name(), ast.Name(unit)])):
                return matrix == self.parameters and unit == self.index
        return False
