"""Python files as code: the package's own, and those that a file outside of it reaches by imports.

Nothing is run here. Files are read once; what is hashed is what is read.
"""

from __future__ import annotations

import ast
import sys
import sysconfig
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from hashlib import sha256
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

#: The folder of this package, and its name.
PACKAGE = Path(__file__).resolve().parents[1]
_NAME = PACKAGE.name
_INSTALLED = {
    Path(folder).resolve()
    for key in ("stdlib", "platstdlib", "purelib", "platlib")
    if (folder := sysconfig.get_paths().get(key))
}
#: Attribute of a module that was made from a :class:`Code`: that code.
CODE = "__gridfold_code__"
_SITE = {"site-packages", "dist-packages"}


def package_name(module: str | None) -> bool:
    """Whether `module` is a module of this package."""
    return module is not None and (module == _NAME or module.startswith(_NAME + "."))


def is_installed(file: str | Path | None) -> bool:
    """Whether a module's file belongs to Python or to an installed package; so does none at all."""
    if file is None:
        return True
    path = Path(file)
    if _SITE.intersection(path.parts):
        return True
    return bool(_INSTALLED.intersection(path.resolve().parents))


def package_digest(parts: Collection[str] = ()) -> str:
    """SHA-256 of the sources of this package, or of some of its `parts`, as hexadecimal digits.

    They are read once in a process.
    """
    digest = sha256()
    for name, content in _sources():
        if not parts or name.partition("/")[0] in parts:
            digest.update(f"{name}\0{content}\n".encode())
    return digest.hexdigest()


@cache
def _sources() -> tuple[tuple[str, str], ...]:
    """Path in the package and SHA-256 of every source."""
    files = sorted(PACKAGE.rglob("*.py"))
    return tuple(
        (file.relative_to(PACKAGE).as_posix(), sha256(file.read_bytes()).hexdigest())
        for file in files
    )


@dataclass(frozen=True)
class CodeFile:
    """A Python file as it was read: the module that it is, its path, its content."""

    module: str
    path: str
    content: bytes
    is_package: bool = False

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the content, as hexadecimal digits."""
        return sha256(self.content).hexdigest()


@dataclass(frozen=True)
class Code:
    """A Python file, and all that it reaches by import statements.

    Parameters
    ----------
    files : tuple of CodeFile
        The file itself, then those outside of Python and of installed packages, by module.
    versions : tuple of (str, str)
        Installed packages that they import, with their versions.
    """

    files: tuple[CodeFile, ...]
    versions: tuple[tuple[str, str], ...] = ()

    @property
    def path(self) -> str:
        """Path of the file itself."""
        return self.files[0].path

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all files, with the names by which they import each other."""
        digest = sha256()
        for file in self.files:
            digest.update(f"{file.module}\0{file.is_package}\0{file.sha256}\n".encode())
        return digest.hexdigest()


def read_code(path: Path, search: Sequence[str] | None = None) -> Code:
    """Read a Python file and the files that it imports, in turn.

    Import statements anywhere in a file count, also those that may never be run. Modules are looked for
    beside the file, then in `search` (by default ``sys.path``).

    Raises
    ------
    OSError
        The file cannot be read.
    SyntaxError, ValueError
        A file is no Python, or imports something else that is not installed.
    """
    places = [str(path.resolve().parent), *(sys.path if search is None else search)]
    first = CodeFile(path.stem, str(path), path.read_bytes())
    files, versions, waiting = {first.module: first}, set[str](), [first]
    while waiting:
        here = waiting.pop()
        for name in _imported(here):
            for spec in _specs(name, places):
                if spec.name in files:
                    continue
                if is_installed(spec.origin) or spec.loader is None:
                    versions.add(spec.name.partition(".")[0])
                    break
                files[spec.name] = _read(spec)
                waiting.append(files[spec.name])
    rest = sorted((f for f in files.values() if f is not first), key=lambda f: f.module)
    return Code((first, *rest), tuple((name, _version(name)) for name in sorted(versions)))


def _read(spec: ModuleSpec) -> CodeFile:
    assert spec.origin is not None
    if not spec.origin.endswith(".py"):
        raise ValueError(
            f"it imports {spec.origin}, which is neither Python nor an installed package"
        )
    package = spec.submodule_search_locations is not None
    return CodeFile(spec.name, spec.origin, Path(spec.origin).read_bytes(), package)


def _imported(file: CodeFile) -> Iterator[str]:
    """Names of modules in the import statements of a file; those behind ``from`` may be none."""
    package = file.module if file.is_package else file.module.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.content, file.path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            if base:
                yield base
                yield from (f"{base}.{alias.name}" for alias in node.names)


def _specs(name: str, places: Sequence[str]) -> Iterator[ModuleSpec]:
    """Where a module and the packages around it are, the outermost first, as far as they are found."""
    top = name.partition(".")[0]
    if top in sys.stdlib_module_names or top == _NAME:
        return
    path: Sequence[str] | None = places
    parts = name.split(".")
    for length in range(1, len(parts) + 1):
        if path is None:
            return
        spec = PathFinder.find_spec(".".join(parts[:length]), path)
        if spec is None:
            return
        if spec.origin is not None and spec.loader is not None:
            yield spec
        path = spec.submodule_search_locations


def _version(name: str) -> str:
    """Version of an installed package by its import name; empty where it has another one."""
    try:
        return version(name)
    except PackageNotFoundError:
        return str(getattr(sys.modules.get(name), "__version__", ""))
