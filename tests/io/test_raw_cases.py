import os
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import powerio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from raw_texts import raw_text

import gridfold as gf
from gridfold.errors import GridfoldError
from gridfold.grid.admittance import bus_admittance
from gridfold.io.powerio_cases import read_network
from gridfold.io.raw_sections import THREE_WINDING, find_sections

OWN = Path(__file__).parent / "raw"
ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
NPCC = "npcc/npcc_curent.raw"
KUNDUR = "kundur/kundur.raw"
WECC = "wecc240/240busWECC_2018_PSS32_fixed_shunts.raw"
TEXAS = "activsg2000/ACTIVSg2000.RAW"
NEW_ENGLAND = "ieee39/IEEE39.raw"


def own(name, **options):
    return read_network(OWN / name, **options)


def public(name, **options):
    path = CASES / name
    if not path.is_file():
        pytest.skip(f"{path} is absent; GRIDFOLD_CASES names the folder of public cases")
    return read_network(path, **options)


def written(tmp_path, name, *changes):
    """A copy of an own file with texts replaced."""
    text = (OWN / name).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / name
    path.write_text(text)
    return path


def refused(path, **options):
    with pytest.raises(gf.CaseFileError) as raised:
        read_network(path, **options)
    assert str(path) in str(raised.value)
    return str(raised.value)


def by_id(records):
    return {f"{record.bus}:{record.id}": record for record in records}


def test_all_records_of_a_plain_file_become_records_of_the_case():
    case = own("revision_33.raw")
    assert (case.name, case.base_mva, case.frequency_hz) == ("revision_33", 100.0, 60.0)
    assert case.buses == (
        gf.Bus(1, "NORTH", 230.0, 1, 1, 1.04, 0.0),
        gf.Bus(2, "SOUTH, OLD", 230.0, 1, 2, 1.02, -2.0),
        gf.Bus(3, "TOWN", 115.0, 2, 1, 0.98, -5.0),
    )
    assert case.loads == (gf.Load(3, "1", 120.0, 40.0),)
    assert case.branches == (
        gf.Branch(1, 2, "1", 0.01, 0.08, 0.05),
        gf.Branch(2, 3, "1", 0.02, 0.15, 0.03),
        gf.Branch(1, 3, "1", 0.0, 0.12, 0.0, ratio=0.97, shift_deg=4.0),
    )
    slack, held = case.generators
    assert slack == gf.Generator(
        1, "1", 60.0, 10.0, 1.04, 150.0, gf.Control.SLACK, source_reactance=0.25
    )
    assert held == gf.Generator(
        2, "1", 70.0, 20.0, 1.02, source_resistance=0.002, source_reactance=0.3
    )
    assert case.area_names == {1: "LAND"}
    assert case.devices == case.unsupported == case.notices == case.shunts == ()


def test_owners_and_the_names_of_zones_and_owners_are_those_of_the_file(tmp_path):
    plain = own("revision_33.raw")
    assert (plain.zone_names, plain.owner_names) == ({1: "FIRST"}, {1: "ALL"})
    path = written(
        tmp_path,
        "revision_33.raw",
        ("2,   1,   1,0.98000", "2,   1,   7,0.98000"),
        ("    1,'ALL         '", "    1,'ALL         '\n    7,'TOWN''S OWN'\n    8,\n    9,'"),
    )
    case = read_network(path)
    assert [bus.owner for bus in case.buses] == [1, 1, 7]
    assert case.owner_names == {1: "ALL", 7: "TOWN'S OWN"}
    assert case.fingerprint == plain.fingerprint


@pytest.mark.parametrize("other", ["revision_32", "revision_34", "revision_35", "bare_markers"])
def test_every_revision_gives_the_same_case(other):
    plain = own("revision_33.raw")
    assert replace(own(f"{other}.raw"), name=plain.name, description=plain.description) == plain


def test_revision_31_differs_from_32_by_the_fields_of_switched_shunts_alone(tmp_path):
    older = read_network(written(tmp_path, "revision_32.raw", (" 32,", " 31,")))
    assert older == own("revision_32.raw")
    with_status, without = "3,1,0,1,1.1,0.9,0,100,'',30,1,30", "3,1,1.1,0.9,0,100,'',30,1,30"
    found = {}
    for revision, record in ((32, with_status), (31, without)):
        path = tmp_path / "five.raw"
        path.write_text(raw_text({"SWITCHED SHUNT": (record,)}, f"0,100.0,{revision},0,1,60.0"))
        found[revision] = read_network(path)
    assert found[31] == found[32]
    assert found[31].shunts == (gf.Shunt(3, "S1", 0.0, 30.0),)


