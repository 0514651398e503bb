import csv
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

import gridfold as gf

DATA = Path(
    os.environ.get("GRIDFOLD_CASES", Path(__file__).resolve().parents[2] / ".." / "shared" / "data")
)
SOURCE = DATA / "npcc" / "datanp48.m"
needs_source = pytest.mark.skipif(
    not SOURCE.is_file(), reason=f"the original data are not at {SOURCE} (set GRIDFOLD_CASES)"
)
EXCITER = {
    "regulator_gain": 20.0,
    "regulator_time": 0.2,
    "exciter_gain": 1.0,
    "exciter_time": 0.314,
    "feedback_gain": 0.063,
    "feedback_time": 0.35,
    "saturation_a": 0.0013,
    "saturation_b": 1.4083,
}
GOVERNOR = {"droop": 0.05, "governor_time": 2.0}
TURBINE = {"charging_time": 4.0}
BUS_26 = gf.UnitKey(26, "1")


@pytest.fixture(scope="module")
def npcc_case():
    return gf.load_case("npcc")


@pytest.fixture(scope="module")
def pst_case():
    return gf.load_case("npcc-pst")


def matrix(name):
    """Rows of a matrix of the original MATLAB file, as floats."""
    lines = [line.split("%")[0].replace("...", " ") for line in SOURCE.read_text().splitlines()]
    text = "\n".join(lines).split(f"{name} = [", 1)[1].split("]", 1)[0]
    rows = [row.split() for row in text.split(";")]
    return [[float(cell) for cell in row] for row in rows if row]


def parameters(case, model):
    return {device.key: dict(device.parameters) for device in case.devices if device.model == model}


def close(value):
    return pytest.approx(value, rel=1e-12, abs=1e-12)


def machines_with_units():
    """Rows of the machine table with the unit that each became: ids count the machines at a bus."""
    seen = Counter()
    for row in matrix("mac_con"):
        bus = int(row[1])
        seen[bus] += 1
        yield gf.UnitKey(bus, str(seen[bus])), row


def test_the_built_in_cases_are_listed_and_load():
    assert gf.built_in_cases() == ["npcc", "npcc-pst"]
    for name in gf.built_in_cases():
        assert gf.load_case(name).name == name
        assert gf.load_case(name).description


def test_npcc_has_its_numbers_of_records(npcc_case):
    assert len(npcc_case.buses) == 140
    assert len(npcc_case.branches) == 233
    assert len(npcc_case.generators) == 57
    assert len(npcc_case.loads) == 83
    assert len(npcc_case.shunts) == 10
    assert Counter(device.model for device in npcc_case.devices) == {
        "two_axis": 48,
        "ieee_type1": 48,
        "first_order_governor": 48,
        "non_reheat_turbine": 48,
        "negative_load": 9,
    }
    assert (npcc_case.base_mva, npcc_case.frequency_hz) == (100.0, 60.0)
    assert [bus.number for bus in npcc_case.buses] == list(range(1, 141))
    assert all(branch.in_service for branch in npcc_case.branches)
    assert {bus.area for bus in npcc_case.buses} == set(npcc_case.area_names)


def test_npcc_slack_is_bus_78(npcc_case):
    slack = [unit.bus for unit in npcc_case.generators if unit.control is gf.Control.SLACK]
    assert slack == [78]


@needs_source
def test_every_bus_of_npcc_has_the_stored_voltage_of_the_source(npcc_case):
    for bus, row in zip(npcc_case.buses, matrix("bus"), strict=True):
        assert (bus.number, bus.voltage_pu, bus.angle_deg) == tuple(row[:3])


@needs_source
def test_every_load_and_shunt_of_npcc_is_that_of_the_source(npcc_case):
    loads = {load.bus: (load.active_mw, load.reactive_mvar) for load in npcc_case.loads}
    shunts = {s.bus: (s.conductance_mw, s.susceptance_mvar) for s in npcc_case.shunts}
    rows = matrix("bus")
    assert loads == {int(row[0]): (row[5], row[6]) for row in rows if row[5] or row[6]}
    expected = {int(row[0]): (100 * row[7], 100 * row[8]) for row in rows if row[7] or row[8]}
    assert {bus: close(power) for bus, power in expected.items()} == shunts
    assert len(loads) == len(npcc_case.loads)
    assert len(shunts) == len(npcc_case.shunts)


