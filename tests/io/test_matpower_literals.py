"""What MATLAB would make of a MATPOWER file and what is read of it: the same, or nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.io.matpower_file import read_matpower
from gridfold.io.powerio_cases import read_network

HEADER = "function mpc = five\n%FIVE  a grid of our own\nmpc.version = '2';\n"
BASE = "mpc.baseMVA = 100;\n"
BUS = """mpc.bus = [
 1 3 0 0 0 0 1 1.02 0 18 1 1.1 0.9;
 2 2 0 0 0 0 1 1.01 0 18 1 1.1 0.9;
 3 1 0 0 0 0 1 1 0 230 1 1.1 0.9;
 4 1 180 50 0 0 1 1 0 230 1 1.1 0.9;
 5 1 90 25 0 0 2 1 0 230 1 1.1 0.9;
];
"""
GEN = """mpc.gen = [
 1 140 20 200 -200 1.02 250 1 250 0;
 2 130 10 150 -150 1.01 200 1 200 0;
];
"""
BRANCH = """mpc.branch = [
 3 4 0.01 0.08 0.04 0 0 0 0 0 1 -360 360;
 3 4 0.011 0.085 0.04 0 0 0 0 0 1 -360 360;
 4 5 0.008 0.06 0.03 0 0 0 0 0 1 -360 360;
 3 5 0.012 0.1 0.05 0 0 0 0 0 1 -360 360;
 1 3 0 0.05 0 0 0 0 1.03 0 1 -360 360;
 2 5 0 0.06 0 0 0 0 0.98 0 1 -360 360;
];
"""
FIVE = HEADER + BASE + BUS + GEN + BRANCH
COLUMNS = """[PQ, PV, REF, NONE, BUS_I, BUS_TYPE, PD, QD, GS, BS, BUS_AREA, VM, ...
    VA, BASE_KV, ZONE, VMAX, VMIN, LAM_P, LAM_Q, MU_VMAX, MU_VMIN] = idx_bus;
[F_BUS, T_BUS, BR_R, BR_X, BR_B] = idx_brch;
"""
HALF_GEN = GEN.replace("130", "65")
ONE_GEN = "mpc.gen = [\n 1 1 1 1 1 1 1 1 1 1;\n];\n"


def read(tmp_path, text, name="five.m", **options):
    path = tmp_path / name
    path.write_bytes(text.encode())
    return read_network(path, **options)


def refusal(tmp_path, text):
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, text)
    return raised.value


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The five buses as tables of plain numbers."""
    case = read(tmp_path_factory.mktemp("plain"), FIVE)
    assert [unit.active_mw for unit in case.generators] == [140.0, 130.0]
    assert [load.power(1.0) for load in case.loads] == [180 + 50j, 90 + 25j]
    assert [branch.reactance for branch in case.branches] == [0.08, 0.085, 0.06, 0.1, 0.05, 0.06]
    return case