def test_records_know_their_file_and_line():
    case = own("revision_33.raw")
    lines = (OWN / "revision_33.raw").read_text().splitlines()
    for record, begin in (
        (case.buses[1], "2,'SOUTH"),
        (case.loads[0], "3,'1 '"),
        (case.generators[1], "2,'1 '"),
        (case.branches[1], "2,     3"),
        (case.branches[2], "1,     3"),
    ):
        file, line = case.origins[str(record)].split(":")
        assert file == "revision_33.raw"
        assert lines[int(line) - 1].strip().startswith(begin)


def test_powerio_alone_drops_all_that_follows_a_bare_section_mark():
    """The reason why sections are found by their order too: nobody says that records are lost."""
    module = powerio.parse(OWN / "bare_markers.raw")
    assert len(module.value.buses) == 3
    assert len(module.value.loads) == len(module.value.branches) == 0
    assert not module.diagnostics
    assert len(own("bare_markers.raw").branches) == 3


def test_machine_ids_and_source_impedances_of_several_units_at_a_bus():
    units = by_id(own("machines.raw").generators)
    assert list(units) == ["1:2", "1:1", "2:DG", "2:1", "2:10"]
    found = [(u.source_resistance, u.source_reactance, u.base_mva) for u in units.values()]
    assert found == [(0, 0.2, 80), (0.004, 0.25, 150), (0, 1, 60), (0, 0.3, 40), (0, 1, 20)]
    assert [u.in_service for u in units.values()] == [True, True, True, True, False]


def test_the_largest_unit_at_the_slack_bus_balances_and_stored_reactive_power_is_the_share():
    case = own("machines.raw")
    units = by_id(case.generators)
    assert units["1:1"].control is gf.Control.SLACK
    assert units["1:2"].control is units["2:DG"].control is gf.Control.VOLTAGE
    assert [units[key].share for key in ("1:2", "1:1", "2:DG", "2:1")] == [5, 15, 5, 15]
    power = dict(zip(units, gf.solve_power_flow(case).unit_power * case.base_mva, strict=True))
    assert power["1:2"].real == pytest.approx(30.0)
    assert power["1:1"].imag == pytest.approx(3 * power["1:2"].imag)


def test_units_hold_the_stored_voltage_of_their_bus():
    case = own("remote_regulation.raw")
    assert [unit.voltage_pu for unit in case.generators] == [1.04, 1.02, 0.98]
    kinds = [unit.control for unit in case.generators]
    assert kinds == [gf.Control.SLACK, gf.Control.VOLTAGE, gf.Control.POWER]


def test_shares_of_a_load_by_voltage_dependence_with_capacitive_admittance_drawing_less():
    case = own("loads.raw")
    first = gf.Load(
        3, "1", 60.0, 20.0, True, 30.0, 8.0, impedance_active_mw=40.0, impedance_reactive_mvar=12.0
    )
    assert case.loads[0] == first  # YQ = -12 in the file: inductive
    assert case.loads[1] == gf.Load(3, "B", impedance_reactive_mvar=-9.0)  # YQ = 9: capacitive
    assert not case.loads[2].in_service


def test_loads_of_the_solved_case_are_those_of_the_solved_voltages():
    case = own("loads.raw")
    flow = gf.solve_power_flow(case)
    v = abs(flow.voltage[2])
    drawn = complex(60 + 30 * v + 40 * v**2, 20 + 8 * v + 12 * v**2 - 9 * v**2)
    assert abs(flow.load_power[2] * 100 - drawn) < 1e-8
    injected = flow.voltage * np.conj(bus_admittance(case) @ flow.voltage)
    assert abs(injected[2] + drawn / 100) < 1e-10
    assert flow.mismatch < 1e-10


def test_a_load_of_constant_admittance_is_a_shunt():
    case = own("loads.raw")
    as_load = replace(case, loads=(gf.Load(3, impedance_active_mw=50, impedance_reactive_mvar=30),))
    as_shunt = replace(case, loads=(), shunts=(gf.Shunt(3, "1", 50, -30),))
    np.testing.assert_allclose(
        gf.solve_power_flow(as_load).voltage, gf.solve_power_flow(as_shunt).voltage, atol=1e-10
    )


