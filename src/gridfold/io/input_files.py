"""Content of input files. Only regular files are opened, and none that is too long for the memory."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from gridfold.ceilings import require_memory, size_text
from gridfold.errors import CaseFileError

#: Bytes of memory that a byte of a file takes at most while it is read, roughly.
_EXPANSION = 30
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def read_content(path: Path, most: int | None = None) -> bytes:
    """Bytes of a regular file.

    Parameters
    ----------
    path : Path
        The file.
    most : int, optional
        Bytes from which on it is refused; by default what the memory allows.

    Raises
    ------
    CaseFileError
        It is missing, cannot be read, is no regular file, or longer than `most`.
    OptionError
        It takes more memory than may be taken.
    """
    check_regular(path)
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if most is None:
                advice = "Is this the file you mean?"
                what = f"{path}: a file of {size_text(size)}"
                require_memory(what, _EXPANSION * size, advice)
            elif size > most:
                raise _refused(path, f"it has {size_text(size)}, more than {size_text(most)}")
            content = stream.read(size + 1)
    except (OSError, ValueError) as error:
        raise _refused(path, f"cannot be read: {_reason(error)}") from None
    if len(content) > size:
        raise _refused(path, "it grows while it is read")
    return content


def is_there(path: Path) -> bool:
    """Whether a path leads to something; one that no system would take does not."""
    try:
        return path.exists()
    except OSError:  # longer than a name may be
        return False


def check_regular(path: Path) -> None:
    """Refuse what is no regular file: opening a pipe waits for ever, a device has no end.

    Raises
    ------
    CaseFileError
        It is missing, or is a folder, a pipe, a device or a socket.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        raise _refused(path, f"cannot be read: {_reason(error)}") from None
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "something else")
        raise _refused(path, f"cannot be read: it is {kind}, not a file")


def _refused(path: Path, fault: str) -> CaseFileError:
    return CaseFileError(fault, str(path))


def _reason(error: Exception) -> object:
    return getattr(error, "strerror", None) or error
