"""Eight numbers at once: the vector unit of the processor, said in so many words.

Members of a batch stand side by side, in groups of :data:`WIDTH`. What is done to all of them is
written once, on values of the type :class:`Lanes`, and does not depend on whether a compiler finds
out that a loop is a vector. Lanes are added, subtracted, multiplied and divided like numbers, with
each other or with one number.
"""

from __future__ import annotations

import operator
from math import prod
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable
from numpy.typing import NDArray

#: Numbers in a group.
WIDTH = 8

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_CONTRACT = ("contract",)


def aligned_zeros(*shape: int) -> NDArray[np.float64]:
    """Zeros whose groups of :data:`WIDTH` do not lie across two lines of the cache.

    A register that is loaded across two lines costs as much as two.
    """
    size = prod(shape)
    room = np.zeros(size + WIDTH)
    first = -room.ctypes.data // room.itemsize % WIDTH
    return room[first : first + size].reshape(shape)


def aligned(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A copy of numbers that begins where those of :func:`aligned_zeros` do."""
    copy = aligned_zeros(*values.shape)
    copy[...] = values
    return copy


class Lanes(types.Type):
    """Numba type of eight numbers."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES = Lanes()


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes):
        super().__init__(manager, kind, _VECTOR)


def _operation(operation: Any, name: str) -> None:
    @type_callable(operation)
    def type_operation(context):
        def typer(a, b):
            if isinstance(a, Lanes) and isinstance(b, Lanes | types.Float):
                return LANES
            return LANES if isinstance(b, Lanes) and isinstance(a, types.Float) else None

        return typer

    def lower(context, builder, signature, values):
        a, b = (
            value if isinstance(kind, Lanes) else _spread(builder, value)
            for value, kind in zip(values, signature.args, strict=True)
        )
        return getattr(builder, name)(a, b, flags=_CONTRACT)

    for pair in ((Lanes, Lanes), (Lanes, types.Float), (types.Float, Lanes)):
        lower_builtin(operation, *pair)(lower)


_operation(operator.add, "fadd")
_operation(operator.sub, "fsub")
_operation(operator.mul, "fmul")
_operation(operator.truediv, "fdiv")


def _spread(builder: Any, value: Any) -> Any:
    """The same number in all lanes."""
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, undefined, mask)


def _place(context: Any, builder: Any, kind: Any, vector: Any, at: Any) -> Any:
    data = context.make_array(kind)(context, builder, vector).data
    return builder.bitcast(builder.gep(data, [at]), _VECTOR.as_pointer())


def _is_flat(vector: Any) -> bool:
    return (
        isinstance(vector, types.Array) and vector.layout == "C" and vector.dtype == types.float64
    )


def _load(typing_context, vector, at):
    if not _is_flat(vector):
        return None

    def generate(context, builder, signature, values):
        place = _place(context, builder, signature.args[0], values[0], values[1])
        loaded = builder.load(place)
        loaded.align = 8
        return loaded

    return LANES(vector, types.intp), generate


def _store(typing_context, vector, at, value):
    if not _is_flat(vector):
        return None

    def generate(context, builder, signature, values):
        place = _place(context, builder, signature.args[0], values[0], values[1])
        builder.store(values[2], place).align = 8
        return context.get_dummy_value()

    return types.void(vector, types.intp, LANES), generate


def _all(typing_context, value):
    def generate(context, builder, signature, values):
        return _spread(builder, values[0])

    return LANES(types.float64), generate


def _of_each(name: str) -> Any:
    """A function of LLVM that takes each of eight numbers."""

    def typer(typing_context, value):
        def generate(context, builder, signature, values):
            kind = ir.FunctionType(_VECTOR, [_VECTOR])
            function = cgutils.get_or_insert_function(
                builder.module, kind, f"llvm.{name}.v{WIDTH}f64"
            )
            return builder.call(function, values)

        return LANES(LANES), generate

    return typer


def _beyond(typing_context, value, limit):
    def generate(context, builder, signature, values):
        above = builder.fcmp_unordered(">", *values)
        return builder.uitofp(above, _VECTOR)

    return LANES(LANES, LANES), generate


def _where_less(typing_context, a, b, yes, no):
    def generate(context, builder, signature, values):
        less = builder.fcmp_ordered("<", values[0], values[1])
        return builder.select(less, values[2], values[3])

    return LANES(LANES, LANES, LANES, LANES), generate


#: ``load_lanes(vector, at)``: eight numbers from position `at` on. Nothing is checked.
load_lanes: Any = intrinsic(_load)
#: ``store_lanes(vector, at, value)``.
store_lanes: Any = intrinsic(_store)
#: ``all_lanes(number)``: the same number in all lanes.
all_lanes: Any = intrinsic(_all)
#: ``size_lanes(value)``: magnitudes.
size_lanes: Any = intrinsic(_of_each("fabs"))
#: ``root_lanes(value)``: square roots.
root_lanes: Any = intrinsic(_of_each("sqrt"))
#: ``beyond_lanes(value, limit)``: 1 where `value` is above `limit`, or one is not a number; else 0.
beyond_lanes: Any = intrinsic(_beyond)
#: ``where_less(a, b, yes, no)``: `yes` where `a` is below `b`, else `no`.
where_less: Any = intrinsic(_where_less)