@needs_source
def test_every_generator_of_npcc_is_that_of_the_source(npcc_case):
    kinds = {1: gf.Control.SLACK, 2: gf.Control.VOLTAGE, 3: gf.Control.POWER}
    shares = {unit: (row[21], row[22]) for unit, row in machines_with_units()}
    expected = []
    for number, voltage, _, p, q, *_, kind, _, _ in matrix("bus"):
        here = [unit for unit in shares if unit.bus == number]
        if not here and not (p or q):
            continue
        for unit in here or [gf.UnitKey(int(number), "1")]:
            p_share, q_share = shares.get(unit, (1.0, 1.0))
            assert p_share == q_share
            expected.append(
                (unit, close(p * p_share), close(q * q_share), voltage, kinds[kind], p_share)
            )
    found = [
        (g.key, g.active_mw, g.reactive_mvar, g.voltage_pu, g.control, g.share)
        for g in npcc_case.generators
    ]
    assert found == expected
    assert {g.base_mva for g in npcc_case.generators} == {100.0}


@needs_source
def test_every_line_of_npcc_is_that_of_the_source(npcc_case):
    rows = matrix("line")
    found = [
        (b.from_bus, b.to_bus, b.resistance, b.reactance, b.susceptance, b.ratio, b.shift_deg)
        for b in npcc_case.branches
    ]
    assert found == [(*row[:5], row[5] or 1.0, row[6]) for row in rows]


@needs_source
def test_parallel_lines_of_npcc_are_numbered_in_the_order_of_the_source(npcc_case):
    seen = Counter()
    for branch in npcc_case.branches:
        ends = frozenset((branch.from_bus, branch.to_bus))
        seen[ends] += 1
        assert branch.circuit == str(seen[ends])


@needs_source
def test_every_machine_of_npcc_is_that_of_the_source(npcc_case):
    found = parameters(npcc_case, "two_axis")
    rows = dict(machines_with_units())
    assert set(found) == set(rows)
    classical = 0
    for unit, row in rows.items():
        base, resistance, xd, xd1, td0, xq, inertia = (row[k] for k in (2, 4, 5, 6, 8, 10, 15))
        if xd == 0:
            classical += 1
            xd = xq = xd1
            td0, tq0 = 6.0, 0.5
        else:
            tq0 = 0.6
        assert found[unit] == close(
            {
                "inertia": inertia,
                "damping": 3 * inertia,
                "resistance": resistance * 100 / base,
                "d_reactance": xd * 100 / base,
                "q_reactance": xq * 100 / base,
                "d_transient_reactance": xd1 * 100 / base,
                "q_transient_reactance": xd1 * 100 / base,
                "d_open_circuit_time": td0,
                "q_open_circuit_time": tq0,
            }
        ), unit
    assert 0 < classical < 48
    assert rows[BUS_26][2] == 1000.0
    assert found[BUS_26]["inertia"] == 3.42
    assert found[BUS_26]["d_transient_reactance"] == 0.058


@needs_source
def test_generators_without_machine_in_the_source_are_negative_loads(npcc_case):
    machines = {unit for unit, _ in machines_with_units()}
    units = {generator.key for generator in npcc_case.generators}
    assert set(parameters(npcc_case, "negative_load")) == units - machines


@pytest.mark.parametrize(
    ("model", "constants"),
    [
        ("ieee_type1", EXCITER),
        ("first_order_governor", GOVERNOR),
        ("non_reheat_turbine", TURBINE),
    ],
)
@pytest.mark.parametrize("name", ["npcc", "npcc-pst"])
def test_every_machine_has_the_controllers_of_the_paper(name, model, constants):
    case = gf.load_case(name)
    found = parameters(case, model)
    assert set(found) == set(parameters(case, "two_axis"))
    assert all(record == constants for record in found.values())


@needs_source
def test_npcc_buses_have_the_published_coordinates(npcc_case):
    with (DATA / "npcc" / "bus_coordinates.csv").open(encoding="utf-8") as stream:
        rows = {int(row["Bus"]) + 1: row for row in csv.DictReader(stream)}
    assert len(rows) == 140
    for bus in npcc_case.buses:
        row = rows[bus.number]
        assert (bus.latitude, bus.longitude) == (float(row["Lat"]), float(row["Lon"])), bus


def test_npcc_pst_converts_the_inertia_and_damping_of_the_machine_at_bus_26(pst_case):
    machine = parameters(pst_case, "two_axis")[BUS_26]
    assert (machine["inertia"], machine["damping"]) == close((34.2, 102.6))


def test_npcc_pst_differs_from_npcc_in_nothing_else(npcc_case, pst_case):
    converted = tuple(
        replace(device, parameters={**device.parameters, "inertia": 3.42, "damping": 10.26})
        if device.model == "two_axis" and device.key == BUS_26
        else device
        for device in pst_case.devices
    )
    assert pst_case != npcc_case
    same = replace(pst_case, name="npcc", description=npcc_case.description, devices=converted)
    assert same == npcc_case
    assert same.fingerprint == npcc_case.fingerprint != pst_case.fingerprint
