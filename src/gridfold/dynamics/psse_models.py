"""What kind of device the model names of PSS/E stand for, whether gridfold has the model or not.

The names are those of the PSS/E Model Library. The table decides what leaving a model out means; a
name that is not in it is treated with care, see :mod:`gridfold.dynamics.psse_records`.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from gridfold.dynamics.device import CONVERTER_ROLES, LIMITERS, Device, Role


class Kind(Enum):
    """What a model is to its unit."""

    MACHINE = "machine"
    CONVERTER = "converter"  # stands in the place of a machine: also compensators and motors
    EXCITER = "exciter"
    GOVERNOR = "governor"
    STABILIZER = "stabilizer"
    COMPENSATOR = "voltage compensator"
    LIMITER = "excitation limiter"
    CONTROL = "control of a converter or turbine"
    LOAD = "load model"
    PROTECTION = "relay or measurement"
    UNKNOWN = "unknown"


_KIND_OF_ROLE = {
    Role.MACHINE: Kind.MACHINE,
    Role.EXCITER: Kind.EXCITER,
    Role.GOVERNOR: Kind.GOVERNOR,
    Role.STABILIZER: Kind.STABILIZER,
    **dict.fromkeys(CONVERTER_ROLES, Kind.CONTROL),
    Role.LOAD: Kind.LOAD,
    Role.COMPENSATOR: Kind.COMPENSATOR,
    **dict.fromkeys(LIMITERS, Kind.LIMITER),
}

_NAMES = {
    Kind.MACHINE: """
        CGEN1 GENCLS GENDCO GENQEC1 GENROE GENROU GENSAE GENSAL GENTPF GENTPFU1 GENTPJ GENTPJ1
        GENTPJU1 GENTRA""",
    Kind.CONVERTER: """
        CBEST CIMTR1 CIMTR2 CIMTR3 CIMTR4 CSMEST CSTATT CSTCNT CSVGN1 CSVGN3 CSVGN4 CSVGN5 CSVGN6
        DERA1 FRECHG PVGU1 REGCA1 REGCAU1 REGCB1 REGCBU1 REGCC1 REGFMA1 REGFMB1 WT1G1 WT2G1 WT3G1 WT3G2
        WT3G3 WT4G1 WT4G2""",
    Kind.EXCITER: """
        AC1C AC2C AC3C AC4C AC5C AC6A AC6C AC7B AC7C AC8B AC8C AC9C AC10C AC11C BBSEX1 BUDCZT CELIN
        DC1C DC2C DC3A DC4B DC4C EMAC1T ESAC1A ESAC2A ESAC3A ESAC4A ESAC5A ESAC6A ESAC7B ESAC8B
        ESDC1A ESDC2A ESDC3A ESDC4B ESST1A ESST2A ESST3A ESST4B ESST5B ESST6B ESST7B ESURRY EX2000
        EXAC1 EXAC1A EXAC2 EXAC3 EXAC4 EXBAS EXDC2 EXELI EXNEBB EXNI EXPIC1 EXST1 EXST2 EXST2A EXST3
        IEEET1 IEEET2 IEEET3 IEEET4 IEEET5 IEEEX1 IEEEX2 IEEEX3 IEEEX4 IEET1A IEET1B IEET5A IEEX2A
        IVOEX OEX12T OEX3T REXSY1 REXSYS SCRX SEXS ST1C ST2C ST3C ST4C ST5B ST5C ST6B ST6C ST7B ST7C
        ST8C ST9C ST10C URHIDT URST5T""",
    Kind.GOVERNOR: """
        BBGOV1 CRCMGV DEGOV DEGOV1 DEGOV1D GAST GAST2A GASTD GASTDU GASTWD GGOV1 GGOV1D
        GGOV1DU GGOV2 HYG3U1 HYGOV HYGOV2 HYGOVD HYGOVDU HYGOVM HYGOVR1 HYGOVRU HYGOVT
        IEEEG1 IEEEG1D IEEEG1SDU IEEEG2 IEEEG3 IEEEG3D IEEESGO IEESGO IEESGOD IVOGO PIDGOV PIDGOVD
        SHAF25 TGOV1 TGOV1D TGOV1DU TGOV2 TGOV3 TGOV4 TGOV5 TURCZT TWDM1T TWDM2T UCBGT
        URCSCT URGS3T WEHGOV WESGOV WPIDHY WPIDHYDU WSHYDD WSHYGP WSIEG1""",
    Kind.STABILIZER: """
        BEPSST IEE2ST IEEEST IVOST OSTB2T OSTB5T PSS1A PSS2A PSS2B PSS2C PSS3B PSS3C PSS4B PSS4C
        PSS5C PSS6C PSS7C PTIST1 PTIST3 ST2CUT STAB1 STAB2A STAB3 STAB4 STABNI STBSVC UCCPSS""",
    Kind.COMPENSATOR: "COMP COMPCC IEEEVC REMCMP",
    Kind.LIMITER: """
        MAXEX1 MAXEX2 MNLEX1 MNLEX2 MNLEX3 OEL1B OEL2C OEL3C OEL4C OEL5C SCL1C SCL2C UEL1 UEL2 UEL2C
        UEL2CU1""",
    Kind.CONTROL: """
        LCFB1 PANELU1 IRRADU1 PVEU1 REAX3BU1 REAX4BU1 REECA1 REECAU1 REECB1 REECBU1 REECC1 REECCU1
        REECD1 REECDU1 REPCA1 REPCAU1 REPCTA1 REPCTAU1 TURLOD WT12A1 WT12A1U_B WT12T1 WT1P WT1T WT2E1
        WT3E1 WT3E2 WT3P1 WT3T1 WT3T2 WT4E1 WT4E2 WTARA1 WTARAU1 WTDTA1 WTDTAU1 WTPTA1 WTPTAU1
        WTTQA1 WTTQAU1""",
    Kind.PROTECTION: """
        CIROS1 DISTR1 FRQDCA FRQDCAT FRQTPA FRQTPAT GENOF LOEXR1 LOEXR1T OLPS3 RXR1 SLNOS1
        SYSANG VTGDCA VTGDCAT VTGTPA VTGTPAT""",
}  # fmt: skip
_KINDS = {name: kind for kind, names in _NAMES.items() for name in names.split()}

#: Load models and load relays end in what they belong to: a load, an owner, a zone, an area, all. Where
#: several speak of one load, the first of these counts.
LOAD_SUFFIXES = ("BL", "OW", "ZN", "AR", "AL")
_LOAD_STEMS = {
    "ACMT",
    "CIM5",
    "CIM6",
    "CIMW",
    "CLOD",
    "CMLD",
    "DERA",
    "EXTL",
    "IEEL",
    "LDFR",
    "MTRL",
}
_RELAY_STEMS = {"DLSH", "LDS3", "LDSH", "LDST", "LVS3", "LVSH", "UVUF"}


class ClassicalColumns(NamedTuple):
    """Where the record of a machine has its H, D and X'd, counted from 0."""

    inertia: int
    damping: int
    transient_reactance: int


