"""Fields of the records of PSS/E RAW files, revisions 29 to 35, and what a blank one stands for.

Names, order and defaults are those of the PSS/E Program Operation Manual, chapter on the power flow
raw data file. A layout ends with the last field that gridfold or powerio looks at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache

from gridfold.io.raw_sections import THREE_WINDING


class Base(Enum):
    """Defaults that hang on other data of the file."""

    SYSTEM = "SBASE of the header"
    WINDING = "1, or the base voltage of the bus where ratios are given in kV"


@dataclass(frozen=True)
class Column:
    """A field of a record.

    Parameters
    ----------
    name : str
        As in the manual.
    default : str, Base or None
        What a blank field stands for. None: it stays blank, as nothing depends on it.
    needed : bool
        Whether there is no default at all.
    is_text : bool
        Whether it holds a text.
    least : int or None
        Least value of a whole number; None where any number has a meaning.
    """

    name: str
    default: str | Base | None = None
    needed: bool = False
    is_text: bool = False
    least: int | None = None


Layout = tuple[Column, ...]

_BUS = "I! 'NAME' BASKV=0 IDE=1 AREA=1 ZONE=1 OWNER=1 VM=1 VA=0"
_OLD_BUS = "I! 'NAME' BASKV=0 IDE=1 GL=0 BL=0 AREA=1 ZONE=1 VM=1 VA=0 OWNER=1"
_LOAD = "I! 'ID'=1 STATUS=1 AREA ZONE PL=0 QL=0 IP=0 IQ=0 YP=0 YQ=0 OWNER"
_DISTRIBUTED = " SCALE=1 INTRPT=0 DGENP=0 DGENQ=0 DGENM=0"
_FIXED_SHUNT = "I! 'ID'=1 STATUS=1 GL=0 BL=0"
_UNIT = "I! 'ID'=1 PG=0 QG=0 QT=9999 QB=-9999 VS=1 IREG=0"
_MACHINE = " MBASE=SBASE ZR=0 ZX=1 RT=0 XT=0 GTAP=1 STAT=1 RMPCT=100 PT=9999 PB=-9999"
_LINE = "I! J! 'CKT'=1 R! X! B=0"
_RATINGS = " RATEA=0 RATEB=0 RATEC=0"
_TWELVE = "".join(f" RATE{k}=0" for k in range(1, 13))
_LINE_ENDS = " GI=0 BI=0 GJ=0 BJ=0 ST=1"
_METERED = " MET=1"
_SWITCH = "I! J! 'CKT'=1 X=0" + _TWELVE + " STATUS=1"
_WINDINGS = "I! J! K=0 'CKT'=1 CW=1 CZ=1 CM=1 MAG1=0 MAG2=0 NMETR=2 'NAME' STAT=1"
_PAIR = "R1-2=0 X1-2! SBASE1-2=SBASE"
_PAIRS = _PAIR + " R2-3=0 X2-3! SBASE2-3=SBASE R3-1=0 X3-1! SBASE3-1=SBASE VMSTAR=1 ANSTAR=0"
_WINDING = "WINDV=WINDING NOMV=0 ANG=0"
_CONTROL = " COD=0 CONT=0"
_SECOND = "WINDV=WINDING NOMV=0"
_AREA = "I! ISW=0 PDES=0 PTOL=10 'ARNAME'"
_SHUNT_STATUS = "ADJM=0 STAT=1 "
_SHUNT_CONTROL = "VSWHI=1 VSWLO=1 SWREM=0"
_SHUNT_REST = " RMPCT=100 'RMIDNT' BINIT=0"
_DC_LINE = "'NAME'! MDC=0 RDC! SETVL! VSCHD! VCMOD=0 RCOMP=0 DELTI=0 METER=I DCVMIN=0"
_THYRISTORS = "IP! NB! ANMX! ANMN! RC! XC! EBAS! TR=1 TAP=1 TMX=1.5 TMN=0.51 STP=0.00625 IC=0"
_CAPACITOR = " IF=0 IT=0 'ID'=1 XCAP=0"
_VSC_LINE = "'NAME'! MDC=1 RDC!"
_TRANSISTORS = (
    "IBUS! TYPE! MODE=1 DCSET=0 ACSET=1 ALOSS=0 BLOSS=0 MINLOSS=0 SMAX=0 IMAX=0 PWF=1 MAXQ=9999 "
    "MINQ=-9999 REMOT=0"
)
_TEXTS_WITHOUT_QUOTES = ("METER",)
#: Numbers of buses, and of what buses belong to, with their least value.
_LEAST = {"I": 1, "J": 1, "K": 0, "AREA": 0, "ZONE": 0, "OWNER": 0, "IREG": 0, "SWREM": 0, "ISW": 0}
_BASES = {"SBASE": Base.SYSTEM, "WINDING": Base.WINDING}
#: Last revision with shunts in the records of buses, and without the metered end of lines.
OLD_UNTIL = 30
_SHUNT_STATUS_SINCE = 32
#: Least revision of the records that are written.
WRITTEN_SINCE = 32


@cache
def layouts(revision: int) -> Mapping[str, tuple[Layout, ...]]:
    """Layouts of the lines of a record, by section."""
    ratings = _RATINGS if revision < 34 else _TWELVE
    winding = _WINDING + ratings + _CONTROL
    node = " NREG=0" if revision >= 35 else ""
    thyristors = _THYRISTORS + (" ND=0" if revision >= 35 else "") + _CAPACITOR
    transistors = _TRANSISTORS + node + " RMPCT=100"
    texts = {
        "BUS": [_BUS if revision > OLD_UNTIL else _OLD_BUS],
        "LOAD": [_LOAD + (_DISTRIBUTED if revision >= 34 else "")],
        "FIXED SHUNT": [_FIXED_SHUNT],
        "GENERATOR": [_UNIT + node + _MACHINE],
        "BRANCH": [
            _LINE
            + (" 'NAME'" if revision >= 34 else "")
            + ratings
            + _LINE_ENDS
            + (_METERED if revision > OLD_UNTIL else "")
        ],
        "SYSTEM SWITCHING DEVICE": [_SWITCH],
        "TRANSFORMER": [_WINDINGS, _PAIR, winding, _SECOND],
        THREE_WINDING: [_WINDINGS, _PAIRS, winding, winding, winding],
        "AREA": [_AREA],
        "TWO-TERMINAL DC": [_DC_LINE, thyristors, thyristors],
        "VSC DC LINE": [_VSC_LINE, transistors, transistors],
        "SWITCHED SHUNT": [
            ("I! 'ID'=1 MODSW=1 " if revision >= 35 else "I! MODSW=1 ")
            + (_SHUNT_STATUS if revision >= _SHUNT_STATUS_SINCE else "")
            + _SHUNT_CONTROL
            + node
            + _SHUNT_REST
        ],
    }
    return {section: tuple(_layout(line) for line in lines) for section, lines in texts.items()}


def _layout(text: str) -> Layout:
    return tuple(_column(item) for item in text.split())


def _column(item: str) -> Column:
    name, given, default = item.partition("=")
    value: str | Base | None = _BASES.get(default, default) if given else None
    bare = name.strip("'!")
    is_text = name.startswith("'") or bare in _TEXTS_WITHOUT_QUOTES
    return Column(bare, value, name.endswith("!"), is_text, _LEAST.get(bare))