def test_switched_shunts_are_fixed_at_their_stored_susceptance():
    assert own("shunts.raw").shunts == (
        gf.Shunt(3, "1", 2.0, 20.0),
        gf.Shunt(3, "R", 0.0, -50.0, in_service=False),
        gf.Shunt(3, "S1", 0.0, 12.5),
        gf.Shunt(2, "S1", 0.0, 5.0, in_service=False),
    )


def test_line_shunts_and_negative_reactance_keep_the_two_port():
    case = own("line_shunts.raw")
    line = case.branches[1]
    assert (line.reactance, line.susceptance) == (-0.05, 0.1)
    series = 1 / complex(0.001, -0.05)
    y = bus_admittance(replace(case, branches=(line,))).toarray()
    assert y[1, 2] == pytest.approx(-series)
    assert y[1, 1] == pytest.approx(series + 0.05j + complex(0.001, -0.04))
    assert y[2, 2] == pytest.approx(series + 0.05j + 0.003)


def test_transformers_by_the_physical_two_port_of_their_windings():
    """Ideal transformers at both ends of the impedance, by the definition of each code."""
    case = own("transformers.raw")
    power_loss, z_magnitude = 250_000 / 50e6, 0.1
    reactance = np.sqrt(z_magnitude**2 - power_loss**2)
    expected = {
        "P": (1.05 * np.exp(-1j * np.pi / 6), 0.95, complex(0.002, 0.12), 0),
        "K": (241.5 / 230, 112.7 / 115, complex(0.005, 0.06) * 2, complex(0.001, -0.02)),
        "L": (1.02 * 220 / 230, 0.98, complex(power_loss, reactance) * 2 * (220 / 230) ** 2, 0),
    }
    assert case.branches[2].shift_deg == -30.0
    for branch in case.branches[2:]:
        first, second, impedance, magnetizing = expected[branch.circuit]
        y = bus_admittance(replace(case, branches=(branch,))).toarray()
        assert y[0, 0] == pytest.approx(1 / impedance / abs(first) ** 2 + magnetizing)
        assert y[0, 2] == pytest.approx(-1 / impedance / np.conj(first) / second)
        assert y[2, 0] == pytest.approx(-1 / impedance / first / second)
        assert y[2, 2] == pytest.approx(1 / impedance / second**2)


def test_three_windings_become_a_star_with_the_impedances_of_each_pair():
    case = own("three_windings.raw")
    star, legs = case.buses[-1], case.branches[2:]
    assert (star.number, star.voltage_pu, star.angle_deg) == (4, 1.005, -3.0)
    assert [(leg.from_bus, leg.to_bus, leg.circuit) for leg in legs] == [
        (1, 4, "T"), (2, 4, "T"), (3, 4, "T")
    ]  # fmt: skip
    assert [(leg.ratio, leg.shift_deg) for leg in legs] == [(1.02, 0), (0.98, 0), (1, -30)]
    z = [complex(leg.resistance, leg.reactance) for leg in legs]
    assert z[0] + z[1] == pytest.approx(complex(0.001, 0.05) * 100 / 50)
    assert z[1] + z[2] == pytest.approx(complex(0.004, 0.3) * 100 / 200)
    assert z[2] + z[0] == pytest.approx(complex(0.003, 0.24))
    assert (legs[0].from_conductance, legs[0].from_susceptance) == (0.001, -0.02)
    assert case.shunts == ()


def test_one_winding_of_three_may_be_out_of_service():
    legs = own("three_windings_one_out.raw").branches[2:]
    assert [leg.in_service for leg in legs] == [True, False, True]


def test_a_star_leg_without_impedance_becomes_a_short_branch_and_is_told():
    case = own("three_windings_no_leg.raw")
    assert [leg.reactance for leg in case.branches[2:]] == pytest.approx([0.1, 1e-5, 0.2])
    assert case.notices == (
        "branch 2-4:T: no impedance; 1e-05 p.u. taken",
        "transformer 1-2-3:U, out of service, left out",
    )
    voltage = gf.solve_power_flow(case).voltage
    assert abs(voltage[3]) == pytest.approx(1.02 / 0.98, abs=1e-4)


