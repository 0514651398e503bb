"""A small valid case folder, and malformed inputs as data.

Every sample says which error it must raise and which words the message must contain. Use them as

    folder = sample.write(tmp_path)            # CASE_FOLDERS, DEVICE_FOLDERS
    events = [parse_event(text) for text in sample.texts]          # EVENTS, for the case npcc
    path.write_text(sample.text)               # EVENT_FILES
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import gridfold as gf

#: Files of a valid case of three buses and two machines; the lines of each are numbered from 1.
SMALL_CASE: dict[str, str] = {
    "case.toml": """\
name = "small"
base_mva = 100.0
frequency_hz = 60.0

[owner_names]
2 = "City"

[area_names]
1 = "All"
""",
    "buses.csv": """\
number,name,base_kv,area,voltage_pu,angle_deg
1,North,230,1,1.04,0
2,South,230,1,1.02,0
3,Town,230,1,1.00,0
""",
    "branches.csv": """\
from_bus,to_bus,circuit,resistance,reactance,susceptance,ratio,in_service
1,2,1,0.010,0.10,0.02,1.00,true
1,2,2,0.010,0.12,0.02,1.00,true
1,3,1,0.008,0.08,0.02,1.02,true
2,3,1,0.012,0.11,0.02,1.00,true
""",
    "generators.csv": """\
bus,id,active_mw,reactive_mvar,voltage_pu,base_mva,control,share
1,1,80,10,1.04,150,slack,1
2,1,60,5,1.02,100,voltage,1
""",
    "loads.csv": """\
bus,id,active_mw,reactive_mvar
3,1,140,30
""",
    "shunts.csv": """\
bus,id,conductance_mw,susceptance_mvar
3,1,0,15
""",
    "devices/two_axis.csv": """\
bus,id,inertia,damping,resistance,d_reactance,q_reactance,d_transient_reactance,\
q_transient_reactance,d_open_circuit_time,q_open_circuit_time
1,1,4.0,2.0,0,1.6,1.5,0.25,0.25,6.0,0.5
2,1,3.0,2.0,0,1.7,1.6,0.30,0.30,5.0,0.6
""",
    "devices/ieee_type1.csv": """\
bus,id,regulator_gain,regulator_time,exciter_gain,exciter_time,feedback_gain,feedback_time
1,1,20,0.2,1,0.314,0.063,0.35
2,1,20,0.2,1,0.314,0.063,0.35
""",
    "devices/first_order_governor.csv": """\
bus,id,droop,governor_time
1,1,0.05,2
""",
    "devices/non_reheat_turbine.csv": """\
