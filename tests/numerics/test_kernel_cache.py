"""Compiled code on disk: it is the code of the sources and values that are there now."""

from __future__ import annotations

import ast
import importlib
import os
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from numba import types

from gridfold.numerics import kernel_cache, user_folders
from gridfold.numerics.code_digest import code_digest
from gridfold.numerics.code_files import PACKAGE
from gridfold.numerics.compiled import compile_callback, jit
from gridfold.numerics.kernel_cache import COMPILED_PARTS, KernelCache

#: What a kernel outside the package may hang on: file, text before, text after.
CHANGES = {
    "a constant that is imported": ("settings.py", "GAIN = 2.0", "GAIN = 3.0"),
    "a function that is imported": ("law.py", "gain * x", "gain * x + 1.0"),
    "a constant of the imported function": ("law.py", "SHIFT = 0.0", "SHIFT = 1.0"),
    "a constant behind a module": ("pack/inner.py", "SCALE = 1.0", "SCALE = 5.0"),
    "an entry of an array": ("settings.py", "[1.0, 0.0]", "[4.0, 0.0]"),
    "an option of the compiler": ("law.py", "@njit", "@njit(fastmath=True)"),
    "a number in a file of data": ("number.txt", "0.0", "7.0"),
    "a member of an enumeration": ("settings.py", "FIRST = 0", "FIRST = 1"),
    "the function behind a vectorized one": ("law.py", "x - x", "x - 2.0 * x"),
    "the kernel itself": ("kernel.py", "+ 0.0", "+ 9.0"),
}
SOURCES = {
    "settings.py": """
        from enum import IntEnum
        import numpy as np
        GAIN = 2.0
        TABLE = np.array([1.0, 0.0])
        class Row(IntEnum):
            FIRST = 0
        """,
    "law.py": """
        from numba import njit, vectorize
        @vectorize
        def nothing(x):
            return x - x
        SHIFT = 0.0
        @njit
        def law(gain, x):
            return gain * x + SHIFT
        """,
    "pack/__init__.py": "from . import inner",
    "pack/inner.py": "SCALE = 1.0",
    "number.txt": "0.0",
    "kernel.py": """
        from pathlib import Path
        import pack
        from law import law, nothing
        from settings import GAIN, TABLE, Row
        READ = float((Path(__file__).parent / "number.txt").read_text())
        def kernel(x):
            return law(GAIN, x) * pack.inner.SCALE * TABLE[Row.FIRST] + nothing(x) + READ + 0.0
        """,
}


@pytest.fixture
def written(tmp_path, monkeypatch):
    """A kernel in a file, with what it imports; gives a function that loads all of it anew."""
    for name, text in SOURCES.items():
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(textwrap.dedent(text))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    names = ("kernel", "law", "settings", "pack", "pack.inner")

    def load():
        for name in names:
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module("kernel").kernel

    yield load
    for name in names:
        sys.modules.pop(name, None)


def place_of(kernel):
    """Folder and key of the code of a kernel."""
    cache = KernelCache(kernel, {})
    return cache.cache_path, cache._identity


@pytest.mark.parametrize("change", CHANGES)
def test_code_has_another_place_after_a_change_of(change, written, tmp_path):
    before = place_of(written())
    assert place_of(written()) == before
    name, old, new = CHANGES[change]
    text = (tmp_path / name).read_text()
    assert old in text
    (tmp_path / name).write_text(text.replace(old, new))
    assert place_of(written()) != before


def test_a_changed_constant_of_a_helper_gives_the_new_numbers(written, tmp_path):
    def call():
        return compile_callback(written(), types.float64(types.float64)).ctypes(10.0)

    assert call() == 20.0
    settings = tmp_path / "settings.py"
    settings.write_text(settings.read_text().replace("GAIN = 2.0", "GAIN = 3.0"))
    assert call() == 30.0


def test_a_helper_with_a_cache_of_its_own_gives_the_new_numbers(written, tmp_path):
    """Numba's cache knows the helper's file alone, and serves what it was compiled from."""
    (tmp_path / "law.py").write_text(
        "from numba import njit, vectorize\n"
        "from settings import GAIN\n"
        "nothing = vectorize(lambda x: x - x)\n"
        "@njit('float64(float64, float64)', cache=True)\n"
        "def law(gain, x):\n"
        "    return GAIN * x\n"
    )

    def call():
        return compile_callback(written(), types.float64(types.float64)).ctypes(10.0)

    assert call() == 20.0
    settings = tmp_path / "settings.py"
    settings.write_text(settings.read_text().replace("GAIN = 2.0", "GAIN = 3.0"))
    assert call() == 30.0


