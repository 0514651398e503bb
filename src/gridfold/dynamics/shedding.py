"""A part of the loads that have devices goes: a part of equal motors side by side, for instance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, Role
from gridfold.dynamics.layout import Block, Layout

#: What is left at least, so that impedances stay finite.
_LEAST = 1e-9


def shed_devices(layout: Layout, shed: Sequence[tuple[int, float]]) -> Layout:
    """The layout with parts of the load at some buses (number, part) gone.

    Parameters on the base of a load are converted as for a smaller base; set points are powers,
    torques and admittances, which go with it. No state does.
    """
    left = {bus: max(1.0 - part, _LEAST) for bus, part in shed}
    if not any(_stands(block, left) for block in layout.blocks):
        return layout
    blocks = (_smaller(block, left) if _stands(block, left) else block for block in layout.blocks)
    return replace(layout, blocks=tuple(blocks))


def _stands(block: Block, left: dict[int, float]) -> bool:
    return block.device.role is Role.LOAD and any(unit.bus in left for unit in block.units)


def _smaller(block: Block, left: dict[int, float]) -> Block:
    scale = np.array([left.get(unit.bus, 1.0) for unit in block.units])
    parameters = block.parameters * scale ** _powers(block.device)[:, None]
    return replace(block, parameters=parameters)


def _powers(device: Device) -> NDArray[np.float64]:
    """By which power of its base each row of the parameters goes."""
    known = {parameter.name: parameter.scaling.value for parameter in device.parameters}
    known |= dict.fromkeys(device.set_points, 1)
    return np.array([known.get(name, 0) for name in device.parameter_rows], dtype=float)
