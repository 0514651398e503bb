"""Lines, transformers and switching devices of powerio's tables as branches of the case."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from gridfold.grid.case import Branch, Bus
from gridfold.io.case_draft import Draft, Row, free_id
from gridfold.io.impedance_tables import correction_factor

#: Key under which a row holds the charging of a line alone, without what stands at its ends.
LINE_CHARGING = "line_charging"
#: Key under which a row says whether it is taken to have no impedance at all.
JOINS = "joins"
_LISTED = 8
_LEG_REACTANCE = 1e-5  # p.u., of a star's leg whose impedance is zero
_LEG_ROUNDING = 1e-9


def add_branches(draft: Draft) -> None:
    """Add all branches with two ends; where the format has no circuit ids they are numbered."""
    taken: dict[frozenset[int], set[str]] = defaultdict(set)
    by_hand = draft.tables["source_format"] == "psse"  # its circuits have ids, given or 1
    for row, place in draft.rows("branches"):
        pair = taken[frozenset((row["from"], row["to"]))]
        circuit = row["extras"].get("id") or ("1" if by_hand else free_id(pair))
        pair.add(circuit)
        _add_branch(draft, row, circuit, place)
    for row, place in draft.rows("switches"):
        extras = row["extras"]
        reactance = 0.0 if row.get(JOINS) else float(extras.get("psse_xpu", 0.0))
        circuit = extras.get("psse_ckt", "1")
        device = Branch(row["from"], row["to"], circuit, reactance=reactance)
        draft.add(replace(device, in_service=row["closed"]), place)
    _note_joining(draft)


def _note_joining(draft: Draft) -> None:
    joining = [branch for branch in draft.records[Branch] if branch.joins and branch.in_service]
    if joining:
        listed = ", ".join(str(branch).removeprefix("branch ") for branch in joining[:_LISTED])
        more = f" and {len(joining) - _LISTED} more" if len(joining) > _LISTED else ""
        draft.notices.append(f"without impedance, so that their buses are one node: {listed}{more}")


def _add_branch(draft: Draft, row: Row, circuit: str, place: str) -> None:
    joins = row.get(JOINS) and not row["tap"]
    ratio, shift = float(row["tap"]) or 1.0, float(row["shift"])
    impedance = 0j if joins else complex(float(row["r"]), float(row["x"]))
    branch = Branch(row["from"], row["to"], circuit, ratio=ratio, shift_deg=shift)
    table, number = row["extras"].get("impedance_correction"), row["extras"].get("psse_tab")
    impedance *= _correction(draft, f"{branch} ({place})", table, number, ratio, shift)
    branch = replace(
        branch,
        resistance=impedance.real,
        reactance=impedance.imag,
        in_service=row["in_service"],
    )
    draft.add(_with_charging(branch, row), place)


def _with_charging(branch: Branch, row: Row) -> Branch:
    """The branch with its charging, and what stands at its ends beside that.

    powerio adds up both, and refers what is at the first end to the other side of the transformer.
    """
    total, ends = float(row["b"]), row.get("charging")
    if not ends:
        return replace(branch, susceptance=total)
    charging = float(row.get(LINE_CHARGING, 0.0 if row["tap"] else total))
    at_from = complex(ends["g_fr"], ends["b_fr"] - charging / 2) / branch.ratio**2
    at_to = complex(ends["g_to"], ends["b_to"] - charging / 2)
    return with_ends(replace(branch, susceptance=charging), at_from, at_to)


def with_ends(branch: Branch, at_from: complex, at_to: complex = 0j) -> Branch:
    """The branch with these admittances at its ends."""
    return replace(
        branch,
        from_conductance=at_from.real,
        from_susceptance=at_from.imag,
        to_conductance=at_to.real,
        to_susceptance=at_to.imag,
    )


def _correction(
    draft: Draft, where: str, table: Row | None, number: object, ratio: float, shift_deg: float
) -> complex:
    """Factor of the impedance of a winding by its correction table; 1 without one."""
    if table:
        try:
            return correction_factor(table, ratio, shift_deg)
        except ValueError as error:
            draft.faults.append(f"{where}: {error}")
    elif number:
        draft.unsupported.append(f"{where}: impedance correction table {number} is not in the file")
    return 1 + 0j


def add_three_winding(draft: Draft, row: Row, place: str) -> None:
    """Add a transformer with three windings as a star bus and three branches."""
    extras, windings = row["extras"], row["windings"]
    circuit = extras.get("id", "1")
    at = [winding["bus"] for winding in windings]
    name = f"transformer {'-'.join(map(str, at))}:{circuit}"
    if not row["in_service"]:
        draft.notices.append(f"{name}, out of service, left out")
        return
    star = _star_bus(draft, row, name)
    draft.add(star, place)
    live = extras.get("winding_in_service", (True, True, True))
    legs = _star_impedances(row["z"])
    for winding, star_leg, in_service, factor in zip(
        windings, legs, live, _corrections(draft, row, f"{name} ({place})"), strict=True
    ):
        leg = star_leg * factor
        branch = Branch(
            from_bus=winding["bus"],
            to_bus=star.number,
            circuit=circuit,
            resistance=leg.real,
            reactance=leg.imag if leg else _LEG_REACTANCE,
            ratio=float(winding["tap"]) or 1.0,
            shift_deg=float(winding["shift"]),
            in_service=in_service,
        )
        if winding is windings[0]:
            branch = with_ends(branch, complex(float(row["mag_g"]), float(row["mag_b"])))
        draft.add(branch, place)
        if not leg:
            draft.notices.append(f"{branch}: no impedance; {_LEG_REACTANCE:g} p.u. taken")


def _corrections(draft: Draft, row: Row, where: str) -> list[complex]:
    """Factors of the impedances of the three windings by their correction tables."""
    tables = row["extras"].get("impedance_correction") or (None, None, None)
    return [
        _correction(
            draft,
            where,
            table,
            row["extras"].get(f"psse_tab{k}"),
            float(winding["tap"]) or 1.0,
            float(winding["shift"]),
        )
        for k, (winding, table) in enumerate(zip(row["windings"], tables, strict=True), start=1)
    ]


def _star_impedances(pairs: Sequence[Row]) -> list[complex]:
    """Impedance from each winding to the star, from those of the pairs 1-2, 2-3 and 3-1."""
    z12, z23, z31 = (complex(float(z["r"]), float(z["x"])) for z in pairs)
    legs = ((z12 + z31 - z23) / 2, (z12 + z23 - z31) / 2, (z23 + z31 - z12) / 2)
    return [leg if abs(leg) > _LEG_ROUNDING else 0j for leg in legs]


def _star_bus(draft: Draft, row: Row, name: str) -> Bus:
    """The star; without impedance to a winding, it starts at that winding's voltage."""
    buses = {bus.number: bus for bus in draft.records[Bus]}
    joined = buses[row["windings"][0]["bus"]]
    voltage, angle = float(row["star_vm"]), float(row["star_va"])
    for winding, leg in zip(row["windings"], _star_impedances(row["z"]), strict=True):
        if not leg:
            bus = buses[winding["bus"]]
            voltage = bus.voltage_pu / (float(winding["tap"]) or 1.0)
            angle = bus.angle_deg - float(winding["shift"])
    return Bus(
        number=max(buses) + 1,
        name=f"star {row.get('name') or name}",
        area=joined.area,
        zone=joined.zone,
        owner=joined.owner,
        voltage_pu=voltage,
        angle_deg=angle,
    )