def test_a_function_without_a_file_can_be_kept():
    names: dict[str, object] = {"RATE": 2.0}
    exec("def kernel(x):\n    return RATE * x", names)
    for _ in range(2):  # the second time it is on disk
        assert compile_callback(names["kernel"], types.float64(types.float64)).ctypes(3.0) == 6.0
    first = code_digest(names["kernel"])[0]
    names["RATE"] = 3.0
    assert code_digest(names["kernel"])[0] != first
    assert compile_callback(names["kernel"], types.float64(types.float64)).ctypes(3.0) == 9.0


def test_damaged_and_foreign_code_is_compiled_anew(written):
    signature = types.float64(types.float64)
    compile_callback(written(), signature)
    assert compile_callback(written(), signature).cache_hits == 1
    (file,) = Path(KernelCache(written(), {}).cache_path).glob("kernel.kernel-*")
    content = file.read_bytes()
    for damaged in (b"", content[:50], content[:-1], content[:40] + b"x" + content[41:]):
        file.write_bytes(damaged)
        callback = compile_callback(written(), signature)
        assert (callback.cache_hits, callback.ctypes(1.0)) == (0, 2.0)


def test_one_function_with_other_options_or_other_values_around_it_is_another_one():
    def scaled(by):
        def kernel(x):
            return by * x

        return kernel

    kernels = [jit()(scaled(2.0)), jit()(scaled(3.0)), jit(error_model="numpy")(scaled(2.0))]
    assert [kernel(10.0) for kernel in kernels] == [20.0, 30.0, 20.0]
    assert len({KernelCache(k.py_func, k.targetoptions)._identity for k in kernels}) == 3
    divide = "def divide(x, y):\n    return x / y"
    names: dict = {}
    exec(divide, names)
    assert jit(error_model="numpy")(names["divide"])(1.0, 0.0) == np.inf
    with pytest.raises(ZeroDivisionError):
        jit()(names["divide"])(1.0, 0.0)


def test_code_is_not_kept_where_a_module_of_the_package_has_changed_since(monkeypatch):
    assert isinstance(kernel_cache.kernel_cache(jit, {}), KernelCache)
    monkeypatch.setattr(kernel_cache, "_READ_AT", 0)
    assert not isinstance(kernel_cache.kernel_cache(jit, {}), KernelCache)


def _imports(file: Path) -> set[str]:
    """What a module imports when it is loaded: code that is compiled can use no other."""
    found = set()
    for node in ast.parse(file.read_text("utf-8")).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gridfold"):
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in found if _file(name) is not None}


def _file(module: str) -> Path | None:
    place = PACKAGE.joinpath(*module.split(".")[1:])
    files = (place.with_suffix(".py"), place / "__init__.py")
    return next((file for file in files if file.is_file()), None)


def test_all_that_modules_with_compiled_code_import_is_part_of_the_digest():
    compiled = ("@jit", "@njit", "compile_callback(", "@compiled_part", "intrinsic(", "derivative")
    waiting = [f for f in PACKAGE.rglob("*.py") if any(w in f.read_text("utf-8") for w in compiled)]
    waiting = [f for f in waiting if f.relative_to(PACKAGE).parts[0] in COMPILED_PARTS]
    seen = set(waiting)
    while waiting:
        found = {_file(name) for name in _imports(waiting.pop())} - seen
        waiting += found
        seen |= found
    assert {f.relative_to(PACKAGE).parts[0] for f in seen} <= {
        *COMPILED_PARTS,
        "__init__.py",
        "cards.py",
        "ceilings.py",
    }
    users = [f for f in PACKAGE.rglob("*.py") if "numerics.compiled import" in f.read_text("utf-8")]
    assert {f.relative_to(PACKAGE).parts[0] for f in users} <= set(COMPILED_PARTS)


def test_nothing_in_the_package_is_kept_by_the_cache_of_numba():
    """It would serve what was compiled before a change in another file."""
    kept = [f for f in PACKAGE.rglob("*.py") if "cache=True" in f.read_text("utf-8")]
    assert kept == []


