"""A digest of all that the machine code of a function depends on.

Numba compiles the values of global names into the code, so they count as much as the function itself:
constants, functions that it calls, and what these use in turn. The package's own functions count by
their name alone; the digest of its sources stands for them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from enum import Enum
from hashlib import sha256
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.types import Type

from gridfold.numerics.code_files import is_installed, package_name

_PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...))


def code_digest(item: object) -> tuple[str, list[Any]]:
    """SHA-256 of a value, or of the code of a function, and of all that it reaches.

    With it come the functions outside the package that it reaches and that Numba compiles.
    """
    found = _Digest()
    found.value(item)
    return found.hash.hexdigest(), found.dispatchers


class _Digest:
    """Walks over values; each is met once."""

    def __init__(self) -> None:
        self.hash = sha256()
        self.seen: dict[int, int] = {}
        self.kept: list[object] = []  # so that no identity is used twice
        self.dispatchers: list[Any] = []

    def add(self, *parts: object) -> None:
        for part in parts:
            content = part if isinstance(part, bytes) else repr(part).encode()
            self.hash.update(len(content).to_bytes(8, "little") + content)

    def value(self, item: Any, names: tuple[str, ...] = ()) -> None:
        """Add a value; of a module what code with these `names` may take from it."""
        if isinstance(item, _PLAIN):
            self.add(type(item).__name__, item)
        elif isinstance(item, np.ndarray | np.generic):
            self.add("array", item.dtype.str, item.shape, item.tobytes())
        elif isinstance(item, ModuleType):
            self._module(item, names)
        elif self._is_new(item):
            self._compound(item)

    def _compound(self, item: Any) -> None:
        if isinstance(item, Enum):
            self.add("enum", type(item).__qualname__, item.name, item.value)
        elif isinstance(item, tuple | list | set | frozenset):
            self.add(type(item).__name__, len(item), getattr(item, "_fields", ()))
            for part in sorted(item, key=repr) if isinstance(item, set | frozenset) else item:
                self.value(part)
        elif isinstance(item, Mapping):
            self.add("mapping", len(item))
            for key, part in item.items():
                self.value(key)
                self.value(part)
        elif isinstance(item, FunctionType):
            self._function(item)
        elif isinstance(item, Type):
            self.add("type", str(item))
        elif isinstance(item, type):
            self._class(item)
        else:
            self._other(item)

    def _class(self, item: type) -> None:
        self.add("class", item.__module__, item.__qualname__)
        if package_name(item.__module__) or _is_installed_module(item.__module__):
            return
        for name, value in vars(item).items():
            if not name.startswith("__"):
                self.add(name)
                self.value(value)

    def _other(self, item: Any) -> None:
        """What Numba made of a function; of anything else its name."""
        self.add(type(item).__qualname__, getattr(item, "__qualname__", ""))
        module = str(getattr(item, "__module__", ""))
        # Code of others counts by its content: the name of its module says how it was loaded.
        self.add(module if package_name(module) or _is_installed_module(module) else "")
        if isinstance(item, Dispatcher) and not package_name(item.__module__):
            self.dispatchers.append(item)
        self.value(getattr(item, "targetoptions", None))
        for name in ("py_func", "_pyfunc", "_defn", "_dispatcher"):
            if isinstance(inner := getattr(item, name, None), FunctionType | Dispatcher):
                self.value(inner)

    def _function(self, function: FunctionType) -> None:
        self.add("function", function.__qualname__)
        if package_name(function.__module__):
            self.add(function.__module__)
            return
        self._code(function.__code__, function.__globals__)
        for cell in function.__closure__ or ():
            try:
                self.value(cell.cell_contents)
            except ValueError:
                self.add("empty cell")
        self.value(function.__defaults__)
        self.value(function.__kwdefaults__)

    def _code(self, code: CodeType, names: Mapping[str, Any]) -> None:
        self.add(code.co_code, code.co_names, code.co_varnames, code.co_freevars)
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                self._code(constant, names)
            else:
                self.value(constant)
        for name in code.co_names:
            if name in names:
                self.add(name)
                self.value(names[name], code.co_names)

    def _module(self, module: ModuleType, names: tuple[str, ...]) -> None:
        self.add("module", module.__name__)
        if package_name(module.__name__) or is_installed(getattr(module, "__file__", None)):
            top = sys.modules.get(module.__name__.partition(".")[0], module)
            self.add(getattr(top, "__version__", ""))
            taken = {k: v for k in names if isinstance(v := vars(module).get(k), _PLAIN)}
        else:
            taken = {k: v for k in names if (v := vars(module).get(k, module)) is not module}
        for name, value in taken.items():
            self.add(name)
            self.value(value, names)

    def _is_new(self, item: object) -> bool:
        """Whether `item` is met for the first time; else its number is added."""
        if (number := self.seen.get(id(item))) is not None:
            self.add("again", number)
            return False
        self.seen[id(item)] = len(self.seen)
        self.kept.append(item)
        return True


def _is_installed_module(name: str) -> bool:
    module = sys.modules.get(name)
    return module is not None and is_installed(getattr(module, "__file__", None))
