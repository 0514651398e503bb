"""The tests on the lowest and the newest versions of all packages, and on every Python there is.

``python tests/matrix.py FOLDER`` makes an environment for each pair in FOLDER, runs a part of the tests
in it, and writes the table of the documentation. A Python that is not found is told as skipped.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
VERSIONS = ("lowest", "newest")
#: What is run in each: a test of every part that other packages stand behind.
TESTS = (
    "tests/simulation",
    "tests/io",
    "tests/powerflow",
    "tests/runs/test_streaming.py",
    "tests/cli/test_late_commands.py",
    "tests/cli/test_option_groups.py",
    "tests/cli/test_study_commands.py",
    "tests/study/test_engine.py::test_processes_give_the_same_rows_on_a_ladder_too",
)
#: Packages whose versions are told.
_TOLD = ("numpy", "numba", "scipy", "pandas", "pyarrow", "typer", "click")
_SUMMARY = re.compile(r"^(?:=+ )?(\d+ (?:passed|failed|error)\b.*?)(?: =+)?$", re.MULTILINE)


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    python: str
    versions: str
    packages: str
    outcome: str


def main(folder: Path) -> int:
    """Run all; the number of those that failed."""
    rows = []
    for python in PYTHONS:
        found = interpreter(python)
        for versions in VERSIONS:
            if found is None:
                rows.append(Row(python, versions, "", "skipped: there is no such Python here"))
            else:
                rows.append(run(found, folder / f"{python}-{versions}", python, versions))
            print(*vars(rows[-1]).values(), sep=" | ", flush=True)
    if found := interpreter(PYTHONS[0]):
        rows.append(without_home(folder / f"{PYTHONS[0]}-newest", PYTHONS[0]))
        print(*vars(rows[-1]).values(), sep=" | ", flush=True)
    write_table(rows)
    return sum("passed" not in row.outcome and "skipped" not in row.outcome for row in rows)


def interpreter(version: str) -> str | None:
    """A Python of this version: on the path, of pyenv, or of uv."""
    for command in (
        [f"python{version}", "-c", "import sys; print(sys.executable)"],
        ["uv", "python", "find", "--no-python-downloads", version],
    ):
        try:
            found = subprocess.run(command, capture_output=True, text=True, check=True)
            return found.stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            continue
    kept = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    places = sorted(kept.glob(f"{version}.*/bin/python"))
    return str(places[-1]) if places else None


def run(python: str, home: Path, version: str, versions: str) -> Row:
    """Make the environment, unless it is there, and run the tests in it."""
    problem = _make(python, home, versions)
    if problem:
        return Row(version, versions, "", f"cannot be installed: {problem}")
    packages = _packages(home)
    outcome = _test(home, [*TESTS], {"NUMBA_CACHE_DIR": str(home / "numba")})
    return Row(version, versions, packages, outcome)


def _make(python: str, home: Path, versions: str) -> str:
    """Make an environment; what is wrong, if something is."""
    project = (ROOT / "pyproject.toml").read_bytes()
    ready = home / f".ready-{zlib.crc32(project):08x}"
    if ready.exists():
        return ""
    shutil.rmtree(home, ignore_errors=True)
    subprocess.run([python, "-m", "venv", str(home)], check=True)
    constraints = home / "constraints.txt"
    lines = lowest() if versions == "lowest" else []
    constraints.write_text("\n".join(lines) + "\n", encoding="utf-8")
    pip = [str(home / "bin" / "pip"), "install", "--quiet", "--constraint", str(constraints)]
    done = subprocess.run([*pip, "--editable", f"{ROOT}[test]"], capture_output=True, text=True)
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    ready.touch()
    return ""


def lowest() -> list[str]:
    """The lowest version of each package that the project itself needs, as constraints."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    return list(_lower_bounds(needed))


def _lower_bounds(requirements: list[str]) -> Iterator[str]:
    for line in requirements:
        match = re.match(r"([\w-]+)>=([\w.]+)", line)
        if match is None:
            raise SystemExit(f"{line}: there is no lowest version")
        yield f"{match[1]}=={match[2]}"


def _packages(home: Path) -> str:
    listed = subprocess.run(
        [str(home / "bin" / "pip"), "list", "--format=freeze"], capture_output=True, text=True
    )
    versions = dict(line.split("==") for line in listed.stdout.splitlines() if "==" in line)
    return ", ".join(f"{name} {versions[name]}" for name in _TOLD if name in versions)


def _test(home: Path, tests: list[str], extra: dict[str, str]) -> str:
    began = time.monotonic()
    # Warnings of other versions of packages are none of this project's.
    command = [str(home / "bin" / "python"), "-m", "pytest", "-q", "-W", "default", *tests]
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "GRIDFOLD_CASES")}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=clean | extra)
    (home / "tests.log").write_text(done.stdout + done.stderr, encoding="utf-8")
    found = _SUMMARY.findall(done.stdout)
    outcome = re.sub(r" in .*", "", found[-1]) if found else f"exit code {done.returncode}"
    return f"{outcome}, {time.monotonic() - began:.0f} s"


def without_home(home: Path, version: str) -> Row:
    """The command of a read-only copy without HOME, as another user if that goes."""
    copy = Path(tempfile.mkdtemp(prefix="gridfold-read-only-"))
    scratch = Path(tempfile.mkdtemp(prefix="gridfold-nobody-"))
    caches = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "src" / "gridfold", copy / "gridfold", ignore=caches)
    for path in [copy, *copy.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    scratch.chmod(0o777)
    nobody = {"user": 65534, "group": 65534} if os.geteuid() == 0 else {}
    try:
        outcome, who = _without_home(home, copy, scratch, nobody), "another user"
    except PermissionError:  # Python itself lies where others may not look
        outcome, who = _without_home(home, copy, scratch, {}), "this user"
    finally:
        for path in [copy, *copy.rglob("*")]:
            path.chmod(0o755)
        shutil.rmtree(copy)
        shutil.rmtree(scratch, ignore_errors=True)
    return Row(version, "newest", f"read-only installation, {who} without HOME", outcome)


def _without_home(home: Path, copy: Path, scratch: Path, user: dict[str, Any]) -> str:
    env = {"PYTHONPATH": str(copy), "PATH": os.environ["PATH"], "TMPDIR": str(scratch)}
    for arguments in (["--version"], ["simulate", "npcc", "--t-end", "0.1", "--json", "-"]):
        command = [str(home / "bin" / "python"), "-m", "gridfold", *arguments]
        done = subprocess.run(command, cwd=scratch, env=env, capture_output=True, text=True, **user)
        if done.returncode:
            last = (done.stderr.strip() or "no message").splitlines()[-1]
            return f"failed: {arguments[0]}: {last}"
    return "passed: --version, simulate"


def write_table(rows: list[Row]) -> None:
    """Write the fragment of the documentation."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    from report import GENERATED, Table

    text = (
        "`make test-matrix`: a part of the tests on the lowest versions that the project allows, "
    )
    text += "and on the newest. Studies with processes start them by the method spawn."
    table = Table(
        text,
        ("Python", "versions", "packages", "tests"),
        [(row.python, row.versions, row.packages, row.outcome) for row in rows],
    )
    (GENERATED / "matrix.md").write_text(f"{table}\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
