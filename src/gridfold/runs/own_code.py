"""Run a Python file with the modules that it imports, from their contents and not from the disk.

So what runs in a worker is what was read, shown and hashed where the study was started. Modules get
names of their own in ``sys.modules``: two states of one file never mix, nor do they hide other modules.
"""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from hashlib import sha256
from importlib.util import resolve_name
from threading import RLock
from types import ModuleType, TracebackType
from typing import Any, NoReturn

from gridfold.dynamics.own_models import told
from gridfold.errors import OptionError
from gridfold.numerics.code_files import CODE, Code, is_installed, package_name

_ready: dict[tuple[str, str], ModuleType] = {}
_lock = RLock()


def run_code(code: Code) -> ModuleType:
    """The module of a file, run once in this process.

    Raises
    ------
    OptionError
        It raises an exception or asks to end the program, with file and line; or it imports a file in
        another way than by an import statement.
    """
    key = code.path, code.digest
    with _lock:
        if key not in _ready:
            _ready[key] = _run(code)
        return _ready[key]


def _run(code: Code) -> ModuleType:
    before, modules = set(sys.modules), _Modules(code)
    try:
        # What it prints must not get into results that go to standard output.
        with _no_way_out(), redirect_stdout(sys.stderr):
            module = modules.get(code.files[0].module)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        modules.forget()
        raise OptionError(f"{place_in(code, error)}: {told(error)}") from error
    for name in sorted(set(sys.modules) - before):
        file = getattr(sys.modules[name], "__file__", None)
        ours = package_name(name) or name.startswith(modules.prefix)
        if not ours and not is_installed(file):
            modules.forget()
            raise OptionError(
                f"{code.path}: it loads {file} otherwise than by an import statement, so that nobody "
                "sees what it runs; import it at the top"
            )
    return module


@contextmanager
def _no_way_out() -> Iterator[None]:
    """``os._exit`` would end the program in silence; here it raises a SystemExit."""

    def leave(status: int) -> NoReturn:
        raise SystemExit(status)

    before = os._exit
    places = (os, sys.modules.get("posix", os))
    for place in places:
        vars(place)["_exit"] = leave
    try:
        yield
    finally:
        for place in places:
            vars(place)["_exit"] = before


def place_in(code: Code, error: BaseException) -> str:
    """File and line of `code` from which an exception came."""
    if isinstance(error, SyntaxError):
        return f"{error.filename or code.path}:{error.lineno or 1}"
    place, paths = code.path, {file.path for file in code.files}
    trace: TracebackType | None = error.__traceback__
    while trace is not None:
        if (path := trace.tb_frame.f_code.co_filename) in paths:
            place = f"{path}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place


class _Modules:
    """The modules of one piece of code, by the names that its import statements use."""

    def __init__(self, code: Code):
        self.code = code
        known = sha256(f"{code.path}\0{code.digest}".encode()).hexdigest()
        self.prefix = f"gridfold_own_{known[:16]}"
        self.files = {file.module: file for file in code.files}
        self.around = {
            name.rsplit(".", k)[0] for name in self.files for k in range(1, name.count(".") + 1)
        }
        self.loaded: dict[str, ModuleType] = {}

    def get(self, name: str) -> ModuleType:
        """The module `name`, run if it has not been, with the packages around it."""
        if name in self.loaded:
            return self.loaded[name]
        if name not in self.files and name not in self.around:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        parent, _, last = name.rpartition(".")
        outer = self.get(parent) if parent else None
        if name in self.loaded:  # by the package around it
            return self.loaded[name]
        module = self._begin(name)
        if name in self.files:
            file = self.files[name]
            exec(compile(file.content, file.path, "exec", dont_inherit=True), vars(module))
        if outer is not None:
            setattr(outer, last, module)
        return module

    def _begin(self, name: str) -> ModuleType:
        file = self.files.get(name)
        module = ModuleType(f"{self.prefix}.{name}")
        package = file is None or file.is_package
        vars(module).update(
            {
                CODE: self.code,
                "__builtins__": vars(builtins) | {"__import__": self.find},
                "__package__": module.__name__ if package else module.__name__.rpartition(".")[0],
            }
        )
        if file is not None:
            module.__file__ = file.path
        if package:
            module.__path__ = []
        sys.modules[module.__name__] = self.loaded[name] = module
        return module

    def find(
        self,
        name: str,
        names: Mapping[str, Any] | None = None,
        inner: Mapping[str, Any] | None = None,
        wanted: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        """What an import statement in this code does: its own modules first, then all others."""
        full = name
        if level and names is not None:
            package = names["__package__"].removeprefix(self.prefix).removeprefix(".")
            full = resolve_name("." * level + name, package)
        top = full.partition(".")[0]
        if top not in self.files and top not in self.around:
            return builtins.__import__(name, names, inner, wanted or (), level)
        module = self.get(full)
        if not wanted:
            return self.loaded[top]
        for item in wanted:
            if not hasattr(module, item) and f"{full}.{item}" in self.files:
                self.get(f"{full}.{item}")
        return module

    def forget(self) -> None:
        """Take back what has been begun."""
        for module in self.loaded.values():
            sys.modules.pop(module.__name__, None)
