"""gridfold: transient-stability simulation with dynamic model reduction.

>>> import gridfold as gf
>>> model = gf.build_model(gf.load_case("npcc"))
>>> run = gf.simulate(model, [gf.BusFault(3, start=0.0, duration=0.2)], t_end=16.0)
>>> run.status
<Status.COMPLETED: 'completed'>

Public names, and the modules that they come from, stand in ``__init__.pyi``: type checkers read it, and
so does this module, which loads a name when it is asked for. So a program waits for what it uses alone.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any


def _homes() -> dict[str, tuple[str, str]]:
    """Module and name there of each public name."""
    stub = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    return {
        item.asname or item.name: (str(node.module), item.name)
        for node in ast.parse(stub).body
        if isinstance(node, ast.ImportFrom)
        for item in node.names
    }


_HOMES = _homes()

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, there = _HOMES[name]
    value = getattr(import_module(module), there)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """The package: a part called like a public name, such as ``partition``, does not hide it."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