SAME = {
    "block comment": FIVE.replace(GEN, f"%{{\n{ONE_GEN}%}}\n{GEN}"),
    "block comment of Octave": FIVE.replace(GEN, f"  #{{  \n{ONE_GEN}\t#}}\n{GEN}"),
    "block comment behind": f"{FIVE}%{{\n{HALF_GEN}%}}\n",
    "blocks in blocks": FIVE.replace(GEN, f"%{{\n%{{\n%}}\n{ONE_GEN}%}}\n{GEN}"),
    "block comment within a table": FIVE.replace(" 2 130", "%{\n 9 9 9;\n%}\n 2 130"),
    "a brace in a comment opens no block": FIVE.replace(GEN, f"%{{ no block\n{GEN}%}} nor its end\n"),
    "block comment never closed": f"{FIVE}%{{\n{HALF_GEN}",
    "commented row": FIVE.replace(" 2 130", "% 2 1 1 1 1 1 1 1 1 1;\n 2 130"),
    "commented assignment": f"{FIVE}%mpc.gen(2, 2) = 0;\n# mpc.baseMVA = 1;\n",
    "comments behind values": FIVE.replace("250 0;", "250 0; % the ] largest; 1 2").replace(
        "mpc.gen = [", "mpc.gen = [ % ]; mpc.gen = []"
    ),
    "percent sign in a string": FIVE.replace("'2';", "'2 % mpc.bus = ['; mpc.note = \"a ] % b\";"),
    "quote in a string": f"{FIVE}mpc.bus_name = {{'A'; 'it''s % B'; 'C];'; 'D'; 'E'}};\n",
    "quotient": FIVE.replace(" 2 130", " 2 260/2").replace("= 100;", "= 200 / 2;"),
    "product and sign": FIVE.replace("-200 1.02", "-2*100 1.02").replace("-150 1.01", "-(300/2) 1.01"),
    "sum and difference": FIVE.replace(" 1 140", " 1 150-10").replace(" 2 130", " 2 100 + 30"),
    "power": FIVE.replace("0.011", "11*10^-3").replace("mpc.baseMVA = 100", "mpc.baseMVA = 10^2"),
    "root": FIVE.replace("= 100;", "= sqrt(1e4);"),
    "exponents": FIVE.replace("140", "1.4e2").replace("130", "1.3D+2").replace("0.05 0 0", "5E-2 0 0"),
    "commas": FIVE.replace(" 2 130 10 150 -150 ", " 2, 130, 10, 150, -150, "),
    "rows without semicolons": FIVE.replace("0.9;\n", "0.9\n").replace("360;\n", "360,\n"),
    "rows in one line": FIVE.replace("0;\n 2 130", "0; 2 130").replace("[\n 1 140", "[1 140"),
    "continued row": FIVE.replace(" 2 130 10", " 2 130 ... the second unit; ]\n 10"),
    "continued assignment": FIVE.replace("mpc.gen = [", "mpc.gen = ... \n  [ ..."),
    "transposed": FIVE.replace(
        GEN, "mpc.gen = [1 2; 140 130; 20 10; 200 150; -200 -150; 1.02 1.01; 250 200; 1 1\n"
        "250 200; 0 0]';\n"
    ),
    "ends of lines of a Mac": FIVE.replace("\n", "\r"),
    "ends of lines of Windows": FIVE.replace("\n", "\r\n"),
    "many statements in a line": (HEADER + BASE + BUS).replace("];\n", "]; ") + GEN + BRANCH,
    "without semicolons": FIVE.replace("= 100;", "= 100").replace("];", "]"),
    "other name of the struct": FIVE.replace("mpc", "s"),
    "results in brackets": FIVE.replace("function mpc =", "function [mpc] ="),
    "arguments": FIVE.replace("= five", "= five(varargin)"),
    "no header": FIVE.partition("\n")[2],
    "end and return": f"{FIVE}return;\nend\n",
    "nothing runs after return": f"{FIVE}return\n{HALF_GEN}mpc.baseMVA = 1;\n",
    "struct made first": FIVE.replace("mpc.version", "mpc = struct();\nmpc.version"),
    "costs and areas": f"{FIVE}mpc.gencost = [2 0 0 3 0 1 0; 2 0 0 3 0 1 0];\nmpc.areas = [1 3];\n"
    "mpc.gencost(:, 5) = 2 * mpc.gencost(:, 5);\nmpc.gentype = {'ST'; 'GT'};\n",
    "other variables": f"{FIVE}x = 3; y.bus = [1 2]; z = rand(3)(1); x(2) = 1;\n"
    "[a, b] = size(mpc.bus);\n",
    "constants of columns": f"{FIVE.replace(BUS, 'define_constants;' + BUS)}{COLUMNS}",
    "a branch beside the case": f"{FIVE}if exist('x', 'var')\n  y = 1;\nelse\n  y = 2;\nend\n",
    "messages": f"{FIVE}disp('mpc.bus = [];'); fprintf(1, '%d\\n', 3);\n",
    "named number": FIVE.replace("mpc.baseMVA = 100", "Sb = 1e2; mpc.baseMVA = Sb"),
    "kilowatts": FIVE.replace(" 4 1 180 50", " 4 1 180e3 50e3").replace(" 5 1 90 25", " 5 1 9e4 25e3")
    + COLUMNS
    + "mpc.bus(:, [PD, QD]) = mpc.bus(:, [PD, QD]) / 1e3;\n",
    "columns scaled by a power in brackets": f"{FIVE}mpc.bus(:, 3) = mpc.bus(:, 3) .* -(2 - 1 - 2)^2;\n"
    "mpc.bus(:, 3) = mpc.bus(:, 3) / -1^2;\nmpc.bus(:, 3) = mpc.bus(:, 3) * (3 - 2);\n",
    "columns by number": FIVE.replace(" 4 1 180 50", " 4 1 90 50").replace(" 5 1 90", " 5 1 45")
    + "mpc.bus(:, 3) = mpc.bus(:, 3) * 2;\n",
}  # fmt: skip


