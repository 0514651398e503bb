"""A RAW file of five buses put together in place, so that a test shows what it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

BUSES = (
    "1,'GEN-A',18.0,3,1,1,1,1.02,0.0",
    "2,'GEN-B',20.0,2,1,1,1,1.01,0.0",
    "3,'NORTH',230.0,1,1,1,1,1.0,0.0",
    "4,'TOWN',230.0,1,1,1,1,1.0,0.0",
    "5,'SOUTH',115.0,1,2,1,1,1.0,0.0",
)
LOADS = ("4,'1',1,1,1,180.0,50.0,0,0,0,0,1", "5,'1',1,2,1,90.0,25.0,0,0,0,0,1")
UNITS = (
    "1,'1',140.0,20.0,200,-200,1.02,0,250.0,0.0,0.25,0,0,1.0,1,100,250,0",
    "2,'1',130.0,10.0,150,-150,1.01,0,200.0,0.0,0.25,0,0,1.0,1,100,200,0",
)
LINES = (
    "3,4,'1',0.01,0.08,0.04,0,0,0,0,0,0,0,1,1",
    "3,4,'2',0.011,0.085,0.04,0,0,0,0,0,0,0,1,1",
    "4,5,'1',0.008,0.06,0.03,0,0,0,0,0,0,0,1,1",
    "3,5,'1',0.012,0.1,0.05,0,0,0,0,0,0,0,1,1",
)
TRANSFORMERS = (
    "1,3,0,'1',1,1,1,0.0,0.0,2,'XF1-3',1",
    "0.0,0.05,100.0",
    "1.03,0.0,0.0,0,0,0,0,0",
    "1.0,0.0",
    "2,5,0,'1',1,1,1,0.0,0.0,2,'XF2-5',1",
    "0.0,0.06,100.0",
    "0.98,0.0,0.0,0,0,0,0,0",
    "1.0,0.0",
)
_SECTIONS = (
    "BUS",
    "LOAD",
    "FIXED SHUNT",
    "GENERATOR",
    "BRANCH",
    "SYSTEM SWITCHING DEVICE",
    "TRANSFORMER",
    "AREA",
    "TWO-TERMINAL DC",
    "VSC DC LINE",
    "IMPEDANCE CORRECTION",
    "MULTI-TERMINAL DC",
    "MULTI-SECTION LINE",
    "ZONE",
    "INTER-AREA TRANSFER",
    "OWNER",
    "FACTS DEVICE",
    "SWITCHED SHUNT",
    "GNE",
    "INDUCTION MACHINE",
)
_PLAIN = {
    "BUS": BUSES,
    "LOAD": LOADS,
    "GENERATOR": UNITS,
    "BRANCH": LINES,
    "TRANSFORMER": TRANSFORMERS,
}


def raw_text(
    changes: Mapping[str, Sequence[str]] | None = None,
    header: str = "0,100.0,33,0,1,60.0",
    titles: Sequence[str] = ("FIVE BUSES", "OF THE TESTS"),
) -> str:
    """The file with the records of the sections in `changes` in place of its own."""
    records = {**_PLAIN, **(changes or {})}
    lines = [header, *titles]
    sections = [s for s in _SECTIONS if s in records or s != "SYSTEM SWITCHING DEVICE"]
    for section, following in zip(sections, (*sections[1:], ""), strict=True):
        begin = f", BEGIN {following} DATA" if following else ""
        lines += [*records.get(section, ()), f"0 / END OF {section} DATA{begin}"]
    return "\n".join([*lines, "Q", ""])


def with_field(record: str, position: int, value: str) -> str:
    """A record of commas with another value at a place counted from 0."""
    fields = record.split(",")
    fields += [""] * (position + 1 - len(fields))
    fields[position] = value
    return ",".join(fields)
