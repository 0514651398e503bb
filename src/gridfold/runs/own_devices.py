"""Device models from a user's own Python files: read, and only then run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from gridfold.dynamics.device import Device
from gridfold.dynamics.own_models import device_models, is_own, told
from gridfold.dynamics.registry import DEVICES
from gridfold.errors import OptionError
from gridfold.numerics.code_files import Code, read_code
from gridfold.runs.own_code import run_code


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


def load_devices(*files: str | Path) -> Mapping[str, Device]:
    """Device models from Python files of your own, beside those of the package. The files are run.

    Each :class:`~gridfold.dynamics.device.Device` that is at hand at the end of a file counts; a file
    may import others beside it.

    Parameters
    ----------
    files : str or Path
        The files.

    Returns
    -------
    mapping
        All device models by name, for `devices` of :func:`gridfold.load_case` and
        :func:`gridfold.build_model`.

    Raises
    ------
    OptionError
        A file cannot be read or run, or defines no device; with file and line.
    DeviceError
        A device model does not fit together, or has a name or a record that is another's.
    """
    return devices_in(read_devices([Path(file) for file in files]))


def devices_in(codes: Sequence[Code]) -> Mapping[str, Device]:
    """The same of code that has been read."""
    own: list[Device] = []
    first: dict[tuple[str, str | None], Code] = {}
    for code in codes:
        devices = own_devices_in(code)
        # A model of a file that several files import is one model.
        own += [d for d in devices if first.setdefault((d.model, d.file), code) is code]
    return device_models(own) if own else DEVICES


def own_devices_in(code: Code) -> tuple[Device, ...]:
    """The device models that code defines; it is run. Raises an OptionError if there is none."""
    items = (item for item in vars(run_code(code)).values() if isinstance(item, Device))
    own = {id(item): item for item in items if is_own(item)}
    if not own:
        raise OptionError(f"{code.path}: it defines no device model")
    return tuple(own.values())
