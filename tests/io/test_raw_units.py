"""Units of RAW files: which run, on what base and behind what; names, ids and numbers as written."""

import csv

import numpy as np
import pytest
from raw_texts import BUSES, LOADS, UNITS, raw_text, with_field

import gridfold as gf
from gridfold.io.powerio_cases import read_network

DYR = "1 'GENCLS' 1 4.5 0.0 /\n2 'GENCLS' 1 4.0 0.0 /\n"
AT_TOWN = "4,'1',60.0,15.0,30,-30,1.0,0,80.0,0.0,0.25,0,0,1.0,1,100,80,0"


def read(tmp_path, changes=None, header="0,100.0,33,0,1,60.0"):
    path = tmp_path / "units.raw"
    path.write_text(raw_text(changes, header))
    return read_network(path)


def model(tmp_path, changes=None, header="0,100.0,33,0,1,60.0", dyr=DYR):
    raw, dynamics = tmp_path / "units.raw", tmp_path / "units.dyr"
    raw.write_text(raw_text(changes, header))
    dynamics.write_text(dyr)
    return gf.build_model(gf.load_case(raw, dynamics))


def test_a_unit_at_a_bus_of_type_1_is_out_of_service_and_told(tmp_path):
    case = read(tmp_path, {"GENERATOR": (*UNITS, AT_TOWN)})
    assert [unit.in_service for unit in case.generators] == [True, True, False]
    assert case.notices == (
        "generator 4:1 (units.raw:16): out of service, 60 MW: its bus is of type 1, and PSS/E runs "
        "units at buses of type 2 and 3 alone",
    )
    without = gf.solve_power_flow(read(tmp_path)).voltage
    np.testing.assert_allclose(gf.solve_power_flow(case).voltage, without, atol=1e-12)


@pytest.mark.parametrize(
    ("bus", "status", "runs", "told"),
    [(1, 1, False, True), (1, 0, False, False), (2, 1, True, False), (2, 0, False, False)],
)
def test_type_and_status_have_to_allow_a_unit(bus, status, runs, told, tmp_path):
    buses = (*BUSES[:3], with_field(BUSES[3], 3, str(bus)), BUSES[4])
    unit = with_field(AT_TOWN, 14, str(status))
    case = read(tmp_path, {"BUS": buses, "GENERATOR": (*UNITS, unit)})
    assert case.generators[2].in_service is runs
    assert bool(case.notices) is told


def test_each_unit_at_a_bus_of_type_1_has_its_notice_and_its_records_play_no_part(tmp_path):
    second = with_field(AT_TOWN.replace("'1'", "'2'"), 2, "20.0")
    changes = {"GENERATOR": (*UNITS, AT_TOWN, second)}
    dyr = DYR + "4 'GENCLS' 1 3 0 /\n4 'GENCLS' 2 3 0 /\n"
    found = model(tmp_path, changes, dyr=dyr)
    assert [str(unit) for unit in found.machines] == ["1:1", "2:1"]
    assert sum("its bus is of type 1" in line for line in found.case.notices) == 2
    assert any("GENCLS: 2 records of units out of service" in n for n in found.case.notices)


def test_a_unit_at_a_load_bus_of_a_matpower_file_feeds_in(tmp_path):
    path = tmp_path / "plain.m"
    path.write_text(
        "function mpc = plain\nmpc.version = '2';\nmpc.baseMVA = 100;\n"
        "mpc.bus = [1 3 0 0 0 0 1 1 0 230 1 1.1 0.9; 2 1 90 30 0 0 1 1 0 230 1 1.1 0.9];\n"
        "mpc.gen = [1 50 0 99 -99 1 100 1 99 0; 2 40 10 99 -99 1 100 1 99 0];\n"
        "mpc.branch = [1 2 0.01 0.1 0 0 0 0 0 0 1 -360 360];\n"
    )
    case = read_network(path)
    assert [unit.in_service for unit in case.generators] == [True, True]
    assert gf.solve_power_flow(case).unit_power[1] * 100 == pytest.approx(40 + 10j)


