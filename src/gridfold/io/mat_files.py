"""Tables in MATLAB files of version 5 (MATLAB 6 to 7.2), whatever else and however much these hold.

A file is a header of 128 bytes and one element for each variable: a tag, which is its type and its
length in bytes, and a matrix, whole or compressed by zlib. MathWorks, "MAT-File Format", chapter 1.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.ceilings import size_text

Table = NDArray[np.float64]
#: A table, a structure of tables, or None for what is neither.
Value = Table | Mapping[str, Table | None] | None

_HEADER, _TAG = 128, 8
_MARKS = {b"IM": "<", b"MI": ">"}
_INT32, _UINT32, _MATRIX, _COMPRESSED = 5, 6, 14, 15
#: Types in which numbers are stored, and classes of matrices of numbers.
_STORED = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_STRUCTURE, _NUMBERS, _COMPLEX = 2, range(6, 16), 0x800
#: Bytes of a matrix in which its name begins and ends: flags, dimensions, a name of 63 letters.
_BEGIN = 512
#: A number may be stored in one byte and takes eight once it is read.
_EXPANSION = 8
_HDF5 = b"MATLAB 7.3"
_BROKEN = "the file breaks off, or is damaged"


class Variable(NamedTuple):
    """A variable: its name, the most bytes that it takes once it is read, and what it is read from."""

    name: str
    size: int
    content: bytes
    compressed: bool
    order: str


def variables(content: bytes) -> Iterator[Variable]:
    """The variables of a file, none of which is read.

    Raises
    ------
    ValueError
        It is no such file, or damaged.
    """
    if content.startswith(_HDF5):
        raise ValueError("it has the format of MATLAB 7.3; save it with the option -v7")
    if len(content) < _HEADER or content[126:128] not in _MARKS:
        raise ValueError("it is no MATLAB file of version 5 to 7.2")
    order = _MARKS[content[126:128]]
    at = _HEADER
    while at < len(content):
        kind, length = _numbers(content[at : at + _TAG], f"{order}II")
        inside = content[at + _TAG : at + _TAG + length]
        at += _TAG + length
        if kind not in (_MATRIX, _COMPRESSED) or len(inside) < length:
            raise ValueError(_BROKEN)
        begin = inside[:_BEGIN]
        if kind == _COMPRESSED:
            begin = _inflated(inside, _BEGIN)
            kind, length = _numbers(begin[:_TAG], f"{order}II")
            begin = begin[_TAG:]
            yield Variable(_name(begin, order), _EXPANSION * length, inside, True, order)
        else:
            yield Variable(_name(begin, order), _EXPANSION * length, inside, False, order)


def read_tables(content: bytes, wanted: Collection[str], largest: int) -> dict[str, Value]:
    """The variables `wanted` that are in a file.

    Parameters
    ----------
    content : bytes
        The file.
    wanted : collection of str
        Names of variables; others are not read.
    largest : int
        Bytes that one may take.

    Raises
    ------
    ValueError
        It is no such file, damaged, or a variable is larger.
    """
    found: dict[str, Value] = {}
    for variable in variables(content):
        if variable.name not in wanted:
            continue
        if variable.size > largest:
            raise ValueError(
                f"{variable.name} would take {size_text(variable.size)} of memory, more than "
                f"{size_text(largest)}"
            )
        inside = variable.content
        if variable.compressed:
            inside = _inflated(inside, variable.size // _EXPANSION + _TAG)[_TAG:]
        found[variable.name] = _matrix(inside, variable.order, structures=True)
    return found


def _matrix(content: bytes, order: str, structures: bool = False) -> Any:
    """Value of a matrix; a structure counts only where `structures` are looked for."""
    parts = _Elements(content, order)
    (flags,) = parts.numbers(_UINT32)[:1]
    shape = parts.numbers(_INT32)
    parts.next()  # the name
    size = math.prod(shape)
    kind = flags & 0xFF
    if min(shape) < 0 or len(shape) < 2:
        raise ValueError(_BROKEN)
    if kind in _NUMBERS and not flags & _COMPLEX:
        stored, data = parts.next()
        if stored not in _STORED:
            raise ValueError(_BROKEN)
        values = np.frombuffer(data, order + _STORED[stored])
        return values.astype(np.float64).reshape(shape, order="F")
    if kind == _STRUCTURE and structures and size == 1:
        (length,) = parts.numbers(_INT32)
        _, names = parts.next()
        if length < 1:
            raise ValueError(_BROKEN)
        keys = [names[k : k + length] for k in range(0, len(names), length)]
        return {_text(key): _field(parts, order) for key in keys}
    return None


def _field(parts: _Elements, order: str) -> Any:
    kind, content = parts.next()
    if kind != _MATRIX:
        raise ValueError(_BROKEN)
    return _matrix(content, order) if content else None


class _Elements:
    """The elements of a matrix, one after the other."""

    def __init__(self, content: bytes, order: str):
        self._content, self._order, self._at = content, order, 0

    def next(self) -> tuple[int, bytes]:
        """Type and content of the next one."""
        kind, length = _numbers(self._content[self._at : self._at + _TAG], f"{self._order}II")
        begin = self._at + _TAG
        if kind >> 16:  # a small one: its length is in the upper half, its content in the tag
            kind, length, begin = kind & 0xFFFF, kind >> 16, self._at + _TAG // 2
            self._at += _TAG
        else:
            self._at = begin + -(-length // _TAG) * _TAG
        content = self._content[begin : begin + length]
        if len(content) < length or (begin % _TAG and length > _TAG // 2):
            raise ValueError(_BROKEN)
        return kind, content

    def numbers(self, kind: int) -> tuple[int, ...]:
        """The next one, as whole numbers."""
        found, content = self.next()
        letter = {_INT32: "i", _UINT32: "I"}[kind]
        if found != kind or not content:
            raise ValueError(_BROKEN)
        return _numbers(content, f"{self._order}{len(content) // 4}{letter}")


def _numbers(content: bytes, form: str) -> tuple[int, ...]:
    try:
        return struct.unpack(form, content)
    except struct.error:
        raise ValueError(_BROKEN) from None


def _inflated(content: bytes, most: int) -> bytes:
    """The first `most` bytes of compressed content."""
    try:
        return zlib.decompressobj().decompress(content, most)
    except zlib.error:
        raise ValueError(_BROKEN) from None


def _name(begin: bytes, order: str) -> str:
    """Name of a matrix: its third element, after the flags and the dimensions."""
    parts = _Elements(begin, order)
    for _ in range(2):
        parts.next()
    return _text(parts.next()[1])


def _text(content: bytes) -> str:
    return content.partition(b"\0")[0].decode("latin-1")