def test_records_out_of_service_stay_in_the_case():
    case = own("out_of_service.raw")
    assert [load.in_service for load in case.loads] == [True, False]
    assert [unit.in_service for unit in case.generators] == [True, True, False]
    assert [branch.in_service for branch in case.branches] == [True, True, False, True, False]
    assert case.shunts == ()


def test_isolated_buses_are_left_out_with_what_stands_there_and_told():
    case = own("isolated_bus.raw")
    plain = own("revision_33.raw")
    assert (case.buses, case.branches, case.loads) == (plain.buses, plain.branches, plain.loads)
    assert case.notices == ("isolated bus 9 left out, with 1 branch, 1 load",)


def test_switching_devices_are_branches():
    closed, opened = own("switching_device.raw").branches[3:]
    assert closed == gf.Branch(1, 4, "@1", reactance=2e-4)
    assert opened == gf.Branch(
        2, 4, "@1", in_service=False
    )  # 1e-4 p.u.: closed it would join its buses
    assert not closed.joins
    assert opened.joins


def test_a_matpower_file_numbers_its_units_and_parallel_branches():
    case = own("plain.m")
    assert [str(unit.key) for unit in case.generators] == ["1:1", "2:1", "2:2", "2:3"]
    assert [u.base_mva for u in case.generators] == [150, 100, 50, 50]
    assert [str(b) for b in case.branches] == [
        "branch 1-2:1", "branch 2-1:2", "branch 2-3:1", "branch 1-3:1"
    ]  # fmt: skip
    assert case.branches[3] == gf.Branch(1, 3, "1", 0.0, 0.12, 0.04, 0.97, 4.0)
    assert case.buses[2] == gf.Bus(3, "", 1.0, 2, 1, 0.98, -5.0)  # 0 kV in the file
    assert case.shunts == (gf.Shunt(3, "1", 2.0, 20.0),)
    assert case.notices == ("isolated bus 9 left out, with 1 load",)
    assert gf.solve_power_flow(case).mismatch < 1e-10


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        (
            "dc_and_facts.raw",
            [
                'FACTS device "STATCOM" (line 43)',
            ],
        ),
        ("dc_line.m", ['two-terminal dc line "1-3": 1 record (dc_line.m:34)']),
        (
            "step_up_in_generator.raw",
            [
                "generator 2:1 (step_up_in_generator.raw:12): step-up transformer within the generator"
            ],
        ),
        (
            "island_without_slack.raw",
            [
                "an island without a slack unit: buses 7, 8 left out, with 1 branch, 1 generator",
            ],
        ),
    ],
)
def test_what_has_no_model_is_refused_or_listed(name, lines):
    message = refused(OWN / name)
    for line in lines:
        assert f"not supported: {line}\n" in message
    case = own(name, allow_unsupported=True)
    assert list(case.unsupported) == lines
    assert len(case.buses) == 3
    assert gf.solve_power_flow(case).mismatch < 1e-10


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ([("'T ',1,2,1", "'T ',1,7,1")], "CZ of a three-winding transformer is 7; its codes are"),
        ([("GNE DEVICE DATA\n", "GNE DEVICE DATA\n'G',1\n")], 'GNE device "G" (line 37)'),
        ([("MACHINE DATA\n", "MACHINE DATA\n3,'1',1\n")], "induction machine 3:1 (line 38)"),
        ([("BEGIN LOAD DATA", "BEGIN CARGO DATA")], "CARGO section: 1 record line"),
    ],
)
def test_unknown_codes_and_sections_are_refused(tmp_path, changes, reason):
    assert reason in refused(written(tmp_path, "three_windings.raw", *changes))


