"""Compiled functions that are called by their address.

A right-hand side, and each device kernel inside it, is compiled once with one fixed signature and
then called through its address. A loop over addresses therefore serves every grid and every model
without being compiled again. Machine code is kept on disk (:mod:`gridfold.numerics.kernel_cache`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils, sigutils
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from gridfold.numerics.kernel_cache import kernel_cache

#: Relaxed floating-point rules that still honour infinities and NaN.
FAST = {"contract", "reassoc", "nsz"}

#: How callbacks are compiled: without reference counting, views of arrays cost nothing.
CALLBACK_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": FAST,
    "_nrt": False,
}


def compile_callback(function: Callable[..., Any], signature: Any, kind: str = "") -> Any:
    """Compile `function` for `signature` into a C callback with an ``address``, kept on disk.

    `kind` tells copies of one function from each other there.
    """
    callback: Any = CFunc(function, sigutils.normalize_signature(signature), {}, CALLBACK_OPTIONS)
    callback._cache = kernel_cache(function, CALLBACK_OPTIONS | {"kind": kind})
    callback.compile()
    return callback


def jit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: as that of Numba with these options, with machine code that is kept on disk."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = njit(**options)(function)
        dispatcher._cache = kernel_cache(function, options)
        return dispatcher

    return decorate


def compiled_part(function: Callable[..., Any]) -> Any:
    """Compile a function that callbacks call; like them it may view arrays but not create any."""
    return jit(**CALLBACK_OPTIONS)(function)


def _invoke(typing_context, address, arguments):
    if not isinstance(address, types.Integer) or not isinstance(arguments, types.BaseTuple):
        return None

    def generate(context, builder, signature, values):
        target, packed = values
        argument_types = [context.get_value_type(kind) for kind in signature.args[1].types]
        function_type = ir.FunctionType(context.get_value_type(types.none), argument_types)
        pointer = builder.inttoptr(target, function_type.as_pointer())
        builder.call(pointer, cgutils.unpack_tuple(builder, packed, len(argument_types)))
        return context.get_dummy_value()

    return types.void(address, arguments), generate


def _matrix_view(typing_context, vector, offset, rows, columns):
    if not isinstance(vector, types.Array) or vector.ndim != 1:
        return None
    view_type = types.Array(vector.dtype, 2, "C")

    def generate(context, builder, signature, values):
        base = context.make_array(signature.args[0])(context, builder, values[0])
        start, n_rows, n_columns = (
            context.cast(builder, value, kind, types.intp)
            for value, kind in zip(values[1:], signature.args[1:], strict=True)
        )
        item_size = context.get_constant(
            types.intp, context.get_abi_sizeof(context.get_data_type(vector.dtype))
        )
        view = context.make_array(view_type)(context, builder)
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        view.nitems = builder.mul(n_rows, n_columns)
        view.itemsize = item_size
        view.data = builder.gep(base.data, [start])
        view.shape = cgutils.pack_array(builder, [n_rows, n_columns])
        view.strides = cgutils.pack_array(builder, [builder.mul(n_columns, item_size), item_size])
        return view._getvalue()

    return view_type(vector, offset, rows, columns), generate


def _peek(typing_context, address):
    if not isinstance(address, types.Integer):
        return None

    def generate(context, builder, signature, values):
        pointer = builder.inttoptr(values[0], context.get_value_type(types.int64).as_pointer())
        return builder.load(pointer)

    return types.int64(address), generate


#: ``invoke(address, (a, b, ...))`` calls the compiled void function at `address`.
invoke: Any = intrinsic(_invoke)

#: ``matrix_view(vector, offset, rows, columns)``: a C-ordered matrix inside a flat vector. Nothing is
#: copied and nothing is checked; the view is valid as long as `vector` lives.
matrix_view: Any = intrinsic(_matrix_view)

#: ``peek(address)``: the 64-bit integer at `address`, as it is now; another thread may write it.
peek: Any = intrinsic(_peek)
