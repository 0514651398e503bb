"""Fragments of the documentation that follow from the code, or that other commands make.

All of them are written into ``docs/_generated``, which no one edits and which is not kept.
"""

from __future__ import annotations

import json
import re
import textwrap
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from enum import Enum
from pathlib import Path
from typing import Any

import command_pages
import gallery

import gridfold
from gridfold.dynamics.device import Bound, Device, Limit, Parameter, Role, Scaling
from gridfold.dynamics.limiting import limit_symbol
from gridfold.dynamics.own_models import record_names
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.typical_data import LARGE, MEDIUM, TYPICAL
from gridfold.dynamics.usual_values import ORDERS, RANGES
from gridfold.equivalents.area_bases import PORT_TOLERANCE
from gridfold.equivalents.families import COLUMN_NORM
from gridfold.equivalents.model_kind import ANGLES_DEG, TOLERANCE, WHOLE_DEG
from gridfold.grid.case import Branch, Bus, Generator, Load, Shunt
from gridfold.grid.criteria import CRITERIA, PRESETS
from gridfold.grid.events import EVENTS
from gridfold.grid.plausible import NETWORK_ROWS
from gridfold.grid.relays import RELAYS
from gridfold.io.raw_codes import BASE, POWER_LIMITS
from gridfold.powerflow.plausible import BALANCE, VOLTAGE
from gridfold.sampling.distribution import Distribution
from gridfold.sampling.plan import plan_schema
from gridfold.sampling.rows import COLUMNS, data_columns
from gridfold.study.study_file import json_schema
from gridfold.study.summary import Figures, column_types

#: Fragments that a command of the project makes: that command, and the level of their headings.
MADE_ELSEWHERE = {
    "benchmarks": ("make bench", 2),
    "cct": ("python benchmarks/clearing_times.py", 4),
    "reproduction": ("python benchmarks/reproduce_page.py", 2),
    "error_sweeps": ("python benchmarks/error_sweeps.py", 2),
    "retained_machines": ("python benchmarks/retained_machines.py", 2),
    "verdicts": ("python benchmarks/verdicts.py", 2),
    "peers": ("make bench-peers", 2),
    "wecc240": ("make bench-peers", 2),
    "psse": ("make bench-psse", 2),
    "public_cases": ("make bench-public", 2),
    "rhs_families": ("make bench-public", 2),
    "psse_cases": ("python benchmarks/psse_cases.py", 2),
    "polish": ("make bench-polish", 2),
    "auto_studies": ("make bench-auto", 3),
    "cuda": ("make test-cuda", 2),
    "low_rank": ("make bench-low-rank", 2),
    "tolerances": ("python benchmarks/tolerances.py", 3),
    "start": ("python benchmarks/start.py", 3),
    "studies": ("python benchmarks/studies.py", 3),
    "batch": ("make bench-batch", 2),
    "fuzz": ("make fuzz", 3),
    "sampling": ("python benchmarks/sampling.py", 3),
    "matrix": ("make test-matrix", 3),
    "kill_and_resume": ("make kill-test", 3),
}

_TABLES: dict[str, type] = {
    "buses": Bus,
    "branches": Branch,
    "generators": Generator,
    "loads": Load,
    "shunts": Shunt,
}

