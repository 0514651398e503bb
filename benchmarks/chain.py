"""Large grids with known operating points: copies of a case joined in a chain by tie lines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from gridfold import Branch, Case, Control, Generator, solve_power_flow

#: Distance of the bus numbers of two neighbouring copies.
OFFSET = 1000

#: Buses of NPCC by which neighbouring copies are joined: the far ends of the two lines that join New
#: England to the rest.
TIE_BUSES = (37, 73)

_TIE = Branch(0, 0, "tie", resistance=0.001, reactance=0.02)


def chain(case: Case, copies: int, tie_buses: Sequence[int] = TIE_BUSES) -> Case:
    """Join `copies` of `case` in a chain.

    Bus numbers of copy k = 0, 1, ... are those of the case plus 1000 k, and the buses `tie_buses` of
    neighbouring copies are joined by tie lines. Only the first copy keeps its slack generators; those
    of the others hold their voltage at the power that the slack supplies in the single case. Equal
    buses then have equal voltages: the tie lines carry nothing at the start and the operating point
    is that of the case.
    """
    if max(bus.number for bus in case.buses) >= OFFSET:
        raise ValueError(f"the bus numbers of {case.name} must stay below {OFFSET}")
    shifts = [OFFSET * k for k in range(copies)]
    ties = [
        replace(_TIE, from_bus=shift + bus, to_bus=shift + OFFSET + bus)
        for shift in shifts[:-1]
        for bus in tie_buses
    ]
    units = case.generators + _copy(_scheduled(case), shifts[1:], "bus")
    return Case(
        name=f"{case.name}-x{copies}",
        buses=_copy(case.buses, shifts, "number"),
        branches=(*_copy(case.branches, shifts, "from_bus", "to_bus"), *ties),
        generators=units,
        loads=_copy(case.loads, shifts, "bus"),
        shunts=_copy(case.shunts, shifts, "bus"),
        devices=_copy(case.devices, shifts, "bus"),
        base_mva=case.base_mva,
        frequency_hz=case.frequency_hz,
        description=f"{copies} copies of {case.name} in a chain",
    )


def _scheduled(case: Case) -> tuple[Generator, ...]:
    """The generators of `case`, its slack units as voltage-controlled ones at their solved power."""
    power = solve_power_flow(case).unit_power.real * case.base_mva
    return tuple(
        replace(unit, control=Control.VOLTAGE, active_mw=float(solved))
        if unit.control is Control.SLACK
        else unit
        for unit, solved in zip(case.generators, power, strict=True)
    )


def _copy(records: Iterable[Any], shifts: Iterable[int], *numbers: str) -> tuple[Any, ...]:
    """Copies of all records with their bus numbers shifted."""
    rows = tuple(records)
    return tuple(
        replace(row, **{name: getattr(row, name) + shift for name in numbers})
        for shift in shifts
        for row in rows
    )