def test_folders_that_nobody_uses_are_removed(tmp_path):
    now = time.time()
    for k in range(kernel_cache._MOST_FOLDERS + 5):
        folder = tmp_path / f"folder{k}"
        folder.mkdir()
        os.utime(folder, (now, now - 86400 * k))
    old = tmp_path / "old"
    old.mkdir()
    os.utime(old, (0, 0))
    kernel_cache._remove_old(tmp_path, tmp_path / "folder0")
    left = {folder.name for folder in tmp_path.iterdir()}
    assert left == {f"folder{k}" for k in range(kernel_cache._MOST_FOLDERS)}


def test_the_first_folder_that_can_be_made_is_taken(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(
        kernel_cache, "config", type("Config", (), {"CACHE_DIR": f"{tmp_path}/file"})
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    roots = list(kernel_cache._roots())
    assert roots[:2] == [
        tmp_path / "file" / "gridfold",
        tmp_path / "cache" / "gridfold" / "compiled",
    ]
    assert kernel_cache._folder("test_roots").parent == roots[1]


def test_a_temporary_folder_of_someone_else_is_not_trusted(tmp_path, monkeypatch):
    monkeypatch.setattr(user_folders.tempfile, "gettempdir", lambda: str(tmp_path))
    mine = tmp_path / f"gridfold-{os.getuid()}"
    assert mine / "compiled" in list(kernel_cache._roots())
    mine.chmod(0o777)
    assert mine / "compiled" not in list(kernel_cache._roots())
    mine.rmdir()
    mine.symlink_to(tmp_path)
    assert mine / "compiled" not in list(kernel_cache._roots())


def test_where_nothing_can_be_written_code_is_compiled_and_not_kept(monkeypatch):
    def nowhere(*_, **__):
        raise FileNotFoundError("no usable temporary directory")

    monkeypatch.setattr(kernel_cache, "config", type("Config", (), {"CACHE_DIR": "/proc/nowhere"}))
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    monkeypatch.setattr(user_folders.tempfile, "gettempdir", nowhere)
    monkeypatch.setattr(kernel_cache.tempfile, "TemporaryDirectory", nowhere)
    kernel_cache._for_this_process.cache_clear()
    kernel_cache._folder.cache_clear()
    try:
        assert jit()(_three)(1.5) == 4.5
        kept = kernel_cache.kept_code()
        assert (kept.functions, kept.temporary) == (0, True)
        assert not kept.folder.exists()
    finally:
        kernel_cache._for_this_process.cache_clear()
        kernel_cache._folder.cache_clear()


def _three(x):
    return 3 * x


def test_the_command_starts_without_a_home():
    names = ("HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    environment = {k: v for k, v in os.environ.items() if k not in names}
    code = "from gridfold.cli import main; main()"
    for home in ({"HOME": "/proc/nowhere"}, {"HOME": ""}):
        done = subprocess.run(
            [sys.executable, "-c", code, "--version"],
            env=environment | home, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, ""), done.stderr
        assert done.stdout.startswith("gridfold ")


def test_many_processes_may_fill_one_folder(tmp_path):
    """Two overloads of each function, compiled by several processes at once, never change places."""
    script = tmp_path / "many.py"
    script.write_text(
        "import sys\n"
        "from gridfold.numerics.compiled import jit\n"
        "@jit()\n"
        "def twice(x):\n"
        "    return x + x\n"
        "order = [1, 2.5, 1j] if int(sys.argv[1]) % 2 else [1j, 2.5, 1]\n"
        "assert all(twice(x) == 2 * x and type(twice(x)) is type(x) for x in order)\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for _ in range(2):
        running = [
            subprocess.Popen([sys.executable, str(script), str(k)], env=environment)
            for k in range(4)
        ]
        assert [process.wait() for process in running] == [0] * 4
    assert len(list((tmp_path / "cache").rglob("*twice-*.machine"))) == 3
    assert not list((tmp_path / "cache").rglob(".new-*"))


def test_constants_that_are_no_numbers_have_digests():
    np.testing.assert_equal(len(code_digest(_with_everything)[0]), 64)


_NESTED = {
    "a": [1, (2.0, {3})],
    "b": frozenset({"x"}),
    "c": np.float32(1),
    "d": types.float64,
    "e": ...,
}
_NESTED["itself"] = _NESTED


def _with_everything(x=_NESTED):
    return _NESTED, os, types, x, lambda: _NESTED