_COLUMNS = {
    "number": "Number of the bus, positive and unique",
    "name": "Name for people",
    "base_kv": "Base voltage in kV",
    "area": "Area number; its name may stand in `case.toml`",
    "zone": "Zone number",
    "Load.area": "Area number of the load; 0: that of its bus",
    "Load.zone": "Zone number of the load; 0: that of its bus",
    "Load.owner": "Owner number of the load; 0: that of its bus",
    "Bus.voltage_pu": "Stored voltage magnitude in p.u.: start of the power flow",
    "Bus.angle_deg": "Stored voltage angle in degrees: start of the power flow",
    "latitude": "Degrees north, for maps",
    "longitude": "Degrees east, for maps",
    "owner": "Owner number, to choose buses by",
    "from_bus": "First bus; an off-nominal tap is at this end",
    "to_bus": "Second bus",
    "circuit": "Tells parallel branches apart",
    "Branch.resistance": "Series resistance in p.u. on the system base",
    "Branch.reactance": "Series reactance in p.u. on the system base; may be negative",
    "susceptance": "Total charging susceptance in p.u. on the system base",
    "from_conductance": "Conductance to ground at the first bus in p.u.; out with the branch",
    "from_susceptance": "Susceptance to ground at the first bus in p.u. (reactors: negative)",
    "to_conductance": "Conductance to ground at the second bus in p.u.; out with the branch",
    "to_susceptance": "Susceptance to ground at the second bus in p.u. (reactors: negative)",
    "ratio": "Off-nominal turns ratio at the first bus",
    "shift_deg": "Phase shift at the first bus in degrees",
    "in_service": "`false` takes the row out of the study",
    "bus": "Bus number",
    "id": "Tells units at one bus apart",
    "Generator.active_mw": "Scheduled active power in MW",
    "Generator.reactive_mvar": "Reactive power in Mvar; counts where `control` is `power`",
    "Generator.voltage_pu": "Voltage set point in p.u.",
    "base_mva": "Base of the unit's device parameters in MVA",
    "control": "What the unit holds in the power flow",
    "share": "Its part of the solved power where several units regulate one bus",
    "Load.active_mw": "Active power drawn in MW",
    "Load.reactive_mvar": "Reactive power drawn in Mvar",
    "current_active_mw": "Active power drawn by a constant current at 1 p.u. voltage in MW",
    "current_reactive_mvar": "Reactive power drawn by a constant current at 1 p.u. in Mvar",
    "impedance_active_mw": "Active power drawn by a constant impedance at 1 p.u. in MW",
    "impedance_reactive_mvar": "Reactive power drawn by a constant impedance at 1 p.u. in Mvar",
    "source_resistance": "Resistance behind which a GENCLS stands, in p.u. on `base_mva`",
    "source_reactance": "Reactance behind which a GENCLS stands, in p.u. on `base_mva`",
    "source": "What drives the unit, for typical data",
    "conductance_mw": "Power drawn at 1 p.u. voltage in MW",
    "susceptance_mvar": "Power generated at 1 p.u. voltage in Mvar (capacitors: positive)",
}

_EVENT_FIELDS = {
    "bus": "Bus number",
    "branch": "`FROM-TO` or `FROM-TO:CIRCUIT`, from either end",
    "id": "Id of the unit at the bus",
    "start": "When the fault comes, in s",
    "duration": "Time until it is cleared, in s",
    "time": "When it happens, in s",
    "fraction": "Place: 0 at the bus named first, 1 at the other",
    "resistance": "Fault resistance in p.u. on the system base",
    "reactance": "Fault reactance in p.u. on the system base",
    "trip_bus": "Cleared by opening every branch at the bus",
    "trip": "Cleared by opening the branch",
    "far_duration": "Time until it opens at the bus named second, in s; `duration` counts there else",
    "LoadStep.active_mw": "Added active power at the initial voltage, in MW; negative sheds",
    "Redispatch.active_mw": "Power that the units give more, in MW",
    "Redispatch.units": "Or which units, such as `101:1,102:1`",
    "reactive_mvar": "Added reactive power at the initial voltage, in Mvar",
    "share": "Part of the load at the start",
    "buses": "Where, by bus numbers such as `1-36,78`",
    "areas": "Where, by area numbers",
    "zones": "Where, by zone numbers",
    "susceptance_mvar": "Reactive power generated at 1 p.u. voltage, in Mvar",
    "conductance_mw": "Active power drawn at 1 p.u. voltage, in MW",
    "parameter": "Name of a parameter or a reference of a device",
    "value": "The new value; this or `change`",
    "change": "By how much it changes; this or `value`",
    "model": "Model of the device, where several of the unit have the parameter",
    "stages": "List of stages `{ pickup = ..., delay = ..., share = ... }`",
    "measured_at": "Bus that measures for all; by default each bus measures its own",
    "delay": "Time for which it has to be picked up, in s",
    "below": "Threshold from above, in p.u. or Hz",
    "above": "Threshold from below, in p.u. or Hz",
    "reach_1": "Reach of zone 1 as a part of the branch",
    "delay_1": "Delay of zone 1 in s, the breaker's time included",
    "reach_2": "Reach of zone 2 as a part of the branch",
    "delay_2": "Delay of zone 2 in s, the breaker's time included",
    "transfer_trip": "Whether the other end opens with it",
    "outer": "Distance of the outer blinders from the branch, in parts of its impedance",
    "inner": "Distance of the inner blinders from the branch, in parts of its impedance",
    "OutOfStepRelay.delay": "Least time between outer and inner blinders, in s",
    "reach": "By how much the blinders stand out beyond the ends, in parts of the branch",
}

