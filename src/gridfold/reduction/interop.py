"""Linear systems in the types of other packages, for comparison and further work.

python-control and pyMOR are imported only when asked for; both come with the extra ``interop``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from gridfold.errors import OptionError
from gridfold.systems.linear import LinearSystem


def to_control(system: LinearSystem) -> Any:
    """`system` as a ``control.StateSpace``, with its names.

    Raises
    ------
    OptionError
        If python-control is not installed.
    """
    names = {
        "states": list(system.state_names) or None,
        "inputs": list(system.input_names) or None,
        "outputs": list(system.output_names) or None,
    }
    control = _import("control", "python-control")
    # States that do nothing are kept: the state vector stays that of `system`.
    return control.StateSpace(
        system.a, system.b, system.c, system.d, remove_useless_states=False, **names
    )


def to_pymor(system: LinearSystem) -> Any:
    """`system` as a ``pymor.models.iosys.LTIModel``.

    Raises
    ------
    OptionError
        If pyMOR is not installed.
    """
    iosys = _import("pymor.models.iosys", "pyMOR")
    return iosys.LTIModel.from_matrices(system.a, system.b, system.c, system.d)


def _import(module: str, package: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise OptionError(
            f"{package} is not installed; install gridfold with the extra 'interop': "
            "pip install 'gridfold[interop]'"
        ) from error