def test_distributed_generation_within_a_load_is_refused(tmp_path):
    path = written(tmp_path, "revision_34.raw", ("1,1,0,0.000,0.000,0", "1,1,0,5.000,0.000,1"))
    assert "load 3:1: distributed generation within the load" in refused(path)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ([("230.0000,3,", "23x.0000,3,")], "line 4: BASKV of a bus is no number: 23x.0000"),
        ([("    2,'SOUTH", "    1,'SOUTH")], "duplicate bus id 1 (lines 4, 5)"),
        ([("1,     2,'1 '", "1,     7,'1 '")], "branch 0 references unknown bus 7 (line 14)"),
        ([("1,     2,'1 '", "1,     1,'1 '")], "branch 1-1:1 (revision_33.raw:14): it joins a bus"),
        ([("0.00000E+0, 1.20000E-1,", "0.0, 0.0,")], "(revision_33.raw:17): its impedance is zero"),
        ([(" 1.00000E-2, 8.00000E-2,", "/")], "line 14: X of a branch is blank, and it has no"),
        ([("0.00000E+0, 1.20000E-1,   100.00", "0.0")], "line 18: X1-2 of a transformer is blank"),
        ([("    2,     3,'1 '", "    1,     2,'1 '")], "branch 1-2:1 is given 2 times"),
        ([("230.0000,3,", "230.0000,2,")], "has no slack generator"),
        ([("1.04000,   0.0000", "-1.04000,   0.0000")], "voltage_pu must be positive"),
        ([(" 33,", " 36,")], "line 1: the header gives the revision '36'; gridfold reads"),
        ([(" 33,", " 28,")], "line 1: the header gives the revision '28'; gridfold reads"),
        ([("100.00, 33", "0.00, 33")], "SBASE"),
    ],
)
def test_faults_name_file_line_and_record(tmp_path, changes, reason):
    assert reason in refused(written(tmp_path, "revision_33.raw", *changes))


def test_a_file_that_breaks_off_is_refused(tmp_path):
    lines = (OWN / "revision_33.raw").read_text().splitlines()
    end = next(k for k, line in enumerate(lines) if "BEGIN AREA" in line)
    path = tmp_path / "short.raw"
    for length in range(end):
        path.write_text("\n".join(lines[:length]))
        refused(path)
    path.write_text("\n".join(lines[: end + 1]))
    assert len(read_network(path).branches) == 3


@pytest.mark.parametrize("name", ["case.txt", "case", "case.rawx", "case.json"])
def test_an_unknown_suffix_is_refused_with_the_known_ones(tmp_path, name):
    (tmp_path / name).write_text("0, 100.00, 33")
    assert ".raw (PSS/E) and .m (MATPOWER)" in refused(tmp_path / name)


def test_suffix_in_capitals_names_in_another_encoding_and_a_byte_order_mark(tmp_path):
    text = (OWN / "revision_33.raw").read_bytes().replace(b"NORTH ", b"N\xd6R\x85D ")
    path = tmp_path / "revision_33.RAW"
    path.write_bytes(b"\xef\xbb\xbf" + text)
    assert read_network(path).buses[0].name == "NÖR\x85D"


@pytest.mark.parametrize("name", ["absent.raw", ".", "nul\0.raw"])
def test_what_is_no_file_is_refused(tmp_path, name):
    with pytest.raises(gf.CaseFileError):
        read_network(tmp_path / name)
    folder = tmp_path / "folder.raw"
    folder.mkdir()
    assert "cannot be read" in refused(folder)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("mutations")


@st.composite
def mutations(draw):
    """An own file cut short, with lines lost or doubled, bytes changed, numbers made extreme."""
    path = draw(st.sampled_from(sorted(OWN.iterdir())))
    content = bytearray(path.read_bytes())
    for _ in range(draw(st.integers(1, 3))):
        kind = draw(st.sampled_from(["cut", "flip", "drop", "double", "number"]))
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        lines = bytes(content).splitlines(keepends=True)
        line = at % max(len(lines), 1)
        if kind == "cut":
            del content[at:]
        elif kind == "flip" and content:
            content[at] = draw(st.integers(0, 255))
        elif kind == "drop" and lines:
            content = bytearray(b"".join(lines[:line] + lines[line + 1 :]))
        elif kind == "double" and lines:
            content = bytearray(b"".join(lines[: line + 1] + lines[line:]))
        elif kind == "number":
            extreme = draw(st.sampled_from([b"1e308", b"-1e308", b"nan", b"99999999999999999999"]))
            content[at : at + 3] = b"," + extreme + b","
    return path.suffix, bytes(content)


