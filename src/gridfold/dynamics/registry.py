"""The device models that gridfold knows. A further model is one file and one line here."""

from __future__ import annotations

from gridfold.dynamics.device import Device
from gridfold.dynamics.exciters.esdc2a import ESDC2A
from gridfold.dynamics.exciters.esst3a import ESST3A
from gridfold.dynamics.exciters.exdc2 import EXDC2
from gridfold.dynamics.exciters.exst1 import EXST1
from gridfold.dynamics.exciters.ieee_type1 import IEEE_TYPE1
from gridfold.dynamics.exciters.ieeet1 import IEEET1
from gridfold.dynamics.exciters.ieeex1 import IEEEX1
from gridfold.dynamics.exciters.sexs import SEXS
from gridfold.dynamics.governors.first_order import FIRST_ORDER_GOVERNOR
from gridfold.dynamics.governors.gast import GAST
from gridfold.dynamics.governors.hygov import HYGOV
from gridfold.dynamics.governors.ieeeg1 import IEEEG1
from gridfold.dynamics.governors.tgov1 import TGOV1
from gridfold.dynamics.machines.classical import CLASSICAL
from gridfold.dynamics.machines.gencls import GENCLS
from gridfold.dynamics.machines.genrou import GENROU
from gridfold.dynamics.machines.gensal import GENSAL
from gridfold.dynamics.machines.infinite_bus import INFINITE_BUS
from gridfold.dynamics.machines.two_axis import TWO_AXIS
from gridfold.dynamics.stabilizers.ieeest import IEEEST
from gridfold.dynamics.stabilizers.st2cut import ST2CUT
from gridfold.dynamics.turbines.non_reheat import NON_REHEAT_TURBINE

_ALL = (
    TWO_AXIS,
    CLASSICAL,
    INFINITE_BUS,
    IEEE_TYPE1,
    FIRST_ORDER_GOVERNOR,
    NON_REHEAT_TURBINE,
    GENCLS,
    GENROU,
    GENSAL,
    EXDC2,
    ESDC2A,
    ESST3A,
    EXST1,
    IEEET1,
    IEEEX1,
    SEXS,
    GAST,
    HYGOV,
    IEEEG1,
    TGOV1,
    IEEEST,
    ST2CUT,
)

DEVICES: dict[str, Device] = {device.model: device for device in _ALL}

#: Not a device: marks a generator whose solved power becomes a constant (negative) load admittance.
NEGATIVE_LOAD = "negative_load"