@pytest.mark.parametrize("variant", SAME)
def test_what_matlab_takes_for_the_plain_tables_gives_the_plain_case(variant, plain, tmp_path):
    case = read(tmp_path, SAME[variant])
    assert SAME[variant] != FIVE
    assert case.unsupported == ()
    unnamed = [replace(bus, name="") for bus in case.buses]
    assert replace(case, buses=tuple(unnamed)) == plain


REFUSED = {
    "second table": HALF_GEN,
    "second table in the same words": GEN,
    "second base": "mpc.baseMVA = 50;\n",
    "base halved": "mpc.baseMVA = mpc.baseMVA / 2;\n",
    "base halved as in Octave": "mpc.baseMVA /= 2;\n",
    "base counted up": "mpc.baseMVA++;\n",
    "appended row": "mpc.bus = [mpc.bus; 6 1 10 0 0 0 1 1 0 230 1 1.1 0.9];\n",
    "appended by index": "mpc.bus(end+1, :) = [6 1 10 0 0 0 1 1 0 230 1 1.1 0.9];\n",
    "single value": "mpc.bus(4, 3) = 90;\n",
    "column given": "mpc.bus(:, 3) = 0;\n",
    "column of another": "mpc.bus(:, 3) = mpc.bus(:, 4) * 2;\n",
    "column scaled by what is unknown": "k = rand; mpc.bus(:, 3) = mpc.bus(:, 3) * k;\n",
    "column scaled by a name of its own": "pi = rand(1);\nmpc.bus(:, 3) = mpc.bus(:, 3) * pi;\n",
    "column scaled and shifted": "mpc.bus(:, 3) = mpc.bus(:, 3) * 2 - 1;\n",
    "column scaled twice": "mpc.bus(:, 3) = mpc.bus(:, 3) / 2 * 2;\n",
    "rows scaled": "mpc.bus(1:3, 3) = mpc.bus(1:3, 3) * 2;\n",
    "column out of range": "mpc.bus(:, 40) = mpc.bus(:, 40) * 2;\n",
    "table emptied": "mpc.gen = [];\n",
    "row deleted": "mpc.branch(3, :) = [];\n",
    "call": "mpc = scale_load(0.5, mpc);\n",
    "call in brackets": "[mpc] = scale_load(0.5, mpc);\n",
    "call for two": "[mpc, k] = scale_load(0.5, mpc);\n",
    "call for a table": "[mpc.bus, mpc.gen] = scale_load(0.5, mpc.bus);\n",
    "struct copied": "mpc = other;\n",
    "struct emptied": "mpc = struct();\n",
    "field by a name": "mpc.('bus') = [];\n",
    "element of the struct": "mpc(1).baseMVA = 50;\n",
    "field of a table": "mpc.bus.x = 1;\n",
    "no literal": "mpc.storage = rand(1, 17);\n",
    "branch": "if true\n  mpc.baseMVA = 50;\nend\n",
    "branch that is never taken": f"if 0\n{HALF_GEN}end\n",
    "branch in a line": "if x, mpc.baseMVA = 50; end\n",
    "loop": "for k = 1:2\n  mpc.bus(k + 3, 3) = 0;\nend\n",
    "while": "while false\n mpc.baseMVA = 1;\nendwhile\n",
    "return in a branch": "if nargin < 1\n  return\nend\n",
    "try": "try\n  mpc = scale_load(0.5, mpc);\ncatch\nend\n",
    "evaluated text": "eval('mpc.baseMVA = 50;');\n",
    "evaluated for another": "x = evalin('base', 'y');\n",
    "script": "change_the_case;\n",
    "command": "clear mpc\n",
    "command with an equals sign": "clear mpc = 3\n",
    "call that may change all": "update(mpc);\n",
    "assignment within": "y = (mpc.baseMVA = 50);\n",
    "assignments in a chain": "y = mpc.baseMVA = 50;\n",
    "global": "global mpc\n",
    "function of its own": "function x = f\nx = 1;\nend\n",
    "after the end": "end\nmpc.baseMVA = 50;\n",
    "three phases": "mpc.load3p = [1 1 1 10 10 10 0.9 0.9 0.9];\n",
    "direct current": "mpc.busdc = [1 1 0 1 345 1.1 0.9 0];\n",
}


