"""NumPy archives of which nothing is believed: what they say of themselves is checked first.

An archive says twice how large its arrays are, in the directory of the zip file and at the head of each
array. No memory is taken for an array before both agree with each other, with the size of the file and
with what is expected. Nothing is ever unpickled.
"""

from __future__ import annotations

import stat
import zipfile
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from gridfold.errors import CaseFileError

#: Bytes that one compressed byte can stand for, and that an array may have in memory.
_DEFLATE_LIMIT, _LARGEST = 1032, 2**32
#: Characters that a text in an array may have, and bytes at the head of an array.
_LONGEST_TEXT, _HEAD = 256, 4096
_DAMAGED = "this is not a NumPy archive, or it is damaged"
#: What a damaged archive makes the readers of Python and NumPy raise.
_READ_ERRORS = (
    EOFError, KeyError, NotImplementedError, OverflowError, RuntimeError, SyntaxError, TypeError,
    ValueError, UnicodeError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


@dataclass(frozen=True)
class ArrayForm:
    """What an array has to be.

    Parameters
    ----------
    kind : {"f", "i", "U"}
        Finite numbers of 8 bytes, integers of 8 bytes, or texts.
    shape : tuple of int or str
        Its lengths. One with a name is free, but the same wherever that name stands.
    below : int or str, optional
        Integers are positions: from 0 to one less than this length.
    optional : bool
        It may be missing.
    """

    kind: str
    shape: tuple[int | str, ...]
    below: int | str | None = None
    optional: bool = False


@dataclass(frozen=True)
class Forms:
    """What an archive has to hold: arrays by name, and the largest value of each free length."""

    arrays: Mapping[str, ArrayForm]
    ceilings: Mapping[str, int]


@dataclass(frozen=True)
class _Head:
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        return prod(self.shape) * self.dtype.itemsize


class ArrayArchive:
    """An archive that is open, with the heads of its arrays. Get it by :func:`open_arrays`."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, size: int):
        self.path, self._archive = path, archive
        self._heads: dict[str, _Head] = {}
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            if info.filename == name or name in self._heads:
                raise CaseFileError(
                    f"{info.filename!r} is no array, or stands there twice", str(path)
                )
            with archive.open(info) as stream:
                head, start = _read_head(stream)
            claimed = head.size + start
            if claimed != info.file_size or claimed > _DEFLATE_LIMIT * min(
                info.compress_size, size
            ):
                raise CaseFileError(
                    f"{name} has {head.size} bytes by its head, which the {size} bytes of the file "
                    "do not hold",
                    str(path),
                )
            self._heads[name] = head

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the arrays."""
        return tuple(self._heads)

    def text(self, name: str) -> str | None:
        """The single text of an array without lengths; None if it is not there or another one."""
        head = self._heads.get(name)
        if head is None or head.dtype.kind != "U" or head.shape != () or head.size > _LARGEST:
            return None
        return str(self._read(name))

    def arrays(self, forms: Forms, beside: Collection[str] = ()) -> dict[str, NDArray[Any]]:
        """All arrays but those `beside`, once their heads are what they have to be.

        Raises
        ------
        CaseFileError
            An array is missing, not known, or is not what it has to be: every one of them.
        """
        faults, lengths = _compare(self._heads, forms, beside)
        found: dict[str, NDArray[Any]] = {}
        if not faults:
            with _telling(self.path):
                found = {name: self._read(name) for name in self._heads if name not in beside}
            for name, array in found.items():
                faults += _values(name, array, forms.arrays[name], lengths)
        if faults:
            raise CaseFileError(faults, str(self.path))
        return found

    def _read(self, name: str) -> NDArray[Any]:
        with _telling(self.path), self._archive.open(f"{name}.npy") as stream:
            return npy.read_array(stream, allow_pickle=False, max_header_size=_HEAD)


@contextmanager
def open_arrays(path: Path) -> Iterator[ArrayArchive]:
    """Open an archive and read the heads of its arrays.

    Raises
    ------
    CaseFileError
        It is no plain file, cannot be read, or is no archive whose sizes agree.
    """
    with _telling(path):
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise CaseFileError("this is not a plain file", str(path))
        archive = zipfile.ZipFile(path)
    with archive:
        with _telling(path):
            opened = ArrayArchive(path, archive, status.st_size)
        yield opened


def arrays_digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of names, types, shapes and contents, as hexadecimal digits."""
    digest = sha256()
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name}\0{array.dtype.str}\0{array.shape}\0".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _read_head(stream: IO[bytes]) -> tuple[_Head, int]:
    """Type and shape of an array, and where its content begins."""
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of an array")
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream, max_header_size=_HEAD)
    if dtype.hasobject or dtype.kind not in "fiuU" or any(length < 0 for length in shape):
        raise ValueError(f"an array of {dtype}")
    return _Head(dtype, tuple(int(length) for length in shape)), stream.tell()


def _compare(
    heads: Mapping[str, _Head], forms: Forms, beside: Collection[str]
) -> tuple[list[str], dict[str, int]]:
    """What is wrong with the heads, and the free lengths."""
    wanted = {name for name, form in forms.arrays.items() if not form.optional}
    faults = [f"array {name} is missing" for name in sorted(wanted - heads.keys())]
    lengths: dict[str, int] = {}
    deciding: dict[str, str] = {}
    total = 0
    for name, head in heads.items():
        if name in beside:
            continue
        if name not in forms.arrays:
            faults.append(f"array {name!r} is not known")
            continue
        form = forms.arrays[name]
        total += head.size
        if not _is_kind(head.dtype, form.kind):
            faults.append(f"{name} has type {head.dtype}, which it must not")
        for length, found in zip(form.shape, head.shape, strict=False):
            if isinstance(length, str) and length not in lengths:
                lengths[length] = min(found, forms.ceilings[length])
                deciding[length] = name
        expected = tuple(lengths.get(str(length), length) for length in form.shape)
        if expected != head.shape:
            others = sorted({deciding.get(str(n), name) for n in form.shape} - {name})
            like = f" as for {' and '.join(others)}" if others else ""
            asked = ", ".join(map(str, expected)) + ("," if len(expected) == 1 else "")
            faults.append(f"{name} has shape {head.shape}, expected ({asked}){like}")
    if total > _LARGEST:
        faults.append(
            f"the arrays have {total / 2**30:.1f} GiB, more than {_LARGEST / 2**30:g} GiB"
        )
    return faults, lengths


def _is_kind(dtype: np.dtype[Any], kind: str) -> bool:
    if kind == "U":
        return dtype.kind == "U" and dtype.isnative and dtype.itemsize <= 4 * _LONGEST_TEXT
    return dtype == np.dtype(f"{kind}8")


def _values(
    name: str, array: NDArray[Any], form: ArrayForm, lengths: Mapping[str, int]
) -> Iterator[str]:
    """What is wrong with the entries of an array."""
    if form.kind == "f" and not np.isfinite(array).all():
        yield f"{name} is not finite"
    if form.below is not None and array.size:
        below = lengths[form.below] if isinstance(form.below, str) else form.below
        lowest, highest = int(array.min()), int(array.max())
        if lowest < 0 or highest >= below:
            worst = lowest if lowest < 0 else highest
            yield f"{name} holds position {worst}, which is not from 0 to {below - 1}"


@contextmanager
def _telling(path: Path) -> Iterator[None]:
    """What goes wrong with a file as a :class:`CaseFileError`."""
    try:
        yield
    except CaseFileError:
        raise
    except OSError as error:
        raise CaseFileError(
            f"the file cannot be read: {error.strerror or error}", str(path)
        ) from None
    except _READ_ERRORS:
        raise CaseFileError(_DAMAGED, str(path)) from None
