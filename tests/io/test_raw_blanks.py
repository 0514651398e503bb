"""A blank field of a RAW record is the default of PSS/E's manual, wherever it stands.

Defaults are written here once more, record by record, and each field is left blank in turn, the first
one of a line too, and the line is cut before it.
"""

import re

import numpy as np
import pytest
from raw_texts import BUSES, TRANSFORMERS, UNITS, raw_text, with_field

import gridfold as gf
from gridfold.grid.admittance import bus_admittance
from gridfold.io.powerio_cases import read_network

SBASE = "250.0"
HEADER_33 = f"0,{SBASE},33,0,1,50.0"
NO_DEFAULT = None

BUS = "5 'X' 115.0 1 2 3 1 1.02 4.0"
BUS_DEFAULTS = {1: "''", 2: "0.0", 3: "1", 4: "1", 5: "1", 6: "1", 7: "1.0", 8: "0.0"}
LOAD = "4 'A' 0 1 1 180.0 50.0 3.0 2.0 4.0 -1.0 1"
LOAD_DEFAULTS = {0: None, 1: "'1'", 2: "1", **dict.fromkeys(range(5, 11), "0.0")}
FIXED = "4 'A' 0 2.0 15.0"
FIXED_DEFAULTS = {0: None, 1: "'1'", 2: "1", 3: "0.0", 4: "0.0"}
UNIT = "2 'A' 130.0 10.0 150 -150 1.01 5 200.0 0.01 0.25 0 0 1.01 0 90 200 10"
UNIT_DEFAULTS = {
    0: None, 1: "'1'", 2: "0.0", 3: "0.0", 4: "9999.0", 5: "-9999.0", 6: "1.0", 7: "0", 8: SBASE,
    9: "0.0", 10: "1.0", 11: "0.0", 12: "0.0", 13: "1.0", 14: "1", 15: "100.0", 16: "9999.0",
}  # fmt: skip
UNIT_35 = "2 'A' 130.0 10.0 150 -150 1.01 5 0 200.0 0.01 0.25 0 0 1.01 0 90 200 10"
UNIT_35_DEFAULTS = {
    8: "0", 9: SBASE, 10: "0.0", 11: "1.0", 12: "0.0", 13: "0.0", 14: "1.0", 15: "1",
}  # fmt: skip
LINE = "3 4 'A' 0.01 0.08 0.04 300 200 100 0.01 0.02 0.03 0.04 0 2"
LINE_DEFAULTS = {
    0: None, 1: None, 2: "'1'", 3: None, 4: None, 5: "0.0", 6: "0.0", 7: "0.0", 8: "0.0",
    9: "0.0", 10: "0.0", 11: "0.0", 12: "0.0", 13: "1", 14: "1",
}  # fmt: skip
WINDINGS = "1 4 0 'A' 2 2 1 0.01 -0.02 2 'NAME' 0"
WINDINGS_DEFAULTS = {
    0: None, 1: None, 2: "0", 3: "'1'", 4: "1", 5: "1", 6: "1", 7: "0.0", 8: "0.0", 9: "2",
    10: "''", 11: "1",
}  # fmt: skip
PAIR_DEFAULTS = {0: "0.0", 1: None, 2: SBASE}
FIRST_DEFAULTS = {1: "0.0", 2: "0.0", 3: "0.0", 4: "0.0", 5: "0.0", 6: "0", 7: "0"}
THREE = "1 3 5 'A' 2 2 1 0.01 -0.02 2 'NAME' 2"
PAIRS = "0.01 0.05 200.0 0.02 0.06 150.0 0.03 0.07 120.0 1.02 -5.0"
PAIRS_DEFAULTS = {
    0: "0.0", 1: None, 2: SBASE, 3: "0.0", 4: None, 5: SBASE, 6: "0.0", 7: None, 8: SBASE,
    9: "1.0", 10: "0.0",
}  # fmt: skip
SHUNT = "4 1 0 0 1.05 0.95 3 90.0 'R' 25.0"
SHUNT_DEFAULTS = {
    0: None, 1: "1", 2: "0", 3: "1", 4: "1.0", 5: "1.0", 6: "0", 7: "100.0", 8: "''", 9: "0.0",
}  # fmt: skip
AREA = "1 1 10.0 5.0 'LAND'"
AREA_DEFAULTS = {0: None, 1: "0", 2: "0.0", 3: "10.0", 4: "''"}


def winding(bus_kv):
    """Ratios are in kV, as CW is 2 in the records here."""
    return f"{0.97 * bus_kv} {bus_kv} 30.0 300 200 100 1 4"


def first_line(kv):
    return {0: str(kv), **FIRST_DEFAULTS}