@pytest.mark.parametrize("variant", REFUSED)
def test_what_could_change_the_case_is_refused_with_its_line(variant, tmp_path):
    added = REFUSED[variant]
    error = refusal(tmp_path, FIVE + added)
    last = (FIVE + added.rstrip("\n")).count("\n") + 1
    lines = range(FIVE.count("\n") + 1, last + 1)
    assert any(f"(five.m:{line})" in fault for fault in error.faults for line in lines)
    assert all(fault.startswith("not supported: ") for fault in error.faults)
    assert "five.m" in str(error)
    assert "--allow-unsupported-network" in str(error)


def test_on_request_a_file_is_read_without_what_is_refused(tmp_path, plain):
    case = read(tmp_path, f"{FIVE}mpc.baseMVA = mpc.baseMVA / 2;\n", allow_unsupported=True)
    assert case == plain
    assert case.unsupported == (
        '"mpc.baseMVA = mpc.baseMVA / 2" is a second assignment, after that in line 4 (five.m:24)',
    )


def test_fields_that_gridfold_does_not_know_are_told(tmp_path):
    case = read(tmp_path, f"{FIVE}mpc.gizmo = [1 2 3];\nmpc.gencost = [];\n")
    assert case.notices == ("not read: mpc.gizmo (five.m:24)",)
    assert case.unsupported == ()