_CRITERION_FIELDS = {
    "limit_deg": "Largest difference of two rotor angles of one island, in degrees",
    "machines": "Machines that count, such as `area:1` or `3:1,5`; all by default",
    "level": "Voltage in p.u., or a part of that at the start",
    "VoltageDip.longest": "Longest time below the level at a stretch, in s; 0: never below",
    "within": "Time after the fault from which on the voltage is not below the level, in s",
    "buses": "Buses that count, such as `kv>=100`; by default the study area, or all without one",
    "of_initial": "Whether the level is a part of the voltage at the start",
    "lowest_hz": "Lower end of the band, in Hz",
    "highest_hz": "Upper end of the band, in Hz",
    "FrequencyBand.longest": "Longest time outside at a stretch, in s; 0: never outside",
    "percent": "Least damping ratio, in %",
    "name": "What it is called in columns and reports; by default what it asks",
}

#: Defaults that depend on other keys.
_STUDY_DEFAULTS = {
    "case.raw_revision": "that of the header",
    "study_area.buses": "built-in cases: area 1",
    "study_area.areas": "built-in cases: area 1",
    "study_area.zones": "built-in cases: area 1",
    "model.column_norm": f"calibrated, else {COLUMN_NORM:g}, unless machines are chosen otherwise",
    "model.angle_deg": "calibrated, else "
    + ", ".join(f"{angle:g} (`{kind.value}`)" for kind, angle in ANGLES_DEG.items()),
    "model.whole_deg": f"{WHOLE_DEG:g}",
    "model.tolerance": f"{PORT_TOLERANCE:g}, as in the paper {TOLERANCE:g}".replace("e-0", "e-"),
    "model.weights": "`interface`, as in the paper `states`",
    "model.outputs": "`polar`, as in the paper `states`",
    "model.coupling": "`exact`",
    "run.step": "by the method",
}
#: Columns of a study's table that are not figures.
_STUDY_COLUMNS = (
    ("`number`", "whole number", "Number of the contingency in the study, from 1."),
    ("`name`", "text", "Its name."),
    (
        "`kind`",
        "text",
        "`bus fault`, `bus fault with trip`, `line fault`, `machine trip`, else `events`.",
    ),
)
_TYPES = {int: "whole number", float: "number", str: "text", bool: "`true` / `false`"}
_JSON_TYPES = {
    "integer": "whole number",
    "number": "number",
    "string": "text",
    "boolean": "`true` / `false`",
}

_BOUNDS = {Bound.ANY: "any", Bound.NOT_NEGATIVE: "≥ 0", Bound.POSITIVE: "> 0"}
_SYMBOLS = {
    "THETAP": r"\theta_P",
    "dVRMAX": r"\Delta V_{\mathrm{RMAX}}",
    "DROOP": r"R_{\mathrm{droop}}",
    "Flag": "F",
    "maxerr": r"e_{\mathrm{max}}",
    "minerr": r"e_{\mathrm{min}}",
}
_SCALINGS = {Scaling.NONE: "none", Scaling.POWER: "$\\times k$", Scaling.IMPEDANCE: "$\\div k$"}