_ROUND_ROTOR = ClassicalColumns(4, 5, 8)
_SALIENT_POLE = ClassicalColumns(3, 4, 7)

CLASSICAL_COLUMNS: dict[str, ClassicalColumns] = {
    "GENDCO": _ROUND_ROTOR,
    "GENROE": _ROUND_ROTOR,
    "GENROU": _ROUND_ROTOR,
    "GENSAE": _SALIENT_POLE,
    "GENSAL": _SALIENT_POLE,
    "GENTPF": _ROUND_ROTOR,
    "GENTPFU1": _ROUND_ROTOR,
    "GENTPJ": _ROUND_ROTOR,
    "GENTPJ1": _ROUND_ROTOR,
    "GENTPJU1": _ROUND_ROTOR,
    "GENTRA": ClassicalColumns(1, 2, 5),
}


def kind_of(model: str, supported: Mapping[str, Device]) -> Kind:
    """What a model is; `supported` as from :func:`~gridfold.dynamics.own_models.answering`."""
    if model in supported:
        kind = _KIND_OF_ROLE.get(supported[model].role, Kind.UNKNOWN)
        is_converter = kind is Kind.MACHINE and _KINDS.get(model) is Kind.CONVERTER
        return Kind.CONVERTER if is_converter else kind
    if model in _KINDS:
        return _KINDS[model]
    stem = model.removesuffix("U1")[:-2]
    if model.removesuffix("U1").endswith(LOAD_SUFFIXES):
        if stem in _LOAD_STEMS:
            return Kind.LOAD
        if stem in _RELAY_STEMS:
            return Kind.PROTECTION
    return Kind.UNKNOWN