@pytest.mark.parametrize("blank", ["", "  ", "0", "0.0"])
def test_a_blank_base_of_a_unit_is_that_of_the_header_and_told(blank, tmp_path):
    units = (UNITS[0], with_field(UNITS[1], 8, blank))
    case = read(tmp_path, {"GENERATOR": units}, "0,250.0,33,0,1,60.0")
    assert [unit.base_mva for unit in case.generators] == [250.0, 250.0]
    assert case.notices == ("no MBASE given, 250 MVA, SBASE of the header, taken: 2:1",)


def test_the_swing_of_a_unit_without_a_base_is_that_of_its_inertia_on_the_header_s(tmp_path):
    """The frequencies of two machines on a network reduced to them here, by their formula."""
    base, reactance = 250.0, 0.25
    units = (UNITS[0], "2,'1',130.0,10.0,150,-150,1.01,0,,0.0,0.25")
    found = model(tmp_path, {"GENERATOR": units}, f"0,{base},33,0,1,60.0")
    flow = found.power_flow
    y = np.asarray(gf.grid.admittance.bus_admittance(found.case).todense())
    for k, load in enumerate((0, 0, 0, 180 + 50j, 90 + 25j)):
        y[k, k] += np.conj(load / base) / abs(flow.voltage[k]) ** 2
    own = 1 / (1j * reactance)  # on 250 MVA, the base of both and of the system
    behind = np.zeros((7, 7), dtype=complex)
    behind[:5, :5] = y
    internal = []
    for k, (bus, power) in enumerate(zip((0, 1), flow.unit_power, strict=True)):
        behind[bus, bus] += own
        behind[5 + k, 5 + k] += own
        behind[bus, 5 + k] = behind[5 + k, bus] = -own
        voltage = flow.voltage[bus]
        internal.append(voltage + np.conj(power / voltage) / own)
    inner = behind[5:, 5:] - behind[5:, :5] @ np.linalg.solve(behind[:5, :5], behind[:5, 5:])
    e, angle = np.abs(internal), np.angle(internal)
    delta = angle[0] - angle[1]
    g, b = inner[0, 1].real, inner[0, 1].imag
    stiff = [  # of each machine's power with its angle to the other, E1 E2 (B cos - G sin)
        e[0] * e[1] * (b * np.cos(delta) - g * np.sin(delta)),
        e[0] * e[1] * (b * np.cos(delta) + g * np.sin(delta)),
    ]
    omega = np.sqrt(2 * np.pi * 60 * (stiff[0] / (2 * 4.5) + stiff[1] / (2 * 4.0)))
    found_omega = np.abs(gf.small_signal(found).eigenvalues.imag).max()
    assert found_omega == pytest.approx(omega, rel=1e-6)


@pytest.mark.parametrize("blank", ["", "  "])
def test_a_blank_source_impedance_is_told_and_doubted_behind_gencls(blank, tmp_path):
    units = (UNITS[0], with_field(UNITS[1], 10, blank))
    found = model(tmp_path, {"GENERATOR": units})
    assert "no ZX given, 1 p.u. for ZSORCE taken: 2:1" in found.case.notices
    doubt = "reactance (ZX) is 1 p.u., usually 0.05 to 0.7"
    assert [str(item) for item in found.doubts if doubt in str(item)] == [
        f"gencls 2:1 (units.dyr:2): {doubt}"
    ]
    explicit = model(tmp_path, {"GENERATOR": (UNITS[0], with_field(UNITS[1], 10, "1.0"))})
    assert any(doubt in str(item) for item in explicit.doubts)
    assert not any(doubt in str(item) for item in model(tmp_path).doubts)


def test_units_that_do_not_run_have_no_notice_of_their_blanks(tmp_path):
    idle = "2,'2',0.0,0.0,0,0,1.01,0,,0.0,,0,0,1.0,0"
    assert read(tmp_path, {"GENERATOR": (*UNITS, idle)}).notices == ()


@pytest.mark.parametrize(
    "name", ["O'NEIL ~1", "ST. JOHN'S", "D'ARCY, N", "O'", "'TIS", "A/B'C", "X''Y"]
)
def test_a_name_may_hold_quotes_commas_and_slashes(name, tmp_path):
    buses = (*BUSES[:3], BUSES[3].replace("TOWN", name), BUSES[4])
    assert read(tmp_path, {"BUS": buses}).buses[3].name == name.replace("''", "'")