def write_all(docs: Path) -> None:
    """Write every fragment, and check that the API page misses no public name."""
    _require_complete_api(docs / "reference" / "api.md")
    folder = docs / "_generated"
    folder.mkdir(exist_ok=True)
    for device in DEVICES.values():
        _write(folder / f"device-{device.model}.md", device_tables(device))
    _write(folder / "tables.md", case_tables())
    _write(folder / "events.md", kind_tables(EVENTS))
    _write(folder / "relays.md", kind_tables(RELAYS))
    _write(folder / "commands.md", command_pages.page())
    _write(folder / "gallery.md", gallery.page("../_generated/gallery"))
    _write(folder / "criteria.md", kind_tables(CRITERIA, _CRITERION_FIELDS))
    _write(folder / "criterion-presets.md", "".join(f"- `{name}`\n" for name in PRESETS))
    _write(folder / "study-keys.md", study_keys())
    _write(folder / "study-columns.md", study_columns())
    _write(folder / "plan-keys.md", plan_keys())
    _write(folder / "plan-columns.md", plan_columns())
    _write(folder / "plan.schema.json", json.dumps(plan_schema(), indent=2) + "\n")
    _write(folder / "typical.md", typical_tables())
    _write(folder / "usual-network.md", usual_network())
    _write(folder / "usual-devices.md", usual_devices())
    _write(folder / "usual-orders.md", usual_orders())
    _write(folder / "study.schema.json", json.dumps(json_schema(), indent=2) + "\n")
    for name, (command, level) in MADE_ELSEWHERE.items():
        made = docs / "generated" / f"{name}.md"
        _write(folder / f"{name}.md", _fragment(made, command, level))
    changelog = docs.parent / "CHANGELOG.md"
    if changelog.is_file():
        _write(folder / "changes.md", changelog.read_text(encoding="utf-8"))
    else:
        _write(folder / "changes.md", "# Changes\n\nThere is no change log yet.\n")


def case_tables() -> str:
    """Columns of the tables of a case folder."""
    parts = []
    for name, record_type in _TABLES.items():
        rows = list(_field_rows(record_type, _COLUMNS))
        parts.append(
            f"## `{name}.csv`\n\n" + _table(("Column", "Type", "Default", "Meaning"), rows)
        )
    return "\n".join(parts)


def kind_tables(kinds: Mapping[str, type], meanings: dict[str, str] = _EVENT_FIELDS) -> str:
    """Fields of every kind of event, of relay, or of criterion."""
    parts = []
    for kind, event_type in kinds.items():
        rows = list(_field_rows(event_type, meanings))
        table = _table(("Field", "Type", "Default", "Meaning"), rows)
        text = (event_type.__doc__ or "").split("\n\n")[0].replace("``", "`")
        parts.append(f"### `{kind}`: `gridfold.{event_type.__name__}`\n\n{text}\n\n{table}")
    return "\n".join(parts)


def typical_tables() -> str:
    """Typical data of each kind of unit."""
    parts = []
    for source, chosen in TYPICAL.items():
        sizes = [
            chosen.records(Generator(1, base_mva=base)) for base in (MEDIUM / 2, MEDIUM, LARGE)
        ]
        for small, medium, large in zip(*sizes, strict=True):
            every = (small.parameters, medium.parameters, large.parameters)
            rows = [
                (f"`{name}`", " / ".join(f"{value:.3g}" for value in dict.fromkeys(values)))
                for name, values in ((n, [one[n] for one in every]) for n in small.parameters)
                if name != "resistance"
            ]
            table = _table(("Parameter", "Value, of small / medium / large units"), rows)
            parts.append(f"### {source.value}: {small.model.upper()}\n\n{table}")
    return "\n".join(parts)


def study_keys() -> str:
    """Keys of the study file, a table each, from its JSON Schema."""
    return _schema_keys(json_schema())


def plan_keys() -> str:
    """Keys of the sample plan, a table each, and those of a distribution, from their JSON Schemas."""
    amounts = Distribution.model_json_schema()
    rows = [
        (f"`{key}`", _json_kind(value, {}), _key_meaning("distribution", key, value))
        for key, value in amounts["properties"].items()
    ]
    table = _table(("Key", "Type", "Meaning"), rows)
    return (
        f"{_schema_keys(plan_schema())}\n### Distributions\n\n{amounts['description']}\n\n{table}"
    )


