"""What the functions of a device give, beside its kernels; anything else than that is an error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, Values
from gridfold.errors import DeviceError


def parameter_faults(device: Device, values: Mapping[str, float]) -> list[str]:
    """Faults of a unit's parameters as they act."""
    found = device.check(values)
    if not isinstance(found, Iterable) or isinstance(found, str):
        raise _wrong(device, "check", found, "texts, each a fault; () where there is none")
    return [str(fault) for fault in found]


def first_guess(
    device: Device, p: Values, known: Mapping[str, Any], units: int
) -> dict[str, NDArray[np.float64]]:
    """First guess of unknowns by name, shape (units,) each."""
    return _by_name(device, "guess", device.guess(p, known), units)


def foreseen(
    device: Device, p: Values, known: Mapping[str, Any], units: int
) -> dict[str, NDArray[np.float64]]:
    """Start values that a device knows before others do, by name, shape (units,) each."""
    return _by_name(device, "foresee", device.foresee(p, known), units)


def _by_name(
    device: Device, function: str, found: object, units: int
) -> dict[str, NDArray[np.float64]]:
    if not isinstance(found, Mapping):
        raise _wrong(device, function, found, "a mapping of names to values")
    try:
        return {
            name: np.broadcast_to(np.asarray(value, dtype=float), (units,))
            for name, value in found.items()
        }
    except (TypeError, ValueError):
        raise _wrong(device, function, found, f"numbers of {units} units") from None


def norton_admittance(device: Device, p: Values, units: int) -> NDArray[np.complex128]:
    """Norton admittance of a machine's units in per unit, shape (units,)."""
    assert device.admittance is not None
    found = device.admittance(p)
    try:
        values = np.broadcast_to(np.asarray(found, dtype=complex), (units,))
    except (TypeError, ValueError):
        raise _wrong(device, "admittance", found, f"complex numbers of {units} units") from None
    if not np.isfinite(values).all():
        raise _wrong(device, "admittance", found, "finite numbers")
    return values


def _wrong(device: Device, function: str, found: object, wanted: str) -> DeviceError:
    text = repr(found)
    shown = text if len(text) <= 60 else text[:60] + " ..."
    place = f" ({device.file})" if device.file else ""
    return DeviceError(f"device {device.model}{place}: its {function} gives {shown}, not {wanted}")
