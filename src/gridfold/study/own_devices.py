"""Device models from a user's own Python files."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from gridfold.dynamics.device import Device
from gridfold.dynamics.registry import DEVICES
from gridfold.errors import OptionError


def load_devices(files: Sequence[Path]) -> Mapping[str, Device]:
    """The package's device models and every :class:`Device` that the modules `files` define.

    The files are run: take them from people you trust.

    Raises
    ------
    OptionError
        A file cannot be run, defines no device, or one whose name is taken.
    """
    devices = dict(DEVICES)
    for path in files:
        own = {
            item.model: item for item in vars(_module(path)).values() if isinstance(item, Device)
        }
        own = {name: item for name, item in own.items() if DEVICES.get(name) is not item}
        if not own:
            raise OptionError(f"{path}: it defines no device model")
        if taken := [name for name in own if name in devices]:
            raise OptionError(f"{path}: there is a device model {taken[0]} already")
        devices |= own
    return devices


def _module(path: Path) -> object:
    name = f"gridfold_own_{path.stem}"
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None or not path.is_file():
        raise OptionError(f"{path}: there is no such Python file")
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        raise OptionError(f"{path}: {type(error).__name__}: {error}") from error
    return module