def plan_columns() -> str:
    """Columns of a data set."""
    drawn = "*what the plan draws*"
    rows = [
        (
            name if name == drawn else f"`{name}`",
            _TYPES[column.kind],
            column.unit,
            column.meaning,
        )
        for name, column in data_columns([drawn]).items()
    ]
    assert len(rows) == len(COLUMNS) + 1
    return _table(("Column", "Type", "Unit", "Meaning"), rows)


def _schema_keys(schema: dict[str, Any]) -> str:
    """Keys of a file, a table each, from its JSON Schema."""
    top: dict[str, Any] = {"": {"properties": {}, "required": schema.get("required", ())}}
    for key, value in schema["properties"].items():
        section = value.get("$ref", value.get("items", {}).get("$ref", ""))
        table = schema["$defs"].get(section.rpartition("/")[2], {})
        if "properties" in table:
            top[key] = table
        else:
            top[""]["properties"][key] = value
    parts = []
    for name, section in top.items():
        rows = [
            (
                f"`{key}`",
                _json_kind(value, schema["$defs"]),
                _json_default(name, key, value, section),
                _key_meaning(name, key, value),
            )
            for key, value in section["properties"].items()
        ]
        array = schema["properties"].get(name, {}).get("type") == "array"
        heading = {"": "At the top"}.get(name, f"`[[{name}]]`" if array else f"`[{name}]`")
        words = "" if not name else f"{section['description']}\n\n"
        table = _table(("Key", "Type", "Default", "Meaning"), rows)
        parts.append(f"### {heading}\n\n{words}{table}")
    return "\n".join(parts)


def _key_meaning(table: str, key: str, value: dict[str, Any]) -> str:
    if "description" not in value:
        raise KeyError(f"{table}.{key} of the study file has no description")
    return value["description"]


