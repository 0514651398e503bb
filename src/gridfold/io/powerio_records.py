"""From powerio's tables to records of the case; see :mod:`gridfold.io.powerio_cases`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gridfold.errors import CaseFileError
from gridfold.grid.case import Branch, Bus, Case, Control, Generator, Load, Shunt
from gridfold.grid.dc_lines import DcLine
from gridfold.grid.energy_source import EnergySource
from gridfold.io.case_draft import (
    Draft,
    Row,
    free_id,
    islands_without_slack,
    with_swings_behind_dc,
    without_buses,
)
from gridfold.io.flow_controls import shunt_control, unit_control
from gridfold.io.joined_units import with_one_voltage_a_node, with_part
from gridfold.io.powerio_branches import add_branches, add_three_winding

_CONTROL = {"PQ": Control.POWER, "PV": Control.VOLTAGE, "REF": Control.SLACK}
#: Key under which the row of a generator holds the names of its fields that were blank.
BLANK_FIELDS = "blank_fields"
#: Key under which the row of a bus holds its owner.
OWNER = "owner"
_LEFT_OUT = {
    "static_var_compensators": "static var compensator",
    "storage": "storage",
}


@dataclass(frozen=True)
class Extras:
    """What a file holds beside the tables of powerio.

    Parameters
    ----------
    dc_lines : tuple of (DcLine, str)
        Dc lines with two ends, each with its file and line.
    bus_shunts : tuple of (Mapping, str)
        Fields of bus records with shunts, up to revision 30, each with its file and line.
    unsupported : tuple of str
        What gridfold has no model for.
    """

    dc_lines: tuple[tuple[DcLine, str], ...] = ()
    bus_shunts: tuple[tuple[Mapping[str, str], str], ...] = ()
    unsupported: tuple[str, ...] = ()


def convert_network(
    tables: Mapping[str, Any], name: str, places: Mapping[str, Sequence[str]], extras: Extras
) -> Case:
    """Build a case.

    Parameters
    ----------
    tables : mapping
        The data of a balanced network in powerio's own document format, version 2.
    name : str
        Name of the case.
    places : mapping of str to sequence of str
        For each table of powerio, file and line of its rows where they are known.
    extras : Extras
        What is not in these tables.

    Raises
    ------
    CaseFileError
        A correction table is missing or has no order.
    """
    draft = Draft(tables, places)
    draft.unsupported += extras.unsupported
    for row, place in draft.rows("buses"):
        draft.add(_bus(row), place)
    for row, place in draft.rows("loads"):
        _add_load(draft, row, place)
    _add_shunts(draft, extras)
    _add_generators(draft)
    add_branches(draft)
    for row, place in draft.rows("transformers_3w"):
        add_three_winding(draft, row, place)
    _note_left_out(draft)
    if draft.faults:
        raise CaseFileError(draft.faults, name)
    for line, place in extras.dc_lines:
        draft.origins.setdefault(str(line), place)
    case = Case(
        name,
        buses=tuple(draft.records[Bus]),
        branches=tuple(draft.records[Branch]),
        generators=tuple(draft.records[Generator]),
        loads=tuple(draft.records[Load]),
        shunts=tuple(draft.records[Shunt]),
        base_mva=float(tables["base_mva"]),
        frequency_hz=float(tables["base_frequency"]),
        description=str(tables["name"]),
        area_names={row["number"]: row["name"] for row in tables["areas"] if row.get("name")},
        dc_lines=tuple(line for line, _ in extras.dc_lines),
        flow_controls=tuple(draft.controls),
        origins=draft.origins,
    )
    kinds = {row["id"]: row["kind"] for row in tables["buses"]}
    isolated = [number for number, kind in kinds.items() if kind == "ISOLATED"]
    if isolated:
        case, (text,) = without_buses(case, isolated)
        draft.notices.append(f"isolated {text}")
    case, texts = with_swings_behind_dc(case)
    draft.notices += texts
    case, texts = without_buses(case, *islands_without_slack(case))
    draft.unsupported += [f"an island without a slack unit: {text}" for text in texts]
    case, texts = with_one_voltage_a_node(case)
    draft.notices += texts
    return replace(case, unsupported=tuple(draft.unsupported), notices=tuple(draft.notices))


def _bus(row: Row) -> Bus:
    return Bus(
        number=row["id"],
        name=row.get("name") or "",
        base_kv=float(row["base_kv"]) or Bus.base_kv,
        area=row["area"],
        zone=row["zone"],
        voltage_pu=float(row["vm"]),
        angle_deg=float(row["va"]),
        owner=row.get(OWNER, Bus.owner),
    )


def _add_load(draft: Draft, row: Row, place: str) -> None:
    model, extras = row.get("voltage_model"), row["extras"]
    load = Load(
        bus=row["bus"],
        id=extras.get("id", "1"),
        active_mw=float(row["p"]),
        reactive_mvar=float(row["q"]),
        in_service=row["in_service"],
        area=int(extras.get("psse_area") or 0),
        zone=int(extras.get("psse_zone") or 0),
        owner=int(extras.get("psse_owner") or 0),
    )
    if model and model["kind"] == "zip":
        load = replace(
            load,
            active_mw=float(model["p_constant_power"]),
            reactive_mvar=float(model["q_constant_power"]),
            current_active_mw=float(model["p_constant_current"]),
            current_reactive_mvar=float(model["q_constant_current"]),
            impedance_active_mw=float(model["p_constant_impedance"]),
            impedance_reactive_mvar=float(model["q_constant_impedance"]),
        )
    elif model:
        draft.unsupported.append(f"{load}: voltage dependence {model['kind']!r}")
    draft.add(load, place)
    embedded = extras.get("psse_pdgen") or extras.get("psse_qdgen")
    if load.in_service and extras.get("psse_flagstatus") and embedded:
        draft.unsupported.append(f"{load}: distributed generation within the load")


def _add_shunts(draft: Draft, extras: Extras) -> None:
    """Shunts of bus records, fixed ones by their ids, switched ones by ``S`` and theirs.

    An id that is taken gets another ``S``.
    """
    taken: set[tuple[int, str]] = set()
    for fields, place in extras.bus_shunts:
        bus, conductance, susceptance = int(fields["I"]), float(fields["GL"]), float(fields["BL"])
        taken.add((bus, "1"))
        draft.add(Shunt(bus, "1", conductance, susceptance), place)
    for row, place in draft.rows("shunts"):
        identifier = row["extras"].get("id", "1")
        if row.get("control"):
            identifier = f"S{identifier}"
            while (row["bus"], identifier) in taken:
                identifier = f"S{identifier}"
        taken.add((row["bus"], identifier))
        shunt = Shunt(
            bus=row["bus"],
            id=identifier,
            conductance_mw=float(row["g"]),
            susceptance_mvar=float(row["b"]),
            in_service=row["in_service"],
        )
        draft.add(shunt, place)
        if row.get("control"):
            draft.controls.append(shunt_control(row, identifier))


def _add_generators(draft: Draft) -> None:
    buses = {row["id"]: row for row in draft.tables["buses"]}
    detail = draft.tables.get("detailed_connectivity") or {}
    properties = {
        entry["component"]["local_id"]: entry["properties"]
        for entry in detail.get("component_metadata") or ()
        if entry["component"]["component_type"] == "generator"
    }
    taken: dict[int, set[str]] = defaultdict(set)
    units: list[tuple[Generator, str]] = []
    at_bus: dict[int, list[Generator]] = defaultdict(list)
    defaulted: dict[str, list[Generator]] = defaultdict(list)
    for row, place in draft.rows("generators"):
        own = properties.get(row["uid"], {})
        bus = buses[row["bus"]]
        unit = Generator(
            bus=row["bus"],
            id=own.get("psse_eqid") or free_id(taken[row["bus"]]),
            active_mw=float(row["pg"]),
            reactive_mvar=float(row["qg"]),
            voltage_pu=float(bus["vm"]),
            base_mva=float(row["mbase"]) or float(draft.tables["base_mva"]),
            control=_CONTROL.get(bus["kind"], Control.POWER),
            in_service=row["in_service"] and not _at_load_bus(draft, bus),
            source_resistance=float(own.get("psse_zr", 0.0)),
            source_reactance=float(own.get("psse_zx", 1.0)),
            source=EnergySource.WIND if float(own.get("psse_wmod", 0)) else EnergySource.UNKNOWN,
        )
        if row["in_service"] and not unit.in_service:
            draft.notices.append(_load_bus_notice(unit, place))
        draft.controls.append(unit_control(row, unit.bus, unit.id, own))
        taken[unit.bus].add(unit.id)
        units.append((unit, place))
        at_bus[unit.bus].append(unit)
        if unit.in_service and BLANK_FIELDS in row:
            for name in row[BLANK_FIELDS] | ({"MBASE"} if not float(row["mbase"]) else set()):
                defaulted[name].append(unit)
        if unit.in_service and (float(own.get("psse_rt", 0.0)) or float(own.get("psse_xt", 0.0))):
            draft.unsupported.append(f"{unit} ({place}): step-up transformer within the generator")
    draft.notices += _blank_notices(defaulted)
    for unit, place in units:
        draft.add(with_part(unit, at_bus[unit.bus]), place)


def _at_load_bus(draft: Draft, bus: Row) -> bool:
    """Whether PSS/E leaves a unit out for the type of its bus: type 1 of a RAW file."""
    return bool(draft.tables["source_format"] == "psse" and bus["kind"] == "PQ")


def _load_bus_notice(unit: Generator, place: str) -> str:
    where = f" ({place})" if place else ""
    return (
        f"{unit}{where}: out of service, {unit.active_mw:g} MW: its bus is of type 1, and PSS/E runs "
        "units at buses of type 2 and 3 alone"
    )


def _blank_notices(defaulted: Mapping[str, Sequence[Generator]]) -> Iterator[str]:
    """What stands for blank fields of generators that say on what base or behind what they are."""
    for name, of_what in (("MBASE", "MVA, SBASE of the header,"), ("ZX", "p.u. for ZSORCE")):
        if units := defaulted.get(name):
            value = units[0].base_mva if name == "MBASE" else units[0].source_reactance
            listed = ", ".join(str(unit.key) for unit in units)
            yield f"no {name} given, {value:g} {of_what} taken: {listed}"


def _note_left_out(draft: Draft) -> None:
    if draft.tables["source_format"] != "psse":  # those of RAW files are among the extras
        for row, place in draft.rows("hvdc"):
            if row["in_service"]:
                name, where = f"{row['from']}-{row['to']}", f" ({place})" if place else ""
                draft.unsupported.append(f'two-terminal dc line "{name}": 1 record{where}')
    for table, name in _LEFT_OUT.items():
        live = [row["bus"] for row, _ in draft.rows(table) if row.get("in_service", True)]
        draft.unsupported += [f"{name} at bus {bus}: 1 record" for bus in live]
