"""Cases on one network that differ in what is drawn, generated and simulated there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from gridfold.grid.case import Case, DeviceRecord, Generator, Load

#: What a case knows of itself that goes with its loads, units and devices.
_OWN = ("fingerprint",)


def at_operating_point(
    case: Case,
    loads: Sequence[Load] | None = None,
    generators: Sequence[Generator] | None = None,
    devices: Sequence[DeviceRecord] | None = None,
) -> Case:
    """The case with other loads, units or device parameters; its network is not looked at again.

    Parameters
    ----------
    case : Case
        The case.
    loads, generators, devices : sequences, optional
        Its records in their order, with other powers and parameters. Where they stand and what is in
        service is as before.
    """
    moved = replace(
        case,
        loads=case.loads if loads is None else tuple(loads),
        generators=case.generators if generators is None else tuple(generators),
        devices=case.devices if devices is None else tuple(devices),
    )
    records = {item.name for item in fields(case)}
    found = {name: value for name, value in vars(case).items() if name not in records}
    vars(moved).update({name: value for name, value in found.items() if name not in _OWN})
    return moved