@settings(max_examples=150, deadline=None)
@given(mutations(), st.booleans())
def test_every_damaged_file_ends_in_a_valid_case_or_an_error(scratch, mutated, allow):
    suffix, content = mutated
    path = scratch / f"damaged{suffix}"
    path.write_bytes(content)
    try:
        case = read_network(path, allow_unsupported=allow)
    except GridfoldError:
        return
    assert gf.validate_case(case) == []


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        (NPCC, (140, 92, 48, 206, 27, 0, 0)),
        (KUNDUR, (10, 2, 4, 11, 4, 0, 0)),
        (WECC, (243, 139, 146, 329, 122, 0, 7)),
        (TEXAS, (2000, 1350, 544, 2345, 861, 4, 153)),
    ],
)
def test_public_cases_have_their_true_counts(name, counts):
    case = public(name)
    records = find_sections((CASES / name).read_text(encoding="latin-1"))
    lines = set(records.of("BRANCH"))
    at = [int(case.origins[str(branch)].split(":")[1]) for branch in case.branches]
    kinds = Counter("S" if shunt.id[0] == "S" else "fixed" for shunt in case.shunts)
    found = (len(case.buses), len(case.loads), len(case.generators))
    found += (sum(line in lines for line in at), sum(line not in lines for line in at))
    assert (*found, kinds["fixed"], kinds["S"]) == counts
    assert case.unsupported == case.notices == ()


@pytest.mark.parametrize(
    ("name", "angle_rad"),
    [(NPCC, 2e-5), (WECC, 2e-5), (TEXAS, 2e-5), (KUNDUR, 5e-5)],
)
def test_the_power_flow_reproduces_stored_solutions(name, angle_rad):
    """Files store five digits, at a mismatch that moves the weak tie of two areas by 4.2e-5 rad."""
    case = public(name)
    voltage = gf.solve_power_flow(case).voltage
    stored = np.array([bus.voltage_pu for bus in case.buses])
    turn = np.exp(-1j * np.deg2rad([bus.angle_deg for bus in case.buses]))
    assert np.abs(np.abs(voltage) - stored).max() < 2e-5
    assert np.abs(np.angle(voltage * turn)).max() < angle_rad


def test_an_island_of_ieee39_has_no_slack_and_is_told():
    with pytest.raises(gf.CaseFileError, match=r"without a slack unit: buses 101, 103, 104, 105"):
        public(NEW_ENGLAND)
    case = public(NEW_ENGLAND, allow_unsupported=True)
    assert (len(case.buses), len(case.generators)) == (40, 10)
    assert gf.solve_power_flow(case).mismatch < 1e-10


def test_a_public_sample_with_three_windings_is_solved():
    case = public("samples/wscc9_3wxfr.raw")
    assert (len(case.buses), case.buses[-1].number, len(case.branches)) == (10, 10, 12)
    voltage = gf.solve_power_flow(case).voltage
    assert np.abs(np.abs(voltage[:9]) - [bus.voltage_pu for bus in case.buses[:9]]).max() < 0.02


def test_a_public_sample_of_revision_35_is_read_but_for_what_has_no_model():
    case = public("samples/case25_v35_savnwb.raw", allow_unsupported=True)
    assert (len(case.buses), len(case.loads), len(case.generators)) == (26, 17, 42)
    records = find_sections((CASES / "samples/case25_v35_savnwb.raw").read_text())
    assert len(records.of(THREE_WINDING)) == 1
    assert len(case.branches) == 33 + 2 + 6 + 3
    told = Counter(line.split(":")[0].split('"')[0] for line in case.unsupported)
    assert told == {"FACTS device ": 2, "dc line ": 2}
    assert sum("capacitors between converters" in line for line in case.unsupported) == 2
    assert [line.buses for line in case.dc_lines] == [(212, 213), (220, 222)]
    assert [str(b) for b in case.branches if b.joins] == ["branch 220-222:*1", "branch 219-213:@1"]
    shifter = next(b for b in case.branches if str(b) == "branch 110-212:1")
    share = (1.03717 - 1) / (1.06 - 1)  # between the points (1, 1) and (1.06, 0.99006 + 0.00011j)
    factor = 1 + share * (0.99006 + 0.00011j - 1)
    z = complex(shifter.resistance, shifter.reactance)
    assert z == pytest.approx(complex(2.3e-3, 2e-2) * factor, abs=1e-15)


@pytest.mark.parametrize("space", [" ", "\t", " \t"])
def test_a_section_mark_of_any_length_takes_no_time(space):
    marks = [f"0 / {words}{space * 20_000}X" for words in ("BEGIN", "END OF", "START OF")]
    began = time.monotonic()
    find_sections("\n".join(["0, 100.0, 33, 0, 0, 60.0", "", "", *marks, "Q"]))
    assert time.monotonic() - began < 2.0
