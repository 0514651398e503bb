"""The device models that gridfold knows. A further model is one file and one line here."""

from __future__ import annotations

from gridfold.dynamics.device import Device
from gridfold.dynamics.exciters.ieee_type1 import IEEE_TYPE1
from gridfold.dynamics.governors.first_order import FIRST_ORDER_GOVERNOR
from gridfold.dynamics.machines.classical import CLASSICAL
from gridfold.dynamics.machines.infinite_bus import INFINITE_BUS
from gridfold.dynamics.machines.two_axis import TWO_AXIS
from gridfold.dynamics.turbines.non_reheat import NON_REHEAT_TURBINE

_ALL = (
    TWO_AXIS,
    CLASSICAL,
    INFINITE_BUS,
    IEEE_TYPE1,
    FIRST_ORDER_GOVERNOR,
    NON_REHEAT_TURBINE,
)

DEVICES: dict[str, Device] = {device.model: device for device in _ALL}

#: Not a device: marks a generator whose solved power becomes a constant (negative) load admittance.
NEGATIVE_LOAD = "negative_load"
