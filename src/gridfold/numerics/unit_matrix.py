"""Matrices of shape (rows, units) inside flat vectors, as the kernels of devices see them.

In a kernel such a matrix is indexed by row and unit like an array, ``x[ROW, i]``, and has a ``shape``.
It costs less than an array: three numbers are handed over and not ten, and the compiler is told that
neither the matrices of a kernel nor their rows overlap, so it need not check that while running.
"""

from __future__ import annotations

import operator
from math import nan
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import (
    intrinsic,
    lower_builtin,
    make_attribute_wrapper,
    models,
    overload_attribute,
    register_model,
    type_callable,
)

#: What a kernel's matrices are to it.
ROLES = ("x", "u", "p", "y", "dx")


class UnitMatrix(types.Type):
    """Numba type of a matrix of `dtype`; kernels know each of theirs by another `role`.

    Outside of one that is `guarded` what is read is NaN, and what is written is lost.
    """

    def __init__(self, dtype: Any, role: str = "", guarded: bool = False):
        self.dtype, self.role, self.guarded = dtype, role, guarded
        super().__init__(name=f"UnitMatrix({dtype}, {role!r}{', guarded' if guarded else ''})")


@register_model(UnitMatrix)
class _Model(models.StructModel):
    def __init__(self, manager: Any, kind: UnitMatrix):
        members = [
            ("data", types.CPointer(kind.dtype)),
            ("rows", types.intp),
            ("units", types.intp),
        ]
        super().__init__(manager, kind, members)


make_attribute_wrapper(UnitMatrix, "rows", "rows")
make_attribute_wrapper(UnitMatrix, "units", "units")


@overload_attribute(UnitMatrix, "shape")
def _shape(matrix):
    return lambda matrix: (matrix.rows, matrix.units)


@type_callable(operator.getitem)
def _type_getitem(context):
    def typer(matrix, index):
        if isinstance(matrix, UnitMatrix) and _is_place(index):
            return matrix.dtype
        return None

    return typer


@type_callable(operator.setitem)
def _type_setitem(context):
    def typer(matrix, index, value):
        if isinstance(matrix, UnitMatrix) and _is_place(index):
            return types.none
        return None

    return typer


def _is_place(index: Any) -> bool:
    return (
        isinstance(index, types.UniTuple | types.Tuple)
        and len(index) == 2
        and all(isinstance(kind, types.Integer) for kind in index.types)
    )


@lower_builtin(operator.getitem, UnitMatrix, types.BaseTuple)
def _getitem(context, builder, signature, values):
    kind, index = signature.args
    value = builder.load(_place(context, builder, kind, values[0], index, values[1]))
    _tell_apart(builder, value, kind)
    return value


@lower_builtin(operator.setitem, UnitMatrix, types.BaseTuple, types.Any)
def _setitem(context, builder, signature, values):
    kind, index, given = signature.args
    place = _place(context, builder, kind, values[0], index, values[1])
    value = context.cast(builder, values[2], given, kind.dtype)
    _tell_apart(builder, builder.store(value, place), kind)
    return context.get_dummy_value()


def _place(context, builder, kind, matrix, index, indices):
    """Pointer to an entry; a negative index counts from the end, as in an array."""
    view = cgutils.create_struct_proxy(kind)(context, builder, value=matrix)
    row, unit = (
        _from_start(builder, context.cast(builder, value, given, types.intp), size)
        for value, given, size in zip(
            cgutils.unpack_tuple(builder, indices),
            index.types,
            (view.rows, view.units),
            strict=True,
        )
    )
    place = builder.gep(view.data, [builder.add(builder.mul(row, view.units), unit)])
    if not kind.guarded:
        return place
    inside = builder.and_(
        builder.icmp_unsigned("<", row, view.rows), builder.icmp_unsigned("<", unit, view.units)
    )
    nowhere = context.get_constant_generic(builder, kind.dtype, kind.dtype.cast_python_value(nan))
    spare = cgutils.alloca_once(builder, nowhere.type)
    builder.store(nowhere, spare)
    return builder.select(inside, place, spare)


def _from_start(builder, index, size):
    below = builder.icmp_signed("<", index, index.type(0))
    return builder.select(below, builder.add(index, size), index)


def _tell_apart(builder, access, kind):
    """Mark an access to a matrix: matrices of other roles are not touched by it."""
    if kind.role not in ROLES:
        return
    module = builder.module
    domain = module.add_metadata(["gridfold unit matrices"])
    scopes = {role: module.add_metadata([f"gridfold {role}", domain]) for role in ROLES}
    others = [scope for role, scope in scopes.items() if role != kind.role]
    access.set_metadata("alias.scope", module.add_metadata([scopes[kind.role]]))
    access.set_metadata("noalias", module.add_metadata(others))


def _view(role: str = "") -> Any:
    def view(typing_context, vector, offset, rows, units):
        if not isinstance(vector, types.Array) or vector.layout != "C":
            return None
        kind = UnitMatrix(vector.dtype, role)

        def generate(context, builder, signature, values):
            base = context.make_array(signature.args[0])(context, builder, values[0])
            start, n_rows, n_units = (
                context.cast(builder, value, given, types.intp)
                for value, given in zip(values[1:], signature.args[1:], strict=True)
            )
            matrix = cgutils.create_struct_proxy(kind)(context, builder)
            matrix.data = builder.gep(base.data, [start])
            matrix.rows, matrix.units = n_rows, n_units
            return matrix._getvalue()

        return kind(vector, offset, rows, units), generate

    return intrinsic(view)


#: ``unit_matrix(vector, offset, rows, units)``: such a matrix inside a flat vector, or another array
#: in C order. Nothing is copied and nothing is checked; it is valid as long as `vector` lives.
unit_matrix: Any = _view()
#: The same where the compiler may rely on it that what is given, what changes and what is written in
#: one function do not overlap.
given_matrix: Any = _view("p")
state_matrix: Any = _view("x")
result_matrix: Any = _view("dx")
