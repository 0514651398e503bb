"""The device models that gridfold knows. A further model is one file and one line here."""

from __future__ import annotations

from gridfold.dynamics.compensators.ieeevc import IEEEVC
from gridfold.dynamics.converters.dera1 import DERA1
from gridfold.dynamics.converters.reeca1 import REECA1
from gridfold.dynamics.converters.reecb1 import REECB1
from gridfold.dynamics.converters.regca1 import REGCA1
from gridfold.dynamics.converters.repca1 import REPCA1
from gridfold.dynamics.converters.wtara1 import WTARA1
from gridfold.dynamics.converters.wtdta1 import WTDTA1
from gridfold.dynamics.converters.wtpta1 import WTPTA1
from gridfold.dynamics.converters.wttqa1 import WTTQA1
from gridfold.dynamics.device import Device
from gridfold.dynamics.exciters.ac8b import AC8B
from gridfold.dynamics.exciters.dc4b import DC4B
from gridfold.dynamics.exciters.esac1a import ESAC1A
from gridfold.dynamics.exciters.esac6a import ESAC6A
from gridfold.dynamics.exciters.esac8b import ESAC8B
from gridfold.dynamics.exciters.esdc1a import ESDC1A
from gridfold.dynamics.exciters.esdc2a import ESDC2A
from gridfold.dynamics.exciters.esst1a import ESST1A
from gridfold.dynamics.exciters.esst3a import ESST3A
from gridfold.dynamics.exciters.esst4b import ESST4B
from gridfold.dynamics.exciters.exac1 import EXAC1
from gridfold.dynamics.exciters.exac2 import EXAC2
from gridfold.dynamics.exciters.exac4 import EXAC4
from gridfold.dynamics.exciters.exdc2 import EXDC2
from gridfold.dynamics.exciters.expic1 import EXPIC1
from gridfold.dynamics.exciters.exst1 import EXST1
from gridfold.dynamics.exciters.ieee_type1 import IEEE_TYPE1
from gridfold.dynamics.exciters.ieeet1 import IEEET1
from gridfold.dynamics.exciters.ieeet2 import IEEET2
from gridfold.dynamics.exciters.ieeet3 import IEEET3
from gridfold.dynamics.exciters.ieeex1 import IEEEX1
from gridfold.dynamics.exciters.scrx import SCRX
from gridfold.dynamics.exciters.sexs import SEXS
from gridfold.dynamics.exciters.st6b import ST6B
from gridfold.dynamics.governors.degov import DEGOV
from gridfold.dynamics.governors.degov1 import DEGOV1
from gridfold.dynamics.governors.first_order import FIRST_ORDER_GOVERNOR
from gridfold.dynamics.governors.gast import GAST
from gridfold.dynamics.governors.ggov1 import GGOV1
from gridfold.dynamics.governors.hygov import HYGOV
from gridfold.dynamics.governors.hygovd import HYGOVD
from gridfold.dynamics.governors.ieeeg1 import IEEEG1
from gridfold.dynamics.governors.ieeeg3 import IEEEG3
from gridfold.dynamics.governors.ieesgo import IEESGO
from gridfold.dynamics.governors.pidgov import PIDGOV
from gridfold.dynamics.governors.tgov1 import TGOV1
from gridfold.dynamics.governors.wsieg1 import WSIEG1
from gridfold.dynamics.limiters.maxex2 import MAXEX2
from gridfold.dynamics.limiters.mnlex2 import MNLEX2
from gridfold.dynamics.loads.cim5 import CIM5
from gridfold.dynamics.loads.cim6 import CIM6
from gridfold.dynamics.loads.ieel import IEEL
from gridfold.dynamics.machines.classical import CLASSICAL
from gridfold.dynamics.machines.csvgn1 import CSVGN1
from gridfold.dynamics.machines.gencls import GENCLS
from gridfold.dynamics.machines.genroe import GENROE
from gridfold.dynamics.machines.genrou import GENROU
from gridfold.dynamics.machines.gensae import GENSAE
from gridfold.dynamics.machines.gensal import GENSAL
from gridfold.dynamics.machines.gentpj1 import GENTPJ1
from gridfold.dynamics.machines.infinite_bus import INFINITE_BUS
from gridfold.dynamics.machines.two_axis import TWO_AXIS
from gridfold.dynamics.stabilizers.ieeest import IEEEST
from gridfold.dynamics.stabilizers.pss2a import PSS2A
from gridfold.dynamics.stabilizers.pss2b import PSS2B
from gridfold.dynamics.stabilizers.st2cut import ST2CUT
from gridfold.dynamics.stabilizers.stab1 import STAB1
from gridfold.dynamics.stabilizers.stab2a import STAB2A
from gridfold.dynamics.turbines.non_reheat import NON_REHEAT_TURBINE

_ALL = (
    TWO_AXIS,
    CLASSICAL,
    INFINITE_BUS,
    IEEE_TYPE1,
    FIRST_ORDER_GOVERNOR,
    NON_REHEAT_TURBINE,
    GENCLS,
    GENROE,
    GENROU,
    GENSAE,
    GENSAL,
    GENTPJ1,
    CSVGN1,
    AC8B,
    DC4B,
    ESAC1A,
    ESAC6A,
    ESAC8B,
    ESDC1A,
    ESDC2A,
    ESST1A,
    ESST3A,
    ESST4B,
    EXAC1,
    EXAC2,
    EXAC4,
    EXDC2,
    EXPIC1,
    EXST1,
    IEEET1,
    IEEET2,
    IEEET3,
    IEEEX1,
    SCRX,
    SEXS,
    ST6B,
    DEGOV,
    DEGOV1,
    GAST,
    GGOV1,
    HYGOV,
    HYGOVD,
    IEEEG1,
    IEEEG3,
    IEESGO,
    PIDGOV,
    TGOV1,
    WSIEG1,
    IEEEST,
    PSS2A,
    PSS2B,
    ST2CUT,
    STAB1,
    STAB2A,
    REGCA1,
    DERA1,
    REECA1,
    REECB1,
    REPCA1,
    WTARA1,
    WTDTA1,
    WTPTA1,
    WTTQA1,
    IEEEVC,
    MAXEX2,
    MNLEX2,
    CIM5,
    CIM6,
    IEEL,
)


class _Devices(dict[str, Device]):
    """All devices by name, with a short ``repr`` for the signatures that have them as default."""

    def __repr__(self) -> str:
        return f"<{len(self)} device models>"


DEVICES: dict[str, Device] = _Devices({device.model: device for device in _ALL})

#: Not a device: marks a generator whose solved power becomes a constant (negative) load admittance.
NEGATIVE_LOAD = "negative_load"
