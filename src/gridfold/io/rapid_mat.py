"""Cases from the MATLAB files of RAPID: a MATPOWER network with machines, exciters and turbines.

RAPID (Resilient Adaptive Parallel sImulator for griD, github.com/rwl/rapid, BSD-3) names these
columns in its documentation. Rows of ``ExcData`` and ``TurbData`` belong to the row of ``GenData``
with the same number; a row of ``GenData`` belongs to the generator of ``mpc.gen`` at its bus.

=========== ==================================================================================
variable    columns, from the first; those in brackets are not used
=========== ==================================================================================
mpc.bus     number; type (1 PQ, 2 PV, 3 slack, 4 isolated); Pd, Qd (MW, Mvar); Gs, Bs (MW, Mvar
            at 1 p.u.); area; Vm (p.u.), Va (degrees); base kV; zone; [limits of Vm]
mpc.gen     bus; Pg, Qg (MW, Mvar); [limits of Q]; Vg (p.u.); [base MVA]; status; [the rest]
mpc.branch  ends; r, x, b (p.u. on mpc.baseMVA); [three ratings]; ratio (0: a line); phase shift
            (degrees, at the first end); status; [limits of the angle]
GenData     bus; Xd, X'd, [X"d]; T'd0, [T"d0]; Xq, [X'q, X"q]; T'q0, [T"q0]; H (s), D (p.u.), Ra;
            [leakage reactance; time constant of the dummy coil]; frequency (Hz); base MVA
ExcData     KA, TA, KE, TE, KF, TF, AE, BE; [largest and smallest VR; time TR of the voltage filter]
TurbData    TCH (s); droop; governor time TSV (s); [largest and smallest valve position]
satdata     [saturation of both axes, which RAPID itself switches off]
=========== ==================================================================================

Decisions:

- Machine data, droop and the machine's power are per unit on the base of ``GenData``, not of
  ``mpc.gen``. In the Polish case that base is 1.3 times the apparent power of the unit, at least
  1 MVA, in the power flow with ``Vg`` (1 p.u. everywhere): so ``Vg`` is held, not the stored voltage.
- A machine becomes a two-axis machine, whose X'q is its X'd: X'q of the file is not used where it
  differs. Steady states do not depend on it. Windings with X" = X' have no effect in RAPID either.
- Limits of regulator and valve and the voltage filter have no counterpart in the models.
- A branch of 1e5 p.u. or more is open: RAPID writes 999999 for a line taken out.
- A generator at a PQ bus holds its stored power; one with a negative power is a machine like others.
  Of several at the slack bus the first balances; reactive power is shared by base MVA.
- A generator without a row in ``GenData`` becomes a negative load.
- Isolated buses, and islands with nothing but buses, are left out.

``Case.notices`` has a line for each of these that concerns the file, ``Case.replacements`` the negative
loads in service.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gridfold.errors import CaseFileError
from gridfold.grid.case import (
    Branch,
    Bus,
    Case,
    Control,
    DeviceRecord,
    Generator,
    Load,
    Shunt,
    UnitKey,
)
from gridfold.grid.replacement import Replacement
from gridfold.grid.validation import validate_case
from gridfold.io.case_draft import Draft, islands_without_slack, without_buses
from gridfold.io.input_files import read_content
from gridfold.io.mat_files import Table, read_tables

#: Fewest columns of each table.
_NETWORK = {"bus": 11, "gen": 8, "branch": 11}
_DYNAMICS = {"GenData": 18, "ExcData": 8, "TurbData": 3}

#: Bytes of a file, and of a variable of it once it is read, beyond any grid.
_LONGEST, _LARGEST = 2**28, 2**29

_ISOLATED = 4
_CONTROL = {1: Control.POWER, 2: Control.VOLTAGE, 3: Control.SLACK, _ISOLATED: Control.POWER}
_OPEN = 1e5  # p.u.

_MACHINE = {  # parameters of the two-axis machine by column of GenData, counted from 0
    "inertia": 11,
    "damping": 12,
    "resistance": 13,
    "d_reactance": 1,
    "q_reactance": 6,
    "d_transient_reactance": 2,
    "q_transient_reactance": 2,
    "d_open_circuit_time": 4,
    "q_open_circuit_time": 9,
}
_D_TRANSIENT, _Q_TRANSIENT, _FREQUENCY, _BASE_MVA = 2, 7, 16, 17
_SUBTRANSIENT = ((3, 2), (8, 7))  # X"d and X'd, X"q and X'q
_EXCITER = (
    "regulator_gain",
    "regulator_time",
    "exciter_gain",
    "exciter_time",
    "feedback_gain",
    "feedback_time",
    "saturation_a",
    "saturation_b",
)


def read_rapid(path: str | Path) -> Case:
    """Read a MATLAB file of RAPID: network, operating point, machines and their controls.

    Machines become two-axis machines with IEEE type-1 exciters, first-order governors and
    non-reheat turbines; the module says which columns are used, and how.

    Parameters
    ----------
    path : str or Path
        A MATLAB file (version 7.2 or older) with ``mpc``, ``GenData``, ``ExcData`` and ``TurbData``.

    Raises
    ------
    CaseFileError
        The file cannot be read or its data are wrong; names variable and row.
    """
    path = Path(path)
    tables, base_mva = _read_tables(path)
    if faults := list(_not_finite(tables)) or list(_inconsistent(tables)):
        raise CaseFileError(faults, str(path))
    draft = Draft(tables, {})
    _add_network(draft)
    _add_units(draft)
    case = Case(
        path.stem,
        buses=tuple(draft.records[Bus]),
        branches=tuple(draft.records[Branch]),
        generators=tuple(draft.records[Generator]),
        loads=tuple(draft.records[Load]),
        shunts=tuple(draft.records[Shunt]),
        devices=tuple(draft.records[DeviceRecord]),
        base_mva=base_mva,
        frequency_hz=float(tables["GenData"][0, _FREQUENCY]),
        description=f"{path.name}, a case of RAPID",
        origins=draft.origins,
    )
    case = _without_dead_buses(case, tables, draft.notices)
    notices = (*draft.notices, *_notices(tables))
    case = replace(case, notices=notices, replacements=_negative_loads(case))
    if faults := validate_case(case):
        raise CaseFileError(faults, str(path))
    return case


def _negative_loads(case: Case) -> tuple[Replacement, ...]:
    """What the negative loads in service touch."""
    power = {g.key: abs(g.active_mw) for g in case.generators if g.in_service}
    units = [d.key for d in case.devices if d.model == "negative_load" and d.key in power]
    if not units:
        return ()
    touched, total = sum(power[unit] for unit in units), sum(power.values())
    share = touched / total if total else 0.0
    return (Replacement("no machine data", "negative load", tuple(units), touched, share),)


def _read_tables(path: Path) -> tuple[dict[str, Table], float]:
    """All tables by name, and the base of the system in MVA."""
    try:
        content = read_tables(read_content(path, _LONGEST), ("mpc", *_DYNAMICS), _LARGEST)
    except ValueError as error:
        raise CaseFileError(f"cannot be read: {error}", str(path)) from None
    faults = []
    network = content.get("mpc")
    if "mpc" not in content:
        faults.append("the variable mpc is missing")
    elif not isinstance(network, Mapping):
        faults.append("mpc is not a structure")
    fields = network if isinstance(network, Mapping) else {}
    tables = {}
    for name, columns in {**_NETWORK, **_DYNAMICS}.items():
        inside = name in _NETWORK
        if inside and not isinstance(network, Mapping):
            continue
        label, source = (f"mpc.{name}", fields) if inside else (name, content)
        if name not in source:
            faults.append(f"{'' if inside else 'the variable '}{label} is missing")
            continue
        value = source[name]
        if fault := _shape_fault(value, columns):
            faults.append(f"{'' if inside else 'the variable '}{label} {fault}")
        elif isinstance(value, np.ndarray):
            tables[label] = value
    base = _scalar(fields.get("baseMVA"))
    if fields and base is None:
        faults.append("mpc.baseMVA is not a number")
    if faults:
        raise CaseFileError(faults, str(path))
    return tables, float(base or 0.0)


def _shape_fault(value: Any, columns: int) -> str:
    """What is wrong with a table; nothing if it can be used."""
    if not (isinstance(value, np.ndarray) and value.ndim == 2):
        return "is not a table of real numbers"
    if len(value) == 0 or value.shape[1] < columns:
        return (
            f"has {value.shape[0]} rows and {value.shape[1]} columns; "
            f"at least one row and {columns} columns are needed"
        )
    return ""


def _scalar(value: Any) -> float | None:
    usable = isinstance(value, np.ndarray) and value.size == 1
    return float(value.flat[0]) if usable else None


def _used_columns(name: str) -> int:
    return {**{f"mpc.{key}": n for key, n in _NETWORK.items()}, **_DYNAMICS}[name]


def _not_finite(tables: Mapping[str, Table]) -> Iterator[str]:
    for name, table in tables.items():
        bad = ~np.isfinite(table[:, : _used_columns(name)])
        for row, column in np.argwhere(bad):
            yield f"{name} row {row + 1}, column {column + 1}: {table[row, column]} is no number"


def _inconsistent(tables: Mapping[str, Table]) -> Iterator[str]:
    """Faults by which rows of one table do not fit those of another."""
    machines, bus = tables["GenData"], tables["mpc.bus"]
    for name in ("ExcData", "TurbData"):
        if len(tables[name]) != len(machines):
            yield f"{name} has {len(tables[name])} rows, but GenData has {len(machines)}"
    for name, columns in (
        ("mpc.bus", (0, 1, 6, 10)),
        ("mpc.gen", (0,)),
        ("mpc.branch", (0, 1)),
        ("GenData", (0,)),
    ):
        for column in columns:
            values = tables[name][:, column]
            for row in np.flatnonzero(~(np.abs(values) < 2**53) | (values != np.round(values))):
                yield f"{name} row {row + 1}, column {column + 1}: {values[row]:g} is not whole"
    for row in np.flatnonzero(~np.isin(bus[:, 1], list(_CONTROL))):
        yield f"mpc.bus row {row + 1}: there is no bus type {bus[row, 1]:g}"
    for name, columns in (("mpc.gen", (0,)), ("mpc.branch", (0, 1))):
        for row, column in np.argwhere(~np.isin(tables[name][:, columns], bus[:, 0])):
            yield f"{name} row {row + 1}: there is no bus {tables[name][row, columns[column]]:g}"
    units = set(_keys(tables["mpc.gen"][:, 0]))
    for n, key in enumerate(_keys(machines[:, 0]), start=1):
        if key not in units:
            yield f"GenData row {n}: there is no generator {key} in mpc.gen"
    rates = np.unique(machines[:, _FREQUENCY])
    if len(rates) > 1:
        yield f"GenData column {_FREQUENCY + 1}: {len(rates)} different frequencies"


def _keys(buses: Sequence[float] | Table) -> list[UnitKey]:
    """Unit of each row: ids 1, 2 ... count the rows of one bus."""
    seen: Counter[int] = Counter()
    keys = []
    for bus in np.asarray(buses).astype(int).tolist():
        seen[bus] += 1
        keys.append(UnitKey(bus, str(seen[bus])))
    return keys


def _add_network(draft: Draft) -> None:
    """Buses, loads, shunts and branches."""
    for n, row in enumerate(draft.tables["mpc.bus"].tolist(), start=1):
        place = f"mpc.bus row {n}"
        number, _, p, q, g, b, area, vm, va, base_kv, zone = row[:11]
        bus = Bus(int(number), "", base_kv or Bus.base_kv, int(area), int(zone), vm, va)
        draft.add(bus, place)
        if p or q:
            draft.add(Load(bus.number, "1", p, q), place)
        if g or b:
            draft.add(Shunt(bus.number, "1", g, b), place)
    circuits: Counter[tuple[int, ...]] = Counter()
    for n, row in enumerate(draft.tables["mpc.branch"].tolist(), start=1):
        near, far, r, x, b, _, _, _, ratio, shift, status = row[:11]
        ends = (int(near), int(far))
        circuits[tuple(sorted(ends))] += 1
        circuit = str(circuits[tuple(sorted(ends))])
        alive = status > 0 and abs(complex(r, x)) < _OPEN
        draft.add(
            Branch(*ends, circuit, r, x, b, ratio or 1.0, shift, alive), f"mpc.branch row {n}"
        )


def _add_units(draft: Draft) -> None:
    """Generators, and the devices of those that have machine data."""
    tables = draft.tables
    kinds = dict(zip(tables["mpc.bus"][:, 0], tables["mpc.bus"][:, 1], strict=True))
    data = {key: row for row, key in enumerate(_keys(tables["GenData"][:, 0]))}
    balancing: set[int] = set()
    missing = []
    for n, (key, row) in enumerate(
        zip(_keys(tables["mpc.gen"][:, 0]), tables["mpc.gen"].tolist(), strict=True), start=1
    ):
        control = _CONTROL[int(kinds[key.bus])]
        in_service = row[7] > 0
        if control is Control.SLACK and in_service:
            control = Control.VOLTAGE if key.bus in balancing else Control.SLACK
            balancing.add(key.bus)
        base = float(tables["GenData"][data[key], _BASE_MVA]) if key in data else 100.0
        draft.add(
            Generator(*key, row[1], row[2], row[5], base, control, base, in_service),
            f"mpc.gen row {n}" + (f", GenData row {data[key] + 1}" if key in data else ""),
        )
        if key in data:
            _add_devices(draft, key, data[key])
        else:
            missing.append(str(key))
            draft.add(DeviceRecord("negative_load", *key), f"mpc.gen row {n}")
    if missing:
        draft.notices.append(f"without machine data, so negative loads: {', '.join(missing)}")


def _add_devices(draft: Draft, key: UnitKey, row: int) -> None:
    machine, exciter, turbine = (draft.tables[name][row].tolist() for name in _DYNAMICS)
    models = {
        "two_axis": ("GenData", {name: machine[k] for name, k in _MACHINE.items()}),
        "ieee_type1": ("ExcData", dict(zip(_EXCITER, exciter, strict=False))),
        "first_order_governor": ("TurbData", {"droop": turbine[1], "governor_time": turbine[2]}),
        "non_reheat_turbine": ("TurbData", {"charging_time": turbine[0]}),
    }
    for model, (table, parameters) in models.items():
        draft.add(DeviceRecord(model, *key, parameters), f"{table} row {row + 1}")


def _without_dead_buses(case: Case, tables: Mapping[str, Table], notices: list[str]) -> Case:
    """The case without isolated buses and without islands that hold nothing but buses."""
    opened = [branch for branch in case.branches if _is_open(branch)]
    if opened:
        names = ", ".join(f"{b.from_bus}-{b.to_bus}:{b.circuit}" for b in opened)
        notices.append(f"open, for their impedance is {_OPEN:g} p.u. or more: {names}")
    bus = tables["mpc.bus"]
    isolated = bus[bus[:, 1] == _ISOLATED, 0].astype(int).tolist()
    if isolated:
        case, (text,) = without_buses(case, isolated)
        notices.append(f"isolated {text}")
    attached: tuple[Generator | Load | Shunt, ...] = (*case.generators, *case.loads, *case.shunts)
    busy = {record.bus for record in attached}
    dead = [island for island in islands_without_slack(case) if not busy & set(island)]
    case, texts = without_buses(case, *dead)
    notices += [f"without connection: {text}" for text in texts]
    return case


def _is_open(branch: Branch) -> bool:
    return abs(complex(branch.resistance, branch.reactance)) >= _OPEN


def _notices(tables: Mapping[str, Table]) -> list[str]:
    """What of the dynamic data is left out."""
    machines = tables["GenData"]
    saliency = np.count_nonzero(machines[:, _D_TRANSIENT] != machines[:, _Q_TRANSIENT])
    damped = np.zeros(len(machines), dtype=bool)
    for second, first in _SUBTRANSIENT:
        damped |= machines[:, second] != machines[:, first]
    lines = []
    if saliency:
        lines.append(f"GenData: X'q is taken as X'd in {saliency} machines where it differs")
    if damped.any():
        lines.append(
            f"GenData: X\" is left out in {damped.sum()} machines where it differs from X'"
        )
    if tables["ExcData"].shape[1] > len(_EXCITER):
        lines.append("ExcData: limits of VR and the voltage filter TR are left out")
    if tables["TurbData"].shape[1] > _DYNAMICS["TurbData"]:
        lines.append("TurbData: limits of the valve position are left out")
    return lines
