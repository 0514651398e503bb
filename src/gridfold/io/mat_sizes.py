"""Sizes that a MATLAB file declares for its variables, found without reading these.

A file of version 5 (MATLAB 6 to 7.2) is a header of 128 bytes and one element for each variable: a tag,
which is its type and its number of bytes, and the matrix, whole or compressed by zlib. MathWorks,
"MAT-File Format", chapter 1.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from typing import NamedTuple

_HEADER, _TAG = 128, 8
_MATRIX, _COMPRESSED = 14, 15
#: Bytes of a matrix in which its name begins and ends: flags, 32 dimensions at most, 63 letters.
_BEGIN = 512
#: A number may be stored in one byte and take eight once it is read.
_EXPANSION = 8


class Variable(NamedTuple):
    """A variable: its name, the most bytes that it takes once it is read, where its element is."""

    name: str
    size: int
    element: slice


def variables(content: bytes) -> Iterator[Variable]:
    """The variables of a file of version 5.

    What cannot be made out ends the list: the reader itself says what is wrong there.
    """
    if not _is_version_5(content):
        return
    order = "<" if content[126:128] == b"IM" else ">"
    at = _HEADER
    while at + _TAG <= len(content):
        kind, length = struct.unpack_from(f"{order}II", content, at)
        element = slice(at, at + _TAG + length)
        begin = content[at + _TAG : element.stop]
        at = element.stop
        if kind == _COMPRESSED:
            try:
                begin = zlib.decompressobj().decompress(begin, _BEGIN)
                kind, length = struct.unpack_from(f"{order}II", begin)
            except (zlib.error, struct.error):
                return
            begin = begin[_TAG:]
        if kind != _MATRIX:
            return
        yield Variable(_name(begin[:_BEGIN], order), _EXPANSION * length, element)


def without(content: bytes, unwanted: Iterable[Variable]) -> bytes:
    """The file without some of its variables."""
    kept, at = [], 0
    for variable in unwanted:
        kept.append(content[at : variable.element.start])
        at = variable.element.stop
    return b"".join([*kept, content[at:]])


def _is_version_5(content: bytes) -> bool:
    return len(content) >= _HEADER and content[126:128] in (b"IM", b"MI")


def _name(matrix: bytes, order: str) -> str:
    """Name of a matrix: its third element, after the flags and the dimensions; empty if not found."""
    at, data = 0, b""
    for _ in range(3):
        if at + _TAG > len(matrix):
            return ""
        (first,) = struct.unpack_from(f"{order}I", matrix, at)
        if first >> 16:  # a small element: its length is in the upper half, its data in the tag
            data = matrix[at + 4 : at + 4 + min(first >> 16, 4)]
            at += _TAG
        else:
            (length,) = struct.unpack_from(f"{order}I", matrix, at + 4)
            data = matrix[at + _TAG : at + _TAG + length]
            at += _TAG + (length + 7) // 8 * 8
    return data.decode("latin-1")