def _json_kind(value: dict[str, Any], definitions: dict[str, Any]) -> str:
    """The type of a key in words."""
    if "$ref" in value:
        return _json_kind(definitions[value["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in value or "oneOf" in value:
        every = value.get("anyOf") or value["oneOf"]
        options = [each for each in every if each.get("type") != "null"]
        return " or ".join(_json_kind(each, definitions) for each in options)
    if "enum" in value:
        return " / ".join(f"`{each}`" for each in value["enum"])
    if "const" in value:
        return f"`{value['const']}`"
    if value["type"] == "object":
        return "distribution"
    if "prefixItems" in value:
        return f"list of {len(value['prefixItems'])} numbers"
    if value["type"] == "array":
        inside = value["items"]
        if inside["type"] == "number":
            return "list of numbers"
        return "list of " + ("tables" if inside["type"] == "object" else "texts")
    bound = ""
    if "exclusiveMinimum" in value:
        bound = f" > {value['exclusiveMinimum']:g}"
    elif "minimum" in value:
        bound = f" ≥ {value['minimum']:g}"
    return _JSON_TYPES[value["type"]] + bound


def _json_default(table: str, key: str, value: dict[str, Any], section: dict[str, Any]) -> str:
    if f"{table}.{key}" in _STUDY_DEFAULTS:
        return _STUDY_DEFAULTS[f"{table}.{key}"]
    if key in section.get("required", ()):
        return "required"
    default = value["default"]
    if default is None or default == []:
        return "none"
    return f"`{json.dumps(default)}`".replace('"', "")


def usual_network() -> str:
    """Usual values of networks and operating points."""
    rows = [
        (f"`{usual.name}`", usual.what.rstrip(","), usual.text, usual.unit, usual.source)
        for usual in (*(row.usual for row in NETWORK_ROWS), BASE, POWER_LIMITS, VOLTAGE, BALANCE)
    ]
    return _table(("Row", "What", "Usual", "Unit", "Why"), rows)


def usual_devices() -> str:
    """Usual ranges of device parameters."""
    rows = []
    for row in RANGES:
        symbols = [
            (symbol(parameter.symbol), parameter.unit)
            for device in DEVICES.values()
            for parameter in device.parameters
            if device.role is row.role and parameter.name == row.parameter
        ]
        letters = ", ".join(dict.fromkeys(letter for letter, _ in symbols))
        usual = f"{row.lowest:g} to {row.highest:g}"
        rows.append((f"`{row.name}`", letters, usual, symbols[0][1], row.source))
    return _table(("Row", "Symbol", "Usual", "Unit", "Source"), rows)


def usual_orders() -> str:
    """Usual orders of device parameters."""
    rows = [
        (
            row.role.name.lower(),
            f"`{row.larger}` {'>' if row.strict else '≥'} `{row.smaller}`",
            row.source,
        )
        for row in ORDERS
    ]
    return _table(("Role", "Usual", "Why"), rows)


def study_columns() -> str:
    """Columns of a study's table, from the docstring of :class:`Figures`.

    A column that the docstring does not name belongs to the entry whose name begins its own, or
    whose text names it.
    """
    text = typing.cast(str, Figures.__doc__).partition("----------\n")[2]
    entries = re.findall(r"^    (\w[\w, ]*) : \w+\n((?:^        .*\n?)+)", text, re.MULTILINE)
    types = column_types()
    owners = {name: _owner(name, entries) for name in types}
    rows = list(_STUDY_COLUMNS)
    for k, (_, words) in enumerate(entries):
        columns = [name for name, owner in owners.items() if owner == k]
        kinds = dict.fromkeys(_TYPES[types[name]] for name in columns)
        meaning = " ".join(words.split()).replace("``", "`")
        rows.append((", ".join(f"`{name}`" for name in columns), ", ".join(kinds), meaning))
    return _table(("Columns", "Type", "Meaning"), rows)


def _owner(column: str, entries: Sequence[tuple[str, str]]) -> int:
    """Which entry of the docstring tells of a column."""
    named = [names.split(", ") for names, _ in entries]
    tests = (
        lambda k: column in named[k],
        lambda k: f"`{column}`" in entries[k][1],
        lambda k: any(column.startswith(f"{name}_") for name in named[k]),
    )
    for fits in tests:
        for k in range(len(entries)):
            if fits(k):
                return k
    raise KeyError(f"the docstring of Figures says nothing of {column}")


def device_tables(device: Device) -> str:
    """Parameters, PSS/E record and signals of a device model."""
    head = ["Column", "Symbol", "Unit", "Range", "Default", "To system base"]
    places = _record_places(device)
    if places:
        head.append("DYR")
    rows = [_parameter_row(parameter, places) for parameter in device.parameters]
    lines = ["## Parameters\n", f"File: `devices/{device.model}.csv`\n", _table(head, rows)]
    if places:
        lines.append(_record(device))
    lines.append("## Names\n")
    for label, names in (
        ("States", device.states),
        ("Inputs", device.inputs),
        ("Outputs", device.signal_rows),
        ("Set points found at the start", device.set_points),
        ("Inputs found at the start", device.solved_inputs),
        ("Values met at the start", device.targets),
    ):
        if names:
            lines.append(f"{label}\n: " + ", ".join(f"`{name}`" for name in names) + "\n")
    if device.limits:
        lines.append(
            "Limits\n: " + ", ".join(_limit(device, limit) for limit in device.limits) + "\n"
        )
    return "\n".join(lines)


def _record_places(device: Device) -> dict[str, int]:
    """Place of each parameter among the numbers of the PSS/E record, from 1."""
    return {name: k for k, name in enumerate(device.psse_record, start=1) if name}


def _other_names(device: Device) -> str:
    """Further names of the record; those of user-written models with U1 at their end."""
    others = [name for name in record_names(device) if name != device.model.upper()]
    if not others or device.role is Role.LOAD:
        return ""
    return f" {', '.join(others)} {'has' if len(others) == 1 else 'have'} the same numbers."


def _record(device: Device) -> str:
    """The PSS/E record with the symbols of its numbers."""
    symbols = {parameter.name: parameter.symbol for parameter in device.parameters}
    numbers = [symbols[name] if name else "-" for name in device.psse_record]
    text = f"BUS '{device.model.upper()}' ID {' '.join(numbers)} /"
    lines = textwrap.wrap(text, 88, subsequent_indent="    ", break_on_hyphens=False)
    unused = "" if all(device.psse_record) else " The number at `-` is not used."
    return (
        "The column DYR counts the numbers behind the id in a PSS/E record."
        + unused
        + _other_names(device)
        + "\n\n```text\n"
        + "\n".join(lines)
        + "\n```\n"
    )


def _parameter_row(parameter: Parameter, places: dict[str, int]) -> list[str]:
    row = [
        f"`{parameter.name}`",
        symbol(parameter.symbol),
        parameter.unit,
        _BOUNDS[parameter.bound],
        "required" if parameter.default is None else f"{parameter.default:g}",
        _SCALINGS[parameter.scaling],
    ]
    return [*row, str(places.get(parameter.name, ""))] if places else row


def _limit(device: Device, limit: Limit) -> str:
    text = symbol(limit_symbol(device, limit))
    return text if limit.state is None else f"{text} (of `{limit.state}`)"


def symbol(text: str) -> str:
    """A symbol such as ``X'd`` or ``TA`` in mathematical notation."""
    return "$" + " / ".join(_typeset(part) for part in text.split("/")) + "$"


def _typeset(text: str) -> str:
    if text in _SYMBOLS:
        return _SYMBOLS[text]
    match = re.fullmatch(r"([A-Za-z])('*)(\w*)(\([\d.]+\))?", text)
    if match is None:
        raise ValueError(f"cannot typeset the symbol {text!r}")
    letter, primes, index, argument = match.groups()
    if len(index) > 1 and index[0].isalpha():
        index = rf"\mathrm{{{index}}}"
    subscript = rf"_{{{index}}}" if index else ""
    return f"{letter}{primes}{subscript}{argument or ''}"


def _field_rows(record_type: type, meanings: dict[str, str]) -> Iterator[tuple[str, ...]]:
    hints = typing.get_type_hints(record_type)
    for item in fields(record_type):
        meaning = meanings.get(f"{record_type.__name__}.{item.name}", meanings.get(item.name))
        if meaning is None:
            raise KeyError(f"docs/generate.py says nothing of {record_type.__name__}.{item.name}")
        yield f"`{item.name}`", _kind(hints[item.name]), _default(item), meaning


def _kind(hint: Any) -> str:
    if isinstance(hint, types.UnionType):
        hint = next(option for option in typing.get_args(hint) if option is not type(None))
    if isinstance(hint, type) and issubclass(hint, Enum):
        return " / ".join(f"`{member.value}`" for member in hint)
    if typing.get_origin(hint) is tuple:
        return "list"
    names = {int: "whole number", float: "number", str: "text", bool: "`true` / `false`"}
    return names[hint]


def _default(item: Field[Any]) -> str:
    if item.default is MISSING:
        return "required"
    if item.default is None or item.default == "":
        return "none"
    if isinstance(item.default, Enum):
        return f"`{item.default.value}`"
    if isinstance(item.default, bool):
        return f"`{str(item.default).lower()}`"
    return f"{item.default:g}" if isinstance(item.default, int | float) else f"`{item.default}`"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _fragment(made: Path, command: str, level: int) -> str:
    """A fragment without its title, headings from `level` down; a note if it is not there."""
    if not made.is_file():
        return (
            f"```{{note}}\nThe figures of this section are made by `{command}`: not yet run.\n```\n"
        )
    text = re.sub(r"\A\s*#+ .*\n", "", made.read_text(encoding="utf-8"))
    lines = text.splitlines()
    titles = [row for row in range(len(lines)) if _is_heading(lines, row)]
    highest = min((len(lines[row].split()[0]) for row in titles), default=level)
    for row in titles:
        lines[row] = "#" * (level - highest) + lines[row]
    return "\n".join(lines) + "\n"


def _is_heading(lines: Sequence[str], row: int) -> bool:
    """Whether a line is a heading, not a comment inside a block of code."""
    fences = sum(line.lstrip().startswith("```") for line in lines[:row])
    return fences % 2 == 0 and re.match(r"#+ ", lines[row]) is not None


def _require_complete_api(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    missing = [name for name in gridfold.__all__ if not re.search(rf"gridfold\.{name}\b", text)]
    if missing:
        raise LookupError(f"{page.name} does not mention: {', '.join(missing)}")


def _write(path: Path, text: str) -> None:
    """Write only what has changed, so that no page is built in vain."""
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