def test_ids_may_hold_quotes(tmp_path):
    loads = (LOADS[0].replace("'1'", "'O''"), LOADS[1])
    units = (UNITS[0], UNITS[1].replace("'1'", "'G''"))
    case = read(tmp_path, {"LOAD": loads, "GENERATOR": units})
    assert (str(case.loads[0]), str(case.generators[1])) == ("load 4:O'", "generator 2:G'")


def test_a_quote_that_is_not_closed_is_refused_with_its_line(tmp_path):
    buses = (*BUSES[:3], BUSES[3].replace("TOWN'", "TOWN"), BUSES[4])
    with pytest.raises(gf.CaseFileError, match=r"line 7: a quote is not closed: 'TOWN,230\.0"):
        read(tmp_path, {"BUS": buses})


@pytest.mark.parametrize(
    ("section", "at", "position", "written", "plain"),
    [
        ("LOAD", LOADS, 5, "1.8D2", "180.0"),
        ("LOAD", LOADS, 5, "18D1", "180.0"),
        ("BUS", BUSES, 7, ".102D1", "1.02"),
        ("GENERATOR", UNITS, 10, "2.5d-1", "0.25"),
        ("GENERATOR", UNITS, 8, "+0.25D+03", "250.0"),
    ],
)
def test_numbers_may_have_the_exponent_d(section, at, position, written, plain, tmp_path):
    def case(value):
        return read(tmp_path, {section: (with_field(at[0], position, value), *at[1:])})

    assert case(written) == case(plain)


def test_an_id_that_reads_as_an_exponent_stays_what_it_is(tmp_path):
    case = read(tmp_path, {"LOAD": (LOADS[0].replace("'1'", "1D"), LOADS[1].replace("'1'", "2D1"))})
    assert [load.id for load in case.loads] == ["1D", "2D1"]


@pytest.mark.parametrize(
    ("fixed", "switched"),
    [((), "S1"), (("S1",), "SS1"), (("S1", "SS1"), "SSS1"), (("1",), "S1"), (("s1",), "S1")],
)
def test_switched_shunts_leave_the_ids_of_fixed_ones_alone(fixed, switched, tmp_path):
    changes = {
        "FIXED SHUNT": tuple(f"4,'{name}',1,0.0,15.0" for name in fixed),
        "SWITCHED SHUNT": ("4,1,0,1,1.05,0.95,0,100.0,'',25.0,2,30.0",),
    }
    shunts = read(tmp_path, changes).shunts
    assert [shunt.id for shunt in shunts] == [*fixed, switched]
    assert sum(shunt.susceptance_mvar for shunt in shunts) == 25.0 + 15.0 * len(fixed)


def test_ids_with_commas_keep_the_columns_of_a_csv_file(tmp_path):
    units = (UNITS[0], UNITS[1].replace("'1'", "'G,'"))
    found = model(
        tmp_path, {"GENERATOR": units}, dyr=DYR.replace("2 'GENCLS' 1", "2 'GENCLS' 'G,'")
    )
    run = gf.simulate(found, [], t_end=0.02)
    run.to_csv(tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    assert {len(row) for row in rows} == {len(header)}
    assert header == list(run.frame().columns)
    assert any("2:G," in name for name in header)


@pytest.mark.parametrize("unit_id", ["''", "'  '", "'1'", "'AB'", "X", "1", "0"])
def test_ieeeg1_may_name_a_second_unit_in_words_where_there_is_none(unit_id, tmp_path):
    governor = (
        f"1 'IEEEG1' 1 0 {unit_id} 20.0 0.5 0.0 0.2 0.1 -0.1 1.0 0.0 "
        "0.3 0.3 0.0 8.0 0.3 0.0 0.4 0.4 0.0 0.0 0.0 0.0 /\n"
    )
    found = model(tmp_path, dyr=DYR + governor)
    assert "ieeeg1" in {record.model for record in found.case.devices}


def test_a_second_unit_of_ieeeg1_is_refused(tmp_path):
    governor = "1 'IEEEG1' 1 2 '1' 20 .5 0 .2 .1 -.1 1 0 .3 .3 0 8 .3 0 .4 .4 0 0 0 0 /\n"
    with pytest.raises(gf.CaseError, match="JBUS: a second unit of the turbine is not modelled"):
        model(tmp_path, dyr=DYR + governor)
