"""Device models from a user's own Python files: read, trusted, and only then run."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gridfold.dynamics.device import Device
from gridfold.dynamics.registry import DEVICES
from gridfold.errors import GridfoldError, OptionError
from gridfold.numerics.code_files import Code, read_code
from gridfold.study.own_code import place_in, run_code, told


def read_devices(files: Sequence[Path]) -> tuple[Code, ...]:
    """Read Python files and what they import; nothing is run.

    Raises
    ------
    OptionError
        A file cannot be read or is no Python: every one of them.
    """
    found, faults = [], []
    for path in files:
        try:
            if not path.is_file():
                raise OptionError("there is no such Python file")
            found.append(read_code(path.resolve()))
        except SyntaxError as error:
            faults.append(f"{error.filename or path}:{error.lineno or 1}: {told(error)}")
        except (OptionError, OSError, ValueError) as error:
            faults.append(f"{path}: {error}")
        except (RecursionError, MemoryError) as error:
            faults.append(f"{path}: Python cannot read it: {type(error).__name__}")
    if faults:
        raise OptionError("\n".join(faults))
    return tuple(found)


def require_trust(codes: Sequence[Code], trusted: bool | Collection[str]) -> None:
    """Refuse to run code that is not trusted.

    Parameters
    ----------
    codes : sequence of Code
        What is going to run.
    trusted : bool or collection of str
        Whether all of it may run, or the digests (:attr:`Code.digest`) of what may.

    Raises
    ------
    OptionError
        Some of it may not: paths and SHA-256 of its files, and what to do.
    """
    if trusted is True:
        return
    allowed = () if trusted is False else trusted
    strange = [code for code in codes if code.digest not in allowed]
    if strange:
        listed = "\n".join(line for code in strange for line in listing(code))
        raise OptionError(
            "the study runs Python code of its own, which may do anything that you may do here:\n"
            f"{listed}\n"
            "Read it. If you trust it, go on with --trust-devices (in Python trust_devices=True)."
        )


def listing(code: Code) -> Iterator[str]:
    """A line for each file: path and SHA-256."""
    return (f"  {file.path}  sha256 {file.sha256}" for file in code.files)


def code_record(code: Code) -> dict[str, Any]:
    """Where results come from, ready for JSON: path, digest, files by module, packages by version."""
    files = {file.module: file.sha256 for file in code.files}
    return {
        "path": code.path,
        "digest": code.digest,
        "files": files,
        "packages": dict(code.versions),
    }


def load_devices(codes: Sequence[Code]) -> Mapping[str, Device]:
    """The package's device models and every :class:`Device` that own code defines. The code is run.

    Raises
    ------
    OptionError
        It cannot be run, defines no device, or one whose name is taken.
    """
    devices = dict(DEVICES)
    for code in codes:
        items = vars(run_code(code)).values()
        own = {item.model: item for item in items if isinstance(item, Device)}
        own = {name: item for name, item in own.items() if DEVICES.get(name) is not item}
        if not own:
            raise OptionError(f"{code.path}: it defines no device model")
        if taken := [name for name in own if name in devices]:
            raise OptionError(f"{code.path}: there is a device model {taken[0]} already")
        devices |= own
    return devices


@contextmanager
def own_errors_are_told(codes: Sequence[Code]) -> Iterator[None]:
    """What own code raises, in whatever it was called for, is an :class:`OptionError` with its line.

    A SystemExit, or what a command takes for one, would else end the program as if all were well.
    """
    try:
        yield
    except GridfoldError:
        raise
    except (Exception, SystemExit) as error:
        place = next((at for code in codes if (at := place_in(code, error)) != code.path), None)
        if place is None and not isinstance(error, SystemExit):
            raise
        raise OptionError(f"{place or 'a device model of the study'}: {told(error)}") from error