TWO = (WINDINGS, "0.01 0.05 200.0", winding(18.0), "225.0 230.0")
THREE_LINES = (THREE, PAIRS, winding(18.0), winding(230.0), winding(115.0))
RECORDS = {  # section, lines of the record, the line that is tried, its defaults
    "bus": ("BUS", (BUS,), 0, BUS_DEFAULTS),
    "load": ("LOAD", (LOAD,), 0, LOAD_DEFAULTS),
    "fixed shunt": ("FIXED SHUNT", (FIXED,), 0, FIXED_DEFAULTS),
    "generator": ("GENERATOR", (UNIT,), 0, UNIT_DEFAULTS),
    "branch": ("BRANCH", (LINE,), 0, LINE_DEFAULTS),
    "transformer": ("TRANSFORMER", TWO, 0, WINDINGS_DEFAULTS),
    "impedance": ("TRANSFORMER", TWO, 1, PAIR_DEFAULTS),
    "winding 1": ("TRANSFORMER", TWO, 2, first_line(18.0)),
    "winding 2": ("TRANSFORMER", TWO, 3, {0: "230.0", 1: "0.0"}),
    "three windings": ("TRANSFORMER", THREE_LINES, 0, WINDINGS_DEFAULTS | {2: "0", 11: "1"}),
    "impedances": ("TRANSFORMER", THREE_LINES, 1, PAIRS_DEFAULTS),
    "winding 1 of 3": ("TRANSFORMER", THREE_LINES, 2, first_line(18.0)),
    "winding 2 of 3": ("TRANSFORMER", THREE_LINES, 3, first_line(230.0)),
    "winding 3 of 3": ("TRANSFORMER", THREE_LINES, 4, first_line(115.0)),
    "switched shunt": ("SWITCHED SHUNT", (SHUNT,), 0, SHUNT_DEFAULTS),
    "area": ("AREA", (AREA,), 0, AREA_DEFAULTS),
}
FIELDS = [
    (name, position)
    for name, (_, _, _, defaults) in RECORDS.items()
    for position in defaults
    if (name, position) != ("three windings", 2)  # with two buses it is another record
]


def read(tmp_path, changes, header=HEADER_33):
    path = tmp_path / "blank.raw"
    path.write_text(raw_text(changes, header))
    return read_network(path, allow_unsupported=True)


def put(name, position, value, separator=","):
    """The records of the section, with the one at hand among them and `value` in its field."""
    section, lines, at, _ = RECORDS[name]
    plain = {"BUS": BUSES[:4], "GENERATOR": UNITS[:1], "TRANSFORMER": TRANSFORMERS}
    fields = lines[at].split(" ")
    tried = with_field(",".join(fields), position, value)
    if separator == "cut":
        tried = ",".join(fields[:position]) + " /"
    written = [tried if k == at else ",".join(line.split(" ")) for k, line in enumerate(lines)]
    return {section: (*plain.get(section, ()), *written)}


@pytest.mark.parametrize(("name", "position"), FIELDS)
def test_a_blank_field_is_the_default_of_the_manual(name, position, tmp_path):
    default = RECORDS[name][3][position]
    if default is NO_DEFAULT:
        with pytest.raises(gf.CaseFileError, match=r"line \d+: .* is blank, and it has no default"):
            read(tmp_path, put(name, position, ""))
        return
    expected = read(tmp_path, put(name, position, default))
    assert read(tmp_path, put(name, position, "")) == expected


def without_needed(name, position):
    defaults = RECORDS[name][3]
    return all(defaults.get(k, "") is not NO_DEFAULT for k in range(position, 30))


@pytest.mark.parametrize(("name", "position"), [f for f in FIELDS if without_needed(*f)])
def test_a_record_that_ends_early_has_the_defaults_of_the_rest(name, position, tmp_path):
    section, lines, at, defaults = RECORDS[name]
    values = [defaults.get(k, "") for k in range(position, max(defaults) + 1)]
    full = ",".join([*lines[at].split(" ")[:position], *values])
    explicit = put(name, position, "")
    explicit[section] = [
        full if line == with_field(",".join(lines[at].split(" ")), position, "") else line
        for line in explicit[section]
    ]
    assert read(tmp_path, put(name, position, "", "cut")) == read(tmp_path, explicit)


@pytest.mark.parametrize("position", UNIT_35_DEFAULTS)
def test_units_of_revision_35_have_a_node_before_their_base(position, tmp_path):
    def case(value):
        record = with_field(",".join(UNIT_35.split(" ")), position, value)
        lines = ["3,4,'1',0.01,0.08,0.04,'L1'", "4,5,'1',0.01,0.08,0.04,'L2'"]
        first = "1,'1',140.0,20.0,200,-200,1.02,0,0,250.0"
        changes = {"GENERATOR": (first, record), "BRANCH": lines, "SYSTEM SWITCHING DEVICE": ()}
        changes["LOAD"] = ("4,'1',1,1,1,180.0,50.0,0,0,0,0,1,1,0,0,0,0,''",)
        return read(tmp_path, changes, HEADER_33.replace("33", "35"))

    assert case("") == case(UNIT_35_DEFAULTS[position])


