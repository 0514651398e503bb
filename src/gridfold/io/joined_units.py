"""Units that hold one voltage: at one bus, or at buses that branches without impedance join."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from gridfold.grid.case import Case, Control, Generator
from gridfold.grid.nodes import node_of_buses

_SAME = 1e-6  # p.u. of voltage


def with_part(unit: Generator, beside: Sequence[Generator]) -> Generator:
    """The unit with its part of the power of those `beside` it, so that the stored powers are met.

    Of several swing units the largest stays one.
    """
    live = [other for other in beside if other.in_service]
    if len(live) < 2 or unit not in live or unit.control is Control.POWER:
        return unit
    powers = [other.reactive_mvar for other in live]
    alike = all(power > 0 for power in powers) or all(power < 0 for power in powers)
    share = abs(unit.reactive_mvar) if alike else unit.base_mva
    largest = max(live, key=_rank)
    control = unit.control if unit == largest else Control.VOLTAGE
    return replace(unit, share=share, control=control)


def with_one_voltage_a_node(case: Case) -> tuple[Case, list[str]]:
    """The case whose units at joined buses hold one voltage, and what was changed in words.

    It is that of the swing unit, else that of the largest.
    """
    nodes = node_of_buses(case).tolist()
    if len(set(nodes)) == len(nodes):
        return case, []
    together: dict[int, list[Generator]] = defaultdict(list)
    for unit in case.generators:
        if unit.in_service and unit.control is not Control.POWER:
            together[nodes[case.bus_index[unit.bus]]].append(unit)
    changed: dict[str, Generator] = {}
    texts = []
    for units in together.values():
        if len({unit.bus for unit in units}) < 2:
            continue
        leading = max(units, key=_rank)
        for unit in units:
            if abs(unit.voltage_pu - leading.voltage_pu) > _SAME:
                texts.append(
                    f"{unit} holds {leading.voltage_pu:g} p.u. in place of {unit.voltage_pu:g}: its "
                    f"bus is joined to that of {leading}"
                )
            held = replace(with_part(unit, units), voltage_pu=leading.voltage_pu)
            changed[str(unit)] = held
    units_now = tuple(changed.get(str(unit), unit) for unit in case.generators)
    return replace(case, generators=units_now), texts


def _rank(unit: Generator) -> tuple[bool, float]:
    return unit.control is Control.SLACK, unit.base_mva
