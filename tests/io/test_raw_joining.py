"""Lines and switching devices of RAW files that have no impedance to speak of."""

from pathlib import Path

import numpy as np
import pytest
from raw_texts import BUSES, LINES, LOADS, TRANSFORMERS, UNITS, raw_text, with_field

import gridfold as gf
from gridfold.io.powerio_cases import read_network

SPARE = "6,'HALF',230.0,1,1,1,1,1.0,0.0"
HEADER_34 = "0,100.0,34,0,1,60.0"
JOINED = "without impedance, so that their buses are one node: 3-6:1"


def read(tmp_path, text, **options):
    path = tmp_path / "station.raw"
    path.write_text(text)
    return read_network(path, **options)


def station(x, r="0.0", **changes):
    """The five buses with bus 6 beside bus 3: line 3-4:2 begins there."""
    lines = (
        LINES[0],
        LINES[1].replace("3,4", "6,4"),
        *LINES[2:],
        f"3,6,'1',{r},{x},0.0,0,0,0,0,0,0,0,1,1",
    )
    return raw_text({"BUS": (*BUSES, SPARE), "BRANCH": lines, **changes})


@pytest.mark.parametrize("x", ["0.0001", "0.00005", "-0.00003", "0", "1D-5"])
def test_a_line_without_resistance_up_to_the_threshold_joins_its_buses(tmp_path, x):
    case = read(tmp_path, station(x))
    assert case.branches[4].joins
    assert case.notices == (JOINED,)
    plain = gf.solve_power_flow(read(tmp_path, raw_text()))
    voltage = gf.solve_power_flow(case).voltage
    np.testing.assert_allclose(voltage[:5], plain.voltage, atol=1e-10)
    assert voltage[5] == voltage[2]


@pytest.mark.parametrize(("x", "r"), [("0.00011", "0.0"), ("0.0001", "0.00001"), ("-0.00011", "0")])
def test_any_other_line_keeps_its_impedance(tmp_path, x, r):
    case = read(tmp_path, station(x, r))
    assert not case.branches[4].joins
    assert case.branches[4].reactance == float(x)


def test_a_line_out_of_service_joins_nothing_and_is_not_told(tmp_path):
    case = read(
        tmp_path,
        station("0.0").replace(
            "0,0,0,0,0,0,0,1,1\n0 / END OF BRANCH", "0,0,0,0,0,0,0,0,1\n0 / END OF BRANCH"
        ),
    )
    assert case.branches[4].joins
    assert not case.branches[4].in_service
    assert case.notices == ()


def test_a_transformer_with_hardly_a_reactance_keeps_it(tmp_path):
    small = (TRANSFORMERS[0], "0.0,0.00005,100.0", *TRANSFORMERS[2:])
    case = read(tmp_path, raw_text({"TRANSFORMER": small}))
    assert case.branches[4].reactance == pytest.approx(5e-5)
    assert case.notices == ()


@pytest.mark.parametrize(
    ("setting", "joins"),
    [
        ("GENERAL, THRSHZ=0.001, PQBRAK=0.7", True),
        ("GENERAL,PQBRAK=0.7,THRSHZ = 1D-3", True),
        ("general, thrshz=0.0001", False),
        ("GENERAL, PQBRAK=0.7", False),
        ("GENERAL, THRSHZ=0.0", False),
    ],
)
def test_the_threshold_of_the_file_counts(tmp_path, setting, joins):
    named = tuple(
        line.replace(",0,0,0,0,0,0,0,1,1", ",'',0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,1,1")
        for line in LINES
    )
    coupler = "3,6,'1',0.0,0.0005,0.0,'',0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,1,1"
    text = raw_text({"BUS": (*BUSES, SPARE), "BRANCH": (*named, coupler)}, HEADER_34)
    text = text.replace(
        "OF THE TESTS\n", f"OF THE TESTS\n{setting}\n0 / END OF SYSTEM-WIDE DATA, BEGIN BUS DATA\n"
    )
    assert read(tmp_path, text).branches[4].joins == joins


@pytest.mark.parametrize("value", ["x", "-1", "", "2"])
def test_a_threshold_without_meaning_is_a_fault_with_its_line(tmp_path, value):
    text = raw_text().replace(
        "OF THE TESTS\n", f"OF THE TESTS\nGENERAL, THRSHZ={value}, PQBRAK=0.7\n"
    )
    with pytest.raises(gf.CaseFileError, match=r"line 4: THRSHZ must be 0 to 1 p.u., not"):
        read(tmp_path, text)


