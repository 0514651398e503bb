"""What values of records are called: gridfold's names, and the symbols of PSS/E."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from gridfold.dynamics.device import Device
from gridfold.errors import OptionError
from gridfold.grid.case import Branch, Bus, Generator, Load, Shunt
from gridfold.io.tables import suggest

#: Symbols of PSS/E's records, for the fields that mean the same.
SYMBOLS: Mapping[type, Mapping[str, str]] = {
    Bus: {
        "NAME": "name",
        "BASKV": "base_kv",
        "VM": "voltage_pu",
        "VA": "angle_deg",
    },
    Branch: {
        "R": "resistance",
        "X": "reactance",
        "B": "susceptance",
        "R1-2": "resistance",
        "X1-2": "reactance",
        "WINDV1": "ratio",
        "ANG1": "shift_deg",
        "ST": "in_service",
        "STAT": "in_service",
        "GI": "from_conductance",
        "BI": "from_susceptance",
        "GJ": "to_conductance",
        "BJ": "to_susceptance",
        "MAG1": "from_conductance",
        "MAG2": "from_susceptance",
    },
    Generator: {
        "PG": "active_mw",
        "QG": "reactive_mvar",
        "VS": "voltage_pu",
        "MBASE": "base_mva",
        "STAT": "in_service",
        "ZR": "source_resistance",
        "ZX": "source_reactance",
    },
    Load: {
        "PL": "active_mw",
        "QL": "reactive_mvar",
        "STATUS": "in_service",
        "IP": "current_active_mw",
        "IQ": "current_reactive_mvar",
        "YP": "impedance_active_mw",
    },
    Shunt: {"GL": "conductance_mw", "BL": "susceptance_mvar", "STATUS": "in_service"},
}
#: Fields that name a record.
KEYS = frozenset({"number", "bus", "id", "from_bus", "to_bus", "circuit"})
#: Typographic primes, and the double one on a keyboard.
_PRIMES = str.maketrans(
    {"\N{RIGHT SINGLE QUOTATION MARK}": "'", "\N{PRIME}": "'", '"': "''", "\N{DOUBLE PRIME}": "''"}
)


def field_name(kind: type, name: str) -> str:
    """The field of a record of the network that a name or a symbol stands for."""
    names = [item.name for item in fields(kind)]
    symbols = SYMBOLS[kind]
    if name.lower() in names:
        return name.lower()
    if name.upper() in symbols:
        return symbols[name.upper()]
    settable = [known for known in names if known not in KEYS]
    raise OptionError(f"there is no such value; {suggest(name, [*settable, *symbols])}")


def parameter_name(device: Device, name: str) -> str:
    """The parameter of a device model that a name or a symbol stands for."""
    symbols = {parameter.name: parameter.symbol for parameter in device.parameters}
    if name.lower() in symbols:
        return name.lower()
    for look in (str, _plain):
        found = [own for own, symbol in symbols.items() if look(symbol) == look(name)]
        if len(found) == 1:
            return found[0]
    if found:
        listed = " or ".join(f"{symbols[own]} ({own})" for own in found)
        raise OptionError(f"say which: {listed}")
    if not symbols:
        raise OptionError(f"{device.model.upper()} has no parameters")
    known = [f"{symbol} ({own})" for own, symbol in symbols.items()]
    close = suggest(name, [*symbols, *symbols.values()])
    hint = close if close.startswith("did") else f"known: {', '.join(known)}"
    raise OptionError(f"{device.model.upper()} has no such parameter; {hint}")


def _plain(symbol: str) -> str:
    """A symbol without what people write in several ways: capitals, primes, T'do for T'd0."""
    return symbol.translate(_PRIMES).casefold().replace("o", "0")
