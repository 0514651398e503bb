"""Machine code on disk, in a folder for each state of the sources that it was made from.

Numba's own cache looks at the file of a function alone, and so runs old code where something changes
that the function calls. Here the folder's name is a digest of all sources of the package that reach
compiled code and of the versions of the compiler; what lies outside the package is named by its own
sources and values besides (:mod:`gridfold.numerics.code_digest`).

Every overload is one file, written under another name first: processes may share a folder.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from inspect import getsourcefile
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import config
from numba.core.caching import FunctionCache, NullCache, _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from gridfold.numerics.code_digest import code_digest
from gridfold.numerics.code_files import (
    CODE,
    Code,
    is_installed,
    package_digest,
    package_name,
    read_code,
)
from gridfold.numerics.compile_notice import NOTICE
from gridfold.numerics.user_folders import temporary_folder, user_folder

#: Parts of the package that compiled code may come from, or take constants from.
COMPILED_PARTS = ("numerics", "systems", "dynamics", "powerflow", "grid", "errors.py", "cards.py")
#: Folders that are kept, and days without use after which one is removed.
_MOST_FOLDERS, _DAYS = 16, 30
#: Files in a folder behind which nothing more is kept.
_MOST_FILES = 2000
_DAY, _HOUR = 86400, 3600


def _label(*parts: object) -> str:
    return sha256("\n".join(map(str, parts)).encode()).hexdigest()[:24]


_READ_AT = time.time_ns()
#: SHA-256 of all sources of the package, as they were when it was imported.
SOURCES = package_digest()
_COMPILER = (numba.__version__, llvmlite.__version__, np.__version__, sys.implementation.cache_tag)
_BASE = _label(package_digest(COMPILED_PARTS), *_COMPILER)


class KernelCache(_Cache):
    """The overloads of one function on disk. What cannot be read or written is compiled anew.

    Parameters
    ----------
    function : callable
        The function.
    options : mapping
        Options with which it is compiled.
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]):
        self._folder, identity = _place(function, options)
        name = f"{function.__module__}.{function.__qualname__}".replace("<", "").replace(">", "")
        self._name, self._identity = name[-80:], identity

    @property
    def cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled code for a signature; None if there is none."""
        found = self._read(sig, target_context)
        if found is None:
            NOTICE.begin((self._name, sig))
        return found

    def _read(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        file = self._file(sig, target_context.codegen())
        try:
            content = file.read_bytes()
        except OSError:
            return None
        if content[:32] != sha256(content[32:]).digest():
            return None
        try:
            there, data = pickle.loads(content[32:])
            return CompileResult._rebuild(target_context, *data) if there == sig else None
        except Exception:  # of a module that is not to be found here: it is compiled anew
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled code for a signature."""
        NOTICE.end((self._name, sig))
        if data.library.has_dynamic_globals or any(not part.can_cache for part in data.lifted):
            return
        content = dumps((sig, data._reduce()))
        with contextlib.suppress(OSError):
            if _has_room(self._folder):
                _write(self._file(sig, data.codegen), sha256(content).digest() + content)

    def _file(self, sig: Any, codegen: Any) -> Path:
        key = _label(self._name, sig, codegen.magic_tuple(), self._identity)
        return self._folder / f"{self._name}-{key}.machine"

    def enable(self) -> None:
        """It always is."""

    def disable(self) -> None:
        """It never is."""

    def flush(self) -> None:
        """Nothing is kept in memory."""


@dataclass(frozen=True)
class KeptCode:
    """Where the package's own compiled code is kept.

    Parameters
    ----------
    folder : Path
        The folder of this version.
    functions : int
        Files in it, one for each function and signature.
    temporary : bool
        Whether it is gone when this process ends.
    """

    folder: Path
    functions: int
    temporary: bool


def kept_code() -> KeptCode:
    """Where the package's own compiled code is kept, and how much of it."""
    folder = _folder(_BASE)
    count = sum(1 for _ in folder.glob("*.machine"))
    return KeptCode(folder, count, folder.parent not in _lasting_roots())


def _has_room(folder: Path) -> bool:
    return not folder.is_dir() or sum(1 for _ in folder.iterdir()) < _MOST_FILES