bus,id,charging_time
1,1,4
""",
}


def write_small_case(folder: Path) -> Path:
    """Write the valid case into `folder`."""
    for name, text in SMALL_CASE.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


Edit = Callable[[Path], None]


@dataclass(frozen=True)
class FolderSample:
    """A fault in a case folder."""

    id: str
    edit: Edit
    words: tuple[str, ...]
    error: type[gf.GridfoldError] = gf.CaseFileError

    def write(self, folder: Path) -> Path:
        """Write the malformed case into `folder`."""
        write_small_case(folder)
        self.edit(folder)
        return folder


@dataclass(frozen=True)
class EventSample:
    """Events of which at least one is wrong for the case npcc and a run of `t_end` seconds."""

    id: str
    texts: tuple[str, ...]
    words: tuple[str, ...]
    t_end: float = 16.0


@dataclass(frozen=True)
class EventFileSample:
    """A malformed file of events."""

    id: str
    text: str
    words: tuple[str, ...]


def swap(name: str, old: str, new: str) -> Edit:
    """Replace a text that stands once in a file."""

    def edit(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        if text.count(old) != 1:
            raise ValueError(f"{old!r} stands {text.count(old)} times in {name}")
        (folder / name).write_text(text.replace(old, new), encoding="utf-8")

    return edit


def put(name: str, content: str | bytes) -> Edit:
    """Write a whole file."""

    def edit(folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

    return edit


def append(name: str, line: str) -> Edit:
    """Add a line at the end of a file."""

    def edit(folder: Path) -> None:
        with (folder / name).open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")

    return edit


def drop(name: str) -> Edit:
    """Remove a file."""
    return lambda folder: (folder / name).unlink()


def both(*edits: Edit) -> Edit:
    """Edits one after the other."""

    def edit(folder: Path) -> None:
        for each in edits:
            each(folder)

    return edit


def _circle(folder: Path) -> None:
    put("other/case.toml", 'extends = ".."')(folder)
    swap("case.toml", 'name = "small"', 'name = "small"\nextends = "other"')(folder)


def _no_column_to_bus(folder: Path) -> None:
    lines = [line.split(",") for line in SMALL_CASE["branches.csv"].splitlines()]
    text = "\n".join(",".join(cells[:1] + cells[2:]) for cells in lines)
    put("branches.csv", text)(folder)


#: Case folders that cannot be loaded.
CASE_FOLDERS: tuple[FolderSample, ...] = (
    FolderSample(
        "misspelt table",
        put("load.csv", "bus,id\n3,1\n"),
        ("load.csv", "unknown table", "did you mean 'loads'?"),
    ),
    FolderSample(
        "number with an underscore",
        swap("loads.csv", "3,1,140,30", "3,1,1_40,30"),
        ("loads.csv:2", "active_mw", "'1_40' is not a number"),
    ),
    FolderSample("no case.toml", drop("case.toml"), ("has no case.toml",)),
    FolderSample(
        "case.toml not TOML",
        put("case.toml", 'name = "a"\nbase_mva = \n'),
        ("case.toml", "not TOML", "line 2"),
    ),
    FolderSample(
        "case.toml not UTF-8", put("case.toml", b'name = "\xff"'), ("case.toml", "not UTF-8")
    ),
    FolderSample(
        "unknown setting",
        swap("case.toml", "base_mva", "base_mav"),
        ("case.toml", "unknown setting 'base_mav'", "did you mean 'base_mva'?"),
    ),
    FolderSample(
        "setting of the wrong type",
        swap("case.toml", "100.0", '"hundred"'),
        ("case.toml", "base_mva", "'hundred'", "wrong type"),
    ),
    FolderSample(
        "setting true where a number belongs",
        swap("case.toml", "60.0", "true"),
        ("case.toml", "frequency_hz", "True", "wrong type"),
    ),
    FolderSample(
        "area number not a number",
        swap("case.toml", '1 = "All"', 'one = "All"'),
        ("case.toml", "area_names", "'one'"),
    ),
    FolderSample("extends in a circle", _circle, ("extend", "circle")),
    FolderSample(
        "extends unknown",
        swap("case.toml", 'name = "small"', 'extends = "nppc"'),
        ("case.toml", "'nppc'", "neither a built-in case", "npcc", "nor a folder"),
    ),
    FolderSample(
        "extends not a text",
        swap("case.toml", 'name = "small"', "extends = 3"),
        ("case.toml", "extends", "3", "wrong type"),
    ),
    FolderSample(
        "extends a name too long for a file",
        swap("case.toml", 'name = "small"', f'extends = "{"n" * 300}"'),
        ("case.toml", "nnn", "cannot be read"),
    ),
    FolderSample(
        "missing column", _no_column_to_bus, ("branches.csv:1:", "column 'to_bus' is missing")
    ),
    FolderSample(
        "unknown column",
        swap("branches.csv", "reactance", "reactanc"),
        ("branches.csv:1:", "unknown column 'reactanc'", "did you mean 'reactance'?"),
    ),
    FolderSample(
        "unknown column in a header below comments",
        put("shunts.csv", "# made by hand\n\nbus,mvar\n3,15\n"),
        ("shunts.csv:3:", "unknown column 'mvar'"),
    ),
    FolderSample(
        "duplicate column",
        swap("loads.csv", "reactive_mvar", "active_mw"),
        ("loads.csv:1:", "'active_mw'", "twice"),
    ),
    FolderSample(
        "empty required cell",
        swap("branches.csv", "2,3,1,0.012", "2,,1,0.012"),
        ("branches.csv:5:", "to_bus is empty"),
    ),
    FolderSample(
        "text for a number",
        swap("branches.csv", "0.08,", "j0.08,"),
        ("branches.csv:4:", "reactance", "'j0.08' is not a number"),
    ),
    FolderSample(
        "fraction for a bus number",
        swap("loads.csv", "3,1,140", "3.5,1,140"),
        ("loads.csv:2:", "bus", "'3.5' is not a whole number"),
    ),
    FolderSample(
        "too few cells",
        swap("generators.csv", "2,1,60,5,1.02,100,voltage,1", "2,1,60,5,1.02,100,voltage"),
        ("generators.csv:3:", "7 cells", "8 columns"),
    ),
    FolderSample(
        "too many cells",
        swap("buses.csv", "3,Town,", "3,Town, Upper,"),
        ("buses.csv:4:", "7 cells", "6 columns"),
    ),
    FolderSample(
        "table not UTF-8",
        put("buses.csv", b"number,name\n1,Montr\xe9al\n"),
        ("buses.csv", "not UTF-8", "0xe9"),
    ),
    FolderSample("table without header", put("loads.csv", ""), ("loads.csv:1:", "no header line")),
    FolderSample(
        "unknown control",
        swap("generators.csv", "voltage,1", "pv,1"),
        ("generators.csv:3:", "control", "'pv'", "slack, voltage, power"),
    ),
    FolderSample(
        "neither true nor false",
        swap("branches.csv", "1,3,1,0.008,0.08,0.02,1.02,true", "1,3,1,0.008,0.08,0.02,1.02,ja"),
        ("branches.csv:4:", "in_service", "'ja' is neither true nor false"),
    ),
    FolderSample(
        "quote without end",
        swap("buses.csv", "3,Town,230", '3,"Town,230'),
        ("buses.csv:4:", "not a CSV line"),
    ),
    FolderSample(
        "record given twice",
        append("loads.csv", "3,1,5,5"),
        ("loads.csv:3:", "load 3:1", "line 2 already"),
    ),
    FolderSample(
        "device table without bus",
        swap("devices/non_reheat_turbine.csv", "bus,id", "unit,id"),
        ("non_reheat_turbine.csv:1:", "column 'bus' is missing"),
    ),
    FolderSample(
        "device without id",
        swap("devices/non_reheat_turbine.csv", "1,1,4", "1,,4"),
        ("non_reheat_turbine.csv:2:", "id is empty"),
    ),
    FolderSample(
        "text for a device parameter",
        swap("devices/two_axis.csv", "2,1,3.0", "2,1,heavy"),
        ("two_axis.csv:3:", "inertia", "'heavy' is not a number"),
    ),
    FolderSample(
        "two faults in two files",
        both(
            swap("buses.csv", "3,Town,230", "3,Town,high"),
            swap("loads.csv", "3,1,140", "3,1,much"),
        ),
        ("2 faults", "buses.csv:4:", "'high'", "loads.csv:2:", "'much'"),
    ),
    FolderSample(
        "base not positive",
        swap("case.toml", "100.0", "0"),
        ("case small", "base_mva", "positive", "0"),
        gf.CaseError,
    ),
    FolderSample(
        "base beyond all floating-point numbers",
        swap("case.toml", "100.0", "1" + "0" * 400),
        ("case small", "base_mva", "positive"),
        gf.CaseError,
    ),
    FolderSample(
        "branch to an unknown bus",
        swap("branches.csv", "2,3,1,0.012", "2,4,1,0.012"),
        ("branch 2-4:1", "branches.csv:5", "no bus 4"),
        gf.CaseError,
    ),
    FolderSample(
        "load at an unknown bus",
        swap("loads.csv", "3,1,140", "30,1,140"),
        ("load 30:1", "loads.csv:2", "no bus 30"),
        gf.CaseError,
    ),
    FolderSample(
        "shunt at an unknown bus",
        swap("shunts.csv", "3,1,0", "33,1,0"),
        ("shunt 33:1", "shunts.csv:2", "no bus 33"),
        gf.CaseError,
    ),
    FolderSample(
        "generator at an unknown bus",
        append("generators.csv", "9,1,0,0,1,100,power,1"),
        ("generator 9:1", "generators.csv:4", "no bus 9"),
        gf.CaseError,
    ),
    FolderSample(
        "device of no generator",
        append("devices/ieee_type1.csv", "3,1,20,0.2,1,0.314,0.063,0.35"),
        ("ieee_type1 3:1", "devices/ieee_type1.csv:4", "no generator 3:1"),
        gf.CaseError,
    ),
    FolderSample(
        "branch data not finite",
        swap("branches.csv", "0.08,", "nan,"),
        ("branch 1-3:1", "branches.csv:4", "reactance is nan"),
        gf.CaseError,
    ),
    FolderSample(
        "device parameter not finite",
        swap("devices/two_axis.csv", "1,1,4.0", "1,1,inf"),
        ("two_axis 1:1", "devices/two_axis.csv:2", "inertia is inf"),
        gf.CaseError,
    ),
    FolderSample(
        "zero impedance",
        swap("branches.csv", "0.008,0.08", "0,0"),
        ("branch 1-3:1", "branches.csv:4", "impedance is zero"),
        gf.CaseError,
    ),
    FolderSample(
        "branch from a bus to itself",
        swap("branches.csv", "1,3,1,", "3,3,1,"),
        ("branch 3-3:1", "branches.csv:4", "itself"),
        gf.CaseError,
    ),
    FolderSample(
        "ratio not positive",
        swap("branches.csv", "1.02,true", "-1.02,true"),
        ("branch 1-3:1", "branches.csv:4", "ratio must be positive", "-1.02"),
        gf.CaseError,
    ),
    FolderSample(
        "parallel circuits from both ends with one id",
        swap("branches.csv", "1,2,2,", "2,1,1,"),
        ("branch 2-1:1", "branches.csv:3", "branch 1-2:1", "one id"),
        gf.CaseError,
    ),
    FolderSample(
        "two set points at one bus",
        append("generators.csv", "2,2,0,0,1.03,100,voltage,1"),
        ("generator 2:2", "generators.csv:4", "1.03", "generator 2:1", "1.02"),
        gf.CaseError,
    ),
    FolderSample(
        "no slack generator",
        swap("generators.csv", "slack", "voltage"),
        ("island of bus 1", "no slack"),
        gf.CaseError,
    ),
    FolderSample(
        "island without generator",
        append("buses.csv", "7,Remote,230,1,1,0"),
        ("island of bus 7", "no generator"),
        gf.CaseError,
    ),
)


#: Cases that load, but whose devices make no model.
DEVICE_FOLDERS: tuple[FolderSample, ...] = (
    FolderSample(
        "unknown model",
        put("devices/gentra.csv", "bus,id,inertia\n1,1,4\n2,1,3\n"),
        ("gentra", "2 units of an unknown model", "gentra.csv:2", "two_axis"),
        gf.CaseError,
    ),
    FolderSample(
        "unknown parameter",
        put("devices/non_reheat_turbine.csv", "bus,id,charging_time,reheat_time\n1,1,4,7\n"),
        ("non_reheat_turbine 1:1", "unknown parameter 'reheat_time'", "charging_time"),
        gf.CaseError,
    ),
    FolderSample(
        "missing parameter",
        put("devices/non_reheat_turbine.csv", "bus,id\n1,1\n"),
        ("non_reheat_turbine 1:1", "non_reheat_turbine.csv:2", "charging_time is missing"),
        gf.CaseError,
    ),
    FolderSample(
        "empty parameter",
        swap("devices/two_axis.csv", "2,1,3.0", "2,1,"),
        ("two_axis 2:1", "two_axis.csv:3", "inertia is missing"),
        gf.CaseError,
    ),
    FolderSample(
        "negative inertia",
        swap("devices/two_axis.csv", "1,1,4.0", "1,1,-4.0"),
        ("two_axis 1:1", "two_axis.csv:2", "inertia must be positive", "-4.0"),
        gf.CaseError,
    ),
    FolderSample(
        "time constant of zero",
        swap("devices/ieee_type1.csv", "2,1,20,0.2", "2,1,20,0"),
        ("ieee_type1 2:1", "ieee_type1.csv:3", "regulator_time must be positive"),
        gf.CaseError,
    ),
    FolderSample(
        "transient saliency",
        swap("devices/two_axis.csv", "0.30,0.30", "0.30,0.55"),
        ("two_axis 2:1", "two_axis.csv:3", "q_transient_reactance 0.55", "0.3"),
        gf.CaseError,
    ),
    FolderSample(
        "two machines for one unit",
        put("devices/classical.csv", "bus,id,inertia,transient_reactance\n2,1,3,0.3\n"),
        ("unit 2:1", "2 devices of one role", "two_axis", "classical"),
        gf.CaseError,
    ),
    FolderSample(
        "exciter without machine",
        both(
            put("devices/negative_load.csv", "bus,id\n2,1\n"),
            swap("devices/two_axis.csv", "2,1,3.0,2.0,0,1.7,1.6,0.30,0.30,5.0,0.6\n", ""),
        ),
        ("unit 2:1", "ieee_type1", "no machine"),
        gf.CaseError,
    ),
    FolderSample(
        "generator without machine",
        append("generators.csv", "3,1,0,0,1,100,power,1"),
        ("generator 3:1", "generators.csv:4", "no machine", "negative_load"),
        gf.CaseError,
    ),
    FolderSample(
        "governor of a source without speed",
        both(
            put("devices/infinite_bus.csv", "bus,id,reactance\n1,1,0.1\n2,1,0.1\n"),
            drop("devices/two_axis.csv"),
            drop("devices/ieee_type1.csv"),
        ),
        ("first_order_governor 1:1", "no device", "speed"),
        gf.CaseError,
    ),
    FolderSample(
        "governor without turbine",
        drop("devices/non_reheat_turbine.csv"),
        ("first_order_governor 1:1", "governor_power"),
        gf.InitializationError,
    ),
    FolderSample(
        "exciter of a machine without field",
        both(
            drop("devices/two_axis.csv"),
            put("devices/classical.csv", "bus,id,inertia,transient_reactance\n1,1,3,1\n2,1,3,1\n"),
        ),
        ("ieee_type1 1:1", "field_voltage"),
        gf.InitializationError,
    ),
    FolderSample(
        "negative load with a parameter",
        both(
            append("generators.csv", "3,1,5,0,1.0,100,power,1"),
            put("devices/negative_load.csv", "bus,id,inertia\n3,1,4\n"),
        ),
        ("negative_load 3:1", "devices/negative_load.csv:2", "no parameters", "inertia"),
        gf.CaseError,
    ),
)


def _one(name: str, text: str, *words: str, t_end: float = 16.0) -> EventSample:
    return EventSample(name, (text,), words, t_end)


#: Events that are wrong in themselves, for the case npcc, or for what has happened before.
EVENTS: tuple[EventSample, ...] = (
    _one("empty", "", "empty", "bus-fault"),
    _one("unknown kind", "bus-falt bus=3", "unknown kind 'bus-falt'", "did you mean 'bus-fault'?"),
    _one("no equals sign", "bus-fault bus 3", "'bus'", "name=value"),
    _one("name without value", "bus-fault bus=", "'bus='", "name=value"),
    _one("unknown field", "bus-fault buss=3", "no 'buss'", "did you mean 'bus'?"),
    _one("field twice", "bus-fault bus=3 bus=4", "bus is given twice"),
    _one("missing field", "bus-fault start=0.1", "bus-fault needs bus"),
    _one("text for a bus", "bus-fault bus=three", "bus", "'three' is not a whole number"),
    _one("text for a time", "bus-fault bus=3 start=soon", "start", "'soon' is not a number"),
    _one("neither true nor false", "bus-fault bus=3 trip_bus=2", "trip_bus", "'2'"),
    _one("unknown bus", "bus-fault bus=141", "fault at bus 141", "no bus 141", "npcc"),
    _one("negative start", "bus-fault bus=3 start=-1", "bus 3", "start", "-1.0"),
    _one("start not a number", "bus-fault bus=3 start=nan", "bus 3", "start", "nan"),
    _one("start infinite", "bus-fault bus=3 start=inf", "bus 3", "start", "inf"),
    _one("no duration", "bus-fault bus=3 duration=0", "bus 3", "duration", "0.0"),
    _one("negative duration", "bus-fault bus=3 duration=-0.1", "bus 3", "duration", "-0.1"),
    _one("duration not a number", "bus-fault bus=3 duration=nan", "bus 3", "duration", "nan"),
    _one("negative resistance", "bus-fault bus=3 resistance=-0.1", "bus 3", "resistance", "-0.1"),
    _one("reactance not finite", "bus-fault bus=3 reactance=inf", "bus 3", "reactance", "inf"),
    _one("malformed branch", "branch-trip branch=3", "trip of branch 3", "FROM-TO", "'3'"),
    _one("branch of words", "branch-fault branch=a-b", "branch a-b", "FROM-TO", "'a-b'"),
    _one("unknown branch", "branch-trip branch=1-140", "1-140", "no branch between buses 1 and"),
    _one("unknown circuit", "branch-trip branch=2-33:7", "2-33:7", "no circuit 7", "only 1"),
    _one("ambiguous circuit", "branch-trip branch=43-50", "which circuit", "one of 1, 2"),
    _one("fraction above 1", "branch-fault branch=2-33 fraction=1.1", "2-33", "fraction", "1.1"),
    _one("negative fraction", "branch-fault branch=2-33 fraction=-0.1", "2-33", "fraction", "-0.1"),
    _one("fraction not a number", "branch-fault branch=2-33 fraction=nan", "fraction", "nan"),
    _one(
        "branch fault without duration", "branch-fault branch=2-33 duration=0", "2-33", "duration"
    ),
    _one("branch fault resistance", "branch-fault branch=2-33 resistance=-1", "2-33", "resistance"),
    _one("negative time of a trip", "branch-trip branch=2-33 time=-2", "2-33", "time", "-2.0"),
    _one("reclosing of a closed branch", "branch-reclose branch=2-33 time=1", "2-33", "not open"),
    _one("negative time of reclosing", "branch-reclose branch=2-33 time=-1", "2-33", "-1.0"),
    _one("no machine at the bus", "machine-trip bus=3", "machine 3:1", "no such machine", "none"),
    _one("unknown machine id", "machine-trip bus=23 id=9", "23:9", "no such machine", "23:1, 23:2"),
    _one("machine at an unknown bus", "machine-trip bus=500", "500:1", "no bus 500"),
    _one("load at an unknown bus", "load-step bus=0", "load step at bus 0", "no bus 0"),
    _one("load not finite", "load-step bus=3 active_mw=nan", "bus 3", "active_mw", "nan"),
    _one("load at a negative time", "load-step bus=3 time=-0.5", "bus 3", "time", "-0.5"),
    _one("event at the end", "branch-trip branch=2-33 time=5", "2-33", "5 s", "ends", t_end=5.0),
    _one(
        "clearing after the end",
        "bus-fault bus=3 start=0.95 duration=0.1",
        "fault at bus 3 cleared",
        "1.05 s",
        "ends at 1 s",
        t_end=1.0,
    ),
    _one(
        "clearing at the end but for rounding",  # 0.7 + 0.1 < 0.8
        "bus-fault bus=3 start=0.7 duration=0.1",
        "fault at bus 3 cleared",
        "ends at 0.8 s",
        t_end=0.8,
    ),
    EventSample(
        "fault on an open branch",
        ("branch-trip branch=2-33 time=1", "branch-fault branch=2-33 start=2"),
        ("fault on branch 2-33", "open at 2 s"),
    ),
    EventSample(
        "two faults at one bus",
        ("bus-fault bus=3 start=1 duration=0.2", "bus-fault bus=3 start=1.1 resistance=0.1"),
        ("fault at bus 3", "faulted already at 1.1 s"),
    ),
    EventSample(
        "fault at the end of a branch whose bus is faulted",
        ("bus-fault bus=2 start=1 duration=0.2", "branch-fault branch=2-33 start=1.1"),
        ("fault on branch 2-33", "bus 2 is faulted already at 1.1 s"),
    ),
    EventSample(
        "two faults in one branch",
        (
            "branch-fault branch=2-33 start=1 duration=0.2 fraction=0.5",
            "branch-fault branch=2-33 start=1.1 fraction=0.3",
        ),
        ("fault on branch 2-33", "faulted already at 1.1 s"),
    ),
)


#: Files of events that cannot be read.
EVENT_FILES: tuple[EventFileSample, ...] = (
    EventFileSample("empty file", "", ("[[event]]",)),
    EventFileSample("not TOML", "[[event]]\nkind =\n", ("not TOML", "line 2")),
    EventFileSample("number too long", f"a = {'1' * 5000}", ("not TOML", "digits")),
    EventFileSample("other table", '[[events]]\nkind = "bus-fault"', ("[[event]]",)),
    EventFileSample("one table", '[event]\nkind = "bus-fault"\nbus = 3', ("[[event]]",)),
    EventFileSample("no tables", "event = [1, 2]", ("[[event]]",)),
    EventFileSample("no kind", "[[event]]\nbus = 3", ("event 1", "kind is missing")),
    EventFileSample("kind not a text", '[[event]]\nkind = ["a"]', ("event 1", "unknown kind")),
    EventFileSample(
        "unknown kind in the second event",
        '[[event]]\nkind = "bus-fault"\nbus = 3\n[[event]]\nkind = "line-trip"\n',
        ("event 2", "unknown kind 'line-trip'"),
    ),
    EventFileSample(
        "unknown field",
        '[[event]]\nkind = "load-step"\nbus = 3\nactive = 5',
        ("event 1", "no 'active'", "did you mean 'active_mw'?"),
    ),
    EventFileSample(
        "missing field", '[[event]]\nkind = "branch-trip"', ("event 1", "branch-trip needs branch")
    ),
    EventFileSample(
        "list for a bus",
        '[[event]]\nkind = "bus-fault"\nbus = [3]',
        ("event 1", "bus", "'[3]' is not a whole number"),
    ),
    EventFileSample(
        "fraction for a bus",
        '[[event]]\nkind = "bus-fault"\nbus = 3.5',
        ("event 1", "bus", "'3.5' is not a whole number"),
    ),
    EventFileSample(
        "true for a time",
        '[[event]]\nkind = "bus-fault"\nbus = 3\nstart = true',
        ("event 1", "start", "True has the wrong type"),
    ),
    EventFileSample(
        "number for true or false",
        '[[event]]\nkind = "bus-fault"\nbus = 3\ntrip_bus = 1',
        ("event 1", "trip_bus", "1 has the wrong type"),
    ),
    EventFileSample(
        "date for a time",
        '[[event]]\nkind = "bus-fault"\nbus = 3\nstart = 2024-01-01',
        ("event 1", "start", "'2024-01-01' is not a number"),
    ),
)