def test_a_closed_switching_device_joins_its_buses(tmp_path):
    named = tuple(
        line.replace(",0,0,0,0,0,0,0,1,1", ",'',0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,1,1")
        for line in LINES
    )
    switch = "3,6,'@1',0.0001,0,0,0,0,0,0,0,0,0,0,0,0,1,1,1,2,''"
    named = (named[0], named[1].replace("3,4", "6,4"), *named[2:])
    sections = {"BUS": (*BUSES, SPARE), "BRANCH": named, "SYSTEM SWITCHING DEVICE": (switch,)}
    case = read(tmp_path, raw_text(sections, HEADER_34))
    assert str(case.branches[-1]) == "branch 3-6:@1"
    voltage = gf.solve_power_flow(case).voltage
    assert voltage[5] == voltage[2]


def test_units_at_joined_buses_hold_one_voltage_and_share_as_at_one_bus(tmp_path):
    """The set point is that of the larger unit; reactive power is shared as it is stored."""
    bus = "7,'GEN-C',20.0,2,1,1,1,1.03,0.0"
    unit = UNITS[1].replace("2,'1',130.0,10.0", "7,'1',30.0,30.0").replace("200.0,0.0", "90.0,0.0")
    coupler = "7,2,'K',0.0,0.0,0.0,0,0,0,0,0,0,0,1,1"
    text = raw_text(
        {"BUS": (*BUSES, bus), "GENERATOR": (*UNITS, unit), "BRANCH": (*LINES, coupler)}
    )
    case = read(tmp_path, text)
    assert (
        "generator 7:1 holds 1.01 p.u. in place of 1.03: its bus is joined to that of"
        in case.notices[1]
    )
    units = {str(unit.key): unit for unit in case.generators}
    assert units["7:1"].share / units["2:1"].share == pytest.approx(3.0)
    flow = gf.solve_power_flow(case)
    first, second = flow.unit_power[1:].imag
    assert second == pytest.approx(3 * first, rel=1e-9)
    assert abs(flow.voltage[1]) == pytest.approx(1.01, abs=1e-12)


def test_of_two_swing_units_at_joined_buses_the_larger_balances(tmp_path):
    buses = (BUSES[0], with_field(BUSES[1], 3, "3"), *BUSES[2:])
    coupler = "1,2,'K',0.0,0.0,0.0,0,0,0,0,0,0,0,1,1"
    case = read(tmp_path, raw_text({"BUS": buses, "BRANCH": (*LINES, coupler)}))
    assert [u.control for u in case.generators] == [gf.Control.SLACK, gf.Control.VOLTAGE]
    assert case.generators[1].voltage_pu == 1.02
    assert gf.solve_power_flow(case).unit_power[1].real == pytest.approx(1.3)


def test_a_branch_of_a_matpower_file_without_impedance_joins_too(tmp_path):
    text = (Path(__file__).parent / "raw" / "plain.m").read_text()
    row = "1\t2\t0.01\t0.08" if "1\t2\t0.01\t0.08" in text else "1 2 0.01 0.08"
    assert row in text
    path = tmp_path / "joined.m"
    path.write_text(text.replace(row, row.replace("0.01", "0").replace("0.08", "0")))
    case = read_network(path)
    assert case.branches[0].joins
    assert "without impedance, so that their buses are one node: 1-2:1" in case.notices
    voltage = gf.solve_power_flow(case).voltage
    assert voltage[0] == voltage[1]


def test_loads_at_joined_buses_are_all_there(tmp_path):
    loads = (
        LOADS[0].replace("180.0,50.0", "100.0,20.0"),
        "6,'1',1,1,1,80.0,30.0,0,0,0,0,1",
        LOADS[1],
    )
    lines = (*LINES, "4,6,'1',0.0,0.0,0.0,0,0,0,0,0,0,0,1,1")
    case = read(tmp_path, raw_text({"BUS": (*BUSES, SPARE), "BRANCH": lines, "LOAD": loads}))
    plain = gf.solve_power_flow(read(tmp_path, raw_text()))
    np.testing.assert_allclose(gf.solve_power_flow(case).voltage[:5], plain.voltage, atol=1e-10)