def _write(file: Path, content: bytes) -> None:
    file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=".new-")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        Path(name).replace(file)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def kernel_cache(function: Callable[..., Any], options: Mapping[str, Any]) -> _Cache:
    """Where the code of a function is kept; nowhere if its source has changed since it was read."""
    if package_name(function.__module__) and _changed(function.__module__):
        return NullCache()
    return KernelCache(function, options)


def _changed(module: str) -> bool:
    """Whether the file of a module of the package is newer than the digest."""
    try:
        status = Path(str(sys.modules[module].__file__)).stat()
    except (KeyError, OSError):
        return True
    return max(status.st_mtime_ns, status.st_ctime_ns) > _READ_AT


def _place(function: Callable[..., Any], options: Mapping[str, Any]) -> tuple[Path, str]:
    """The folder of a function's code, and what tells it from others of its name besides."""
    asked, _ = code_digest(options)
    if package_name(function.__module__):
        code, cells = function.__code__, function.__closure__ or ()
        closed, _ = code_digest([cell.cell_contents for cell in cells])
        return _folder(_BASE), _label(code.co_firstlineno, code.co_code, closed, asked)
    reached = _reached(function)
    label = _BASE if reached is None else _label(_BASE, reached.digest, *reached.versions)
    digest, helpers = code_digest(function)
    for helper in helpers:
        _take_over(helper)
    return _folder(label), _label(digest, asked)


def _take_over(helper: Any) -> None:
    """Put this cache in place of Numba's own, and forget what was loaded from there."""
    if isinstance(helper._cache, FunctionCache) and not is_installed(
        helper.py_func.__code__.co_filename
    ):
        helper._cache = KernelCache(helper.py_func, helper.targetoptions)
        if helper.overloads:
            helper.recompile()


def _reached(function: Callable[..., Any]) -> Code | None:
    """The files that a function outside the package comes from; None if it comes from no file."""
    code = getattr(sys.modules.get(function.__module__), CODE, None)
    if isinstance(code, Code):
        return code
    try:
        return read_code(Path(getsourcefile(function) or ""))
    except (OSError, SyntaxError, TypeError, ValueError, RecursionError, MemoryError):
        return None


@cache
def _folder(label: str) -> Path:
    """The folder `label` in the first root in which it is there or can be made."""
    for root in _roots():
        folder = root / label
        try:
            if folder.is_dir():
                _mark(folder)
                return folder
            folder.mkdir(mode=0o700, parents=True)
            _remove_old(root, folder)
        except OSError:
            continue
        return folder
    return Path(os.devnull) / label  # nothing can be written anywhere: nothing is kept


def _mark(folder: Path) -> None:
    """Note that a folder is in use."""
    with contextlib.suppress(OSError):  # of another user, or read-only
        if time.time() - folder.stat().st_mtime > _HOUR:
            os.utime(folder)


def _remove_old(root: Path, kept: Path) -> None:
    """Remove folders that have not been used for long, and the oldest of too many.

    What this process uses is kept.
    """
    with contextlib.suppress(OSError):
        others = [f for f in root.iterdir() if f.is_dir() and f not in (kept, root / _BASE)]
        ages = {folder: time.time() - folder.stat().st_mtime for folder in others}
        youngest_first = sorted(ages, key=lambda folder: ages[folder])
        for place, folder in enumerate(youngest_first, start=2):
            if place > _MOST_FOLDERS or ages[folder] > _DAYS * _DAY:
                shutil.rmtree(folder, ignore_errors=True)


def _roots() -> Iterator[Path]:
    """Folders for compiled code, the best first; the last one can be written if anything can."""
    yield from _lasting_roots()
    with contextlib.suppress(OSError):
        yield _for_this_process()


def _lasting_roots() -> Iterator[Path]:
    """Those that other processes find too."""
    if chosen := vars(config).get("CACHE_DIR"):
        yield Path(chosen) / "gridfold"
    if (home := user_folder("XDG_CACHE_HOME", ".cache")) is not None:
        yield home / "compiled"
    if (shared := temporary_folder()) is not None:
        yield shared / "compiled"


@cache
def _for_this_process() -> Path:
    holder = tempfile.TemporaryDirectory(prefix="gridfold-")
    atexit.register(holder.cleanup)
    return Path(holder.name)
