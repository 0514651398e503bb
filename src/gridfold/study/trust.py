"""Python code of studies runs only where somebody trusts it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from gridfold.errors import OptionError
from gridfold.numerics.code_files import Code


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