def two_port(case, branch):
    y = bus_admittance(gf.Case("one", case.buses, (branch,), ())).toarray()
    ends = [case.bus_index[branch.from_bus], case.bus_index[branch.to_bus]]
    return y[np.ix_(ends, ends)]


def transformer(y, first, second):
    """Two-port of an admittance between ideal transformers of these complex ratios, by definition."""
    return np.array(
        [
            [y / abs(first) ** 2, -y / np.conj(first) / second],
            [-y / first / np.conj(second), y / abs(second) ** 2],
        ]
    )


TURN = np.exp(1j * np.pi / 6)


@pytest.mark.parametrize(
    ("lines", "z", "first", "second"),
    [
        (("1,3,0,'1',1,1,1", ",0.05,100", "1.03", "1.0"), 0.05j, 1.03, 1.0),
        (("1,3,0,'1',1,1,1", "0.01,0.05", ",,30.0", "1.0"), 0.01 + 0.05j, TURN, 1.0),
        (("1,3,,,,,,", ",0.05,,", ",,-30.0", ","), 0.05j, 1 / TURN, 1.0),
        (("1 3", ", 0.05 100", ",18.0,60 / comment", "/"), 0.05j, TURN**2, 1.0),
        (("1,3,0,'1',1,2,1", ",0.05,100", "/", ",230.0"), 0.125j, 1.0, 1.0),
        (("1,3,0,'1',1,2,1", ",5D-2", "1.03", ","), 0.05j, 1.03, 1.0),
        (("1,3,0,'1',2,1,1", ",0.05", "17.1", ","), 0.05j, 0.95, 1.0),
        (("1,3,0,'1',2,1,1", ",0.05", ",,30", "253.0"), 0.05j, TURN, 1.1),
    ],
)
def test_a_transformer_with_blank_first_fields_by_its_physical_two_port(
    lines, z, first, second, tmp_path
):
    """On 250 MVA an impedance of 0.05 on 100 MVA (CZ 2) is 0.125, one on the system's base 0.05."""
    case = read(tmp_path, {"TRANSFORMER": (*lines, *TRANSFORMERS[4:])})
    branch = next(b for b in case.branches if (b.from_bus, b.to_bus) == (1, 3))
    np.testing.assert_allclose(
        two_port(case, branch), transformer(1 / z, first, second), rtol=1e-12, atol=1e-12
    )


def test_three_windings_with_blank_first_fields_by_the_impedance_between_each_pair(tmp_path):
    lines = ("1,3,5,'T'", ",0.05,,,0.06,,,0.07", ",,30.0", "1.02", ",,-30.0")
    case = read(tmp_path, {"TRANSFORMER": (*TRANSFORMERS, *lines)})
    legs = case.branches[-3:]
    x = [leg.reactance for leg in legs]
    assert [x[0] + x[1], x[1] + x[2], x[2] + x[0]] == pytest.approx([0.05, 0.06, 0.07])
    assert [leg.resistance for leg in legs] == [0, 0, 0]
    assert [(leg.ratio, leg.shift_deg) for leg in legs] == [(1, 30), (1.02, 0), (1, -30)]


def test_faults_of_all_records_are_listed_at_once(tmp_path):
    changes = {
        "BRANCH": ("3,4,'1',,0.08", "4,5,'1',0.01,"),
        "TRANSFORMER": (TRANSFORMERS[0], "0.01", *TRANSFORMERS[2:]),
    }
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, changes)
    assert [re.sub(r"line \d+: ", "", fault) for fault in raised.value.faults] == [
        "R of a branch is blank, and it has no default",
        "X of a branch is blank, and it has no default",
        "X1-2 of a transformer is blank, and it has no default",
    ]


@pytest.mark.parametrize("kept", [1, 2, 3])
def test_a_transformer_that_lacks_lines_is_refused_with_its_line(kept, tmp_path):
    changes = {"TRANSFORMER": (*TRANSFORMERS[:4], *TRANSFORMERS[4 : 4 + kept])}
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, changes)
    assert raised.value.faults == [f"line 26: a transformer needs 4 lines, and {kept} are there"]


@pytest.mark.parametrize(
    ("header", "base_mva", "frequency", "told"),
    [
        ("0,,33,0,1,50.0", 100.0, 50.0, ["SBASE of the header is blank: 100 MVA"]),
        ("0,250.0,33", 250.0, 60.0, ["BASFRQ of the header is blank: 60 Hz"]),
        ("0 2.5D2 33 0 1 50.0", 250.0, 50.0, []),
        (",250.0,33,,,50.0 / comment", 250.0, 50.0, []),
    ],
)
def test_blank_bases_of_the_header_are_told(header, base_mva, frequency, told, tmp_path):
    case = read(tmp_path, {}, header)
    assert (case.base_mva, case.frequency_hz, list(case.notices)) == (base_mva, frequency, told)