UNREADABLE = {
    "no table of generators": (FIVE.replace(GEN, ""), ["there is no mpc.gen"]),
    "called table": (
        FIVE.replace(GEN, "mpc.gen = zeros(2, 10);\n"),
        ["there is no mpc.gen", '"mpc.gen = zeros(2, 10)" is not literal (five.m:12)'],
    ),
    "no literal table of buses": (
        FIVE.replace(BUS, "mpc.bus = ones(5, 13);\n"),
        ["2 faults\n  there is no mpc.bus\n  not supported: "],
    ),
    "rows of two lengths": (
        FIVE.replace("200 0;\n", "200;\n"),
        ["there is no mpc.gen", "its row in line 14 has 9 numbers, the first one 10 (five.m:12)"],
    ),
    "complex": (FIVE.replace("140", "(-4)^0.5"), ["a number is complex (five.m:12)"]),
    "imaginary": (FIVE.replace("140", "140i"), ["is not literal (five.m:12)"]),
    "zero": (FIVE.replace("140", "1/0"), ["division by zero (five.m:12)"]),
    "bracket left open": (FIVE.replace("360;\n];", "360;\n"), ["line 16: a bracket of this"]),
    "fraction of a bus": (FIVE.replace(" 2 130", " 2.5 130"), ["line 14: gen: there is no bus 2.5"]),
    "bus below one": (FIVE.replace(" 3 4 0.01 ", " -3 4 0.01 "), ["line 17: branch: there is no bus"]),
    "no such bus": (FIVE.replace(" 3 5 0.012", " 3 8 0.012"), ["line 20: branch: there is no bus 8"]),
    "bus given twice": (FIVE.replace(" 4 1 180", " 3 1 180"), ["line 9: bus 3 is given a second time"]),
    "no number": (FIVE.replace(" 5 1 90", " NaN 1 90"), ["line 10: NaN is no bus number"]),
    "unknown type": (FIVE.replace(" 5 1 90", " 5 7 90"), ["line 10: bus 5 is of type 7, not 1 to 4"]),
    "half a switch": (FIVE.replace(" 1 -360", " 0.5 -360", 1), ["line 17: branch: status 0.5 is"]),
    "names of other buses": (f"{FIVE}mpc.bus_name = {{'A', 'B'}};", ["2 names of buses do not go"]),
    "too few columns": (FIVE.replace(" 1.1 0.9;", ";"), ["line 6: bus has 11 columns, needs 13"]),
    "version 1": (
        FIVE.replace("mpc = five", "[baseMVA, bus, gen, branch] = five").replace("mpc.", ""),
        ["there is no mpc.bus; in version 1 of the format?"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("variant", UNREADABLE)
def test_a_file_without_its_tables_says_what_is_missing_and_where(variant, tmp_path):
    text, expected = UNREADABLE[variant]
    message = str(refusal(tmp_path, text))
    for part in expected:
        assert part in message


def test_spaces_separate_numbers_as_in_matlab(tmp_path):
    """Worked out by MATLAB's rule: a sign after a space and before none begins a number."""
    rows = {
        "1 -2": (1, -2), "1 - 2": (-1,), "1-2": (-1,), "1- 2": (-1,), "1 -2 - 3": (1, -5),
        "(1 -2)": (-1,), "- 1 2": (-1, 2), "2 *3": (6,), "2* 3 4": (6, 4), "-2^2 2^-1": (-4, 0.5),
        "1,-2": (1, -2), "50/3    -50/3": (50 / 3, -50 / 3), "2 - -1": (3,), "1 +2": (1, 2),
        "[1 2]'": None, "1:3": None, "a": None, "1 2i": None, "1,,2": None, ",1": None, "1 _ 2": None,
        "sqrt(3) 2": (math.sqrt(3), 2), "Inf -Inf": (math.inf, -math.inf), "1_0": None,
        ".5 5. 1.e2": (0.5, 5, 100),
    }  # fmt: skip
    for text, expected in rows.items():
        found = read_matpower(f"mpc.bus = [{text}];", "one.m").tables.get("bus")
        assert (found and found.rows) == (expected and (expected,)), text
        lines = read_matpower(f"mpc.bus = [\n{text}\n];", "one.m").tables.get("bus")
        assert (lines and lines.rows) == (expected and (expected,)), text


@pytest.mark.parametrize(
    ("status", "runs"), [("2", True), ("0.5", True), ("0", False), ("-1", False)]
)
def test_a_unit_of_any_positive_status_runs(status, runs, tmp_path):
    case = read(tmp_path, FIVE.replace(" 1.01 200 1 ", f" 1.01 200 {status} "))
    assert [unit.in_service for unit in case.generators] == [True, runs]


def test_records_know_their_lines(tmp_path, plain):
    assert plain.origins["bus 4"] == "five.m:9"
    assert plain.origins["load 5:1"] == "five.m:10"
    assert plain.origins["generator 2:1"] == "five.m:14"
    assert plain.origins["branch 2-5:1"] == "five.m:22"


def test_quotients_of_public_distribution_grids_have_matlab_s_value(tmp_path):
    text = FIVE.replace("= 100;", "= 50/3;").replace(
        "200 -200 1.02 250", "50/3    -50/3   1.02   50/3"
    )
    case = read(tmp_path, text)
    assert case.base_mva == 50 / 3
    assert case.generators[0].base_mva == 50 / 3


def test_ohms_become_per_unit_as_in_the_files_of_matpower(tmp_path, plain):
    text = (
        FIVE
        + COLUMNS
        + "Vbase = mpc.bus(3, BASE_KV) * 1e3;      %% in Volts\n"
        + "Sbase = mpc.baseMVA * 1e6;              %% in VA\n"
        + "mpc.branch(:, [BR_R BR_X]) = mpc.branch(:, [BR_R BR_X]) / (Vbase^2 / Sbase);\n"
    )
    case = read(tmp_path, text)
    ohms = (230e3) ** 2 / 100e6
    for branch, in_ohms in zip(case.branches, plain.branches, strict=True):
        assert branch.reactance == pytest.approx(in_ohms.reactance / ohms, rel=1e-15)
        assert branch.resistance == pytest.approx(in_ohms.resistance / ohms, rel=1e-15)
        assert branch.susceptance == in_ohms.susceptance


def test_numbers_are_handed_on_without_loss():
    rng = np.random.default_rng(1)
    values = rng.standard_normal((500, 13)) * 10.0 ** rng.integers(-300, 300, (500, 13))
    values[0] = [
        0.0,
        -0.0,
        math.inf,
        -math.inf,
        5e-324,
        1.8e308,
        1e15,
        1e16,
        -1e22,
        0.1,
        1 / 3,
        3,
        -7,
    ]
    rows = tuple(map(tuple, values.tolist()))
    text = "".join(f" {' '.join(map(repr, row))};\n" for row in rows).replace("inf", "Inf")
    once = read_matpower(f"mpc.bus = [\n{text}];\n", "many.m")
    assert once.tables["bus"].rows == rows
    again = read_matpower(once.text, "many.m").tables["bus"].rows
    assert [list(map(repr, row)) for row in again] == [list(map(repr, row)) for row in rows]
