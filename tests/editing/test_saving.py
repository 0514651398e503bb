"""A case that is written and read again is the same case, or it is said what is not in the files."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plants import MACHINE, two_plants

import gridfold as gf
from gridfold.dynamics.device import Role
from gridfold.dynamics.psse_parameters import named_parameters, source_impedance
from gridfold.dynamics.registry import DEVICES
from gridfold.editing.saving import write_case
from gridfold.grid.dc_lines import (
    DcControl,
    LineControl,
    ThyristorEnd,
    ThyristorLine,
    TransistorEnd,
    TransistorLine,
)
from gridfold.grid.flow_controls import ShuntControl, ShuntMode, UnitControl
from gridfold.io.dyr import read_dyr
from gridfold.io.powerio_cases import read_network

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
PUBLIC = {
    "kundur": ("kundur/kundur.raw", "kundur/kundur_full.dyr"),
    "npcc": ("npcc/npcc_curent.raw", "npcc/npcc_curent.dyr"),
    "wecc240": (
        "wecc240/240busWECC_2018_PSS32_fixed_shunts.raw",
        "wecc240/240busWECC_2018_PSS.dyr",
    ),
    "activsg2000": ("activsg2000/ACTIVSg2000.RAW", "activsg2000/ACTIVSg2000_dynamics.dyr"),
}
LENIENT = {"unsupported": "classical", "without_data": "negative_load"}
IEEL = ("a2", "a3", "a5", "a6", "a7", "a8", "n1", "n2", "n3", "n4", "n5", "n6")
CONTROLS = (
    UnitControl(101, "1", 1.01, 103, -80.0, 120.0, 60.0),
    ShuntControl(103, "S1", ShuntMode.DISCRETE, 0.97, 1.03, 103, ((3, 10.0), (1, -20.0))),
)
DC_LINES = (
    ThyristorLine(
        "BIPOLE", LineControl.POWER, 10.0, 8.2, 525.0,
        ThyristorEnd(103, 2, 12.0, 8.0, 0.1, 6.8, 230.0, 0.44, 1.02),
        ThyristorEnd(104, 2, 21.0, 18.0, 0.2, 7.3, 230.0, 0.96, 1.01),
        3.9, 400.0, 0.16,
    ),
    TransistorLine(
        "LIGHT", True, 0.71,
        TransistorEnd(103, DcControl.VOLTAGE, 100.0, False, 0.95, loss_kw=70.0, loss_kw_per_a=0.1),
        TransistorEnd(104, DcControl.POWER, -12.0, True, voltage_pu=1.0, least_loss_kw=90.0,
                      reactive_max_mvar=350.0, reactive_min_mvar=-140.0),
    ),
)  # fmt: skip


def by_unit(case):
    return sorted((d.model, d.bus, d.id, tuple(sorted(d.parameters.items()))) for d in case.devices)


def same_but_for_the_order_of_devices(one, other):
    return replace(one, devices=()) == replace(other, devices=()) and by_unit(one) == by_unit(other)


def voltages(case):
    flow = gf.solve_power_flow(case)
    return {bus.number: v for bus, v in zip(flow.case.buses, flow.voltage, strict=True)}


def farthest(one, other):
    before, after = voltages(one), voltages(other)
    assert before.keys() == after.keys()
    return max(abs(before[bus] - after[bus]) for bus in before)


def through_raw(case, folder):
    """What is read of RAW and DYR, and what is said not to be in them."""
    lost = write_case(case, folder / "saved.raw", overwrite=True)
    dyr = folder / "saved.dyr" if case.devices else None
    return gf.load_case(folder / "saved.raw", dyr, without_data="negative_load"), lost


def full_case():
    """Two plants with all that a case may have besides."""
    shunt = gf.Shunt(103, "S1", susceptance_mvar=20.0)
    case = two_plants()
    text = "IEELBL 103:1 a1=1 a4=1 " + " ".join(f"{name}=0" for name in IEEL)
    case = case.edit().add(text).set("load 103 area=2 zone=1 owner=7").case()
    return replace(
        case,
        notices=(),
        shunts=(*case.shunts, shunt),
        dc_lines=DC_LINES,
        flow_controls=CONTROLS,
        zone_names={2: "HIGH"},
        owner_names={1: "OWN"},
    )


# Folder.


def test_a_folder_holds_all_of_a_case(tmp_path):
    case = full_case()
    case = replace(
        case,
        description='Two "plants"\nin \\ two lines',
        buses=(replace(case.buses[0], name="A, B #'1'", latitude=41.5), *case.buses[1:]),
        generators=(replace(case.generators[0], share=0.5), *case.generators[1:]),
        notices=("a notice",),
        unsupported=("a thing: 1 record",),
        unplaced=("a record",),
        replacements=(
            gf.grid.replacement.Replacement("X", "left out", (gf.UnitKey(1, "a:b"),), 3.0, 0.1),
        ),
    )
    case.save(tmp_path / "new" / "plants")
    read = gf.load_case(tmp_path / "new" / "plants")
    assert same_but_for_the_order_of_devices(case, read)
    assert read.fingerprint == case.fingerprint
    for name in ("notices", "unsupported", "unplaced", "replacements", "flow_controls"):
        assert getattr(read, name) == getattr(case, name), name


def test_a_built_in_case_is_read_again_as_it_is(tmp_path):
    case = gf.load_case("npcc")
    case.save(tmp_path / "npcc")
    assert gf.load_case(tmp_path / "npcc") == case


def test_what_a_table_cannot_hold_is_told(tmp_path):
    case = two_plants()
    case = replace(case, buses=(replace(case.buses[0], name=" NORTH\nEND "), *case.buses[1:]))
    with pytest.warns(
        gf.SaveWarning, match="blanks around names, and line breaks in them: bus 101"
    ):
        case.save(tmp_path / "plants")
    assert gf.load_case(tmp_path / "plants").buses[0].name == "NORTH END"


def test_what_is_there_is_replaced_only_when_asked_for(tmp_path):
    case, folder = two_plants(), tmp_path / "plants"
    case.save(folder)
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(gf.OutputError, match="exists already; nothing was written"):
        case.save(folder)
    network = replace(case, devices=(), shunts=())
    network.save(folder, overwrite=True)
    assert gf.load_case(folder) == network
    assert (folder / "notes.txt").read_text() == "mine"


def test_a_folder_of_something_else_is_not_written_into(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(gf.OutputError, match="is no folder of a case"):
        two_plants().save(tmp_path, overwrite=True)


@pytest.mark.parametrize("name", ["grid.raw", "grid.dyr"])
def test_a_file_of_psse_is_replaced_only_when_asked_for(tmp_path, name):
    case = replace(two_plants(), generators=two_plants().generators[:2], devices=())
    case.save(tmp_path / name)
    with pytest.raises(gf.OutputError, match="exists already"):
        case.save(tmp_path / name)
    case.save(tmp_path / name, overwrite=True)


def test_other_forms_are_refused(tmp_path):
    with pytest.raises(
        gf.OptionError, match=r"a case is written as a folder, or as \.raw and \.dyr"
    ):
        two_plants().save(tmp_path / "grid.m")


# RAW and DYR.


def test_raw_and_dyr_hold_all_of_a_case_of_psse(tmp_path):
    case = full_case()
    read, lost = through_raw(case, tmp_path)
    assert lost == (
        "stored reactive power of units that share a bus by other parts: generator 102:1 and 1 more",
    )
    assert by_unit(read) == by_unit(case)
    assert farthest(case, read) < 1e-10
    assert read.buses == case.buses
    assert read.loads == case.loads
    assert read.dc_lines == case.dc_lines
    assert sorted(map(str, read.shunts)) == sorted(map(str, case.shunts))
    assert set(CONTROLS) <= set(read.flow_controls)
    for names in ("area_names", "zone_names", "owner_names"):
        assert getattr(read, names) == getattr(case, names)


def test_charging_of_a_transformer_stands_at_its_buses(tmp_path):
    case = two_plants()
    transformer = replace(
        case.branches[1],
        susceptance=0.3,
        from_susceptance=-0.02,
        to_conductance=0.01,
        shift_deg=30.0,
    )
    case = replace(case, branches=(case.branches[0], transformer, *case.branches[2:]))
    read, lost = through_raw(case, tmp_path)
    assert farthest(case, read) < 1e-10
    assert "a fixed shunt that stays when they trip: branch 102-104:1" in "\n".join(lost)


def test_units_that_hold_their_power_are_written_with_the_solution(tmp_path):
    case = two_plants()
    units = tuple(
        replace(unit, control=gf.Control.POWER, reactive_mvar=25.0) if unit.bus == 102 else unit
        for unit in case.generators
    )
    case = replace(case, generators=units)
    read, lost = through_raw(case, tmp_path)
    assert farthest(case, read) < 1e-10
    assert any(line.startswith("units that hold their reactive power") for line in lost)
    limits = {
        c.id: (c.reactive_min_mvar, c.reactive_max_mvar) for c in read.flow_controls if c.bus == 102
    }
    assert limits == {"1": (25.0, 25.0), "2": (25.0, 25.0)}


@pytest.mark.parametrize(
    ("machine", "read_as"),
    [
        (
            gf.DeviceRecord("classical", 101, "1", {"inertia": 3.0, "transient_reactance": 0.3}),
            {"inertia": 3.0, "damping": 0.0, "resistance": 0.0, "reactance": 0.3},
        ),
        (
            gf.DeviceRecord("infinite_bus", 101, "1", {"reactance": 0.01}),
            {"resistance": 0.0, "reactance": 0.01},
        ),
        (
            gf.DeviceRecord("genrou", 101, "1", MACHINE | {"resistance": 0.004}),
            MACHINE | {"resistance": 0.004},
        ),
    ],
)
def test_impedances_of_machines_stand_in_the_network(tmp_path, machine, read_as):
    case = two_plants()
    read, lost = through_raw(replace(case, devices=(machine, *case.devices[1:3])), tmp_path)
    assert next(d.parameters for d in read.devices if d.bus == 101) == read_as
    assert not any("model" in line for line in lost)


def test_what_the_files_of_psse_do_not_have_is_told(tmp_path):
    case = two_plants()
    devices = (
        gf.DeviceRecord("two_axis", 101, "1", {}),
        gf.DeviceRecord("negative_load", 102, "1"),
        *case.devices[2:3],
    )
    buses = (replace(case.buses[0], name="A NAME OF MANY LETTERS", latitude=40.0), *case.buses[1:])
    circuit = replace(case.branches[0], circuit="123")
    case = replace(case, devices=devices, buses=buses, branches=(circuit, *case.branches[1:]))
    lost = "\n".join(write_case(case, tmp_path / "g.raw"))
    for text in (
        "two_axis, no model of PSS/E: 101:1",
        "negative loads: --no-data negative-load reads them as such",
        "letters of names beyond 12: bus 101",
        "latitude and longitude: bus 101",
        "ids of more than 2 letters, which PSS/E cuts: branch 101-103:123",
    ):
        assert text in lost


NAMES = st.text("ABC 'z/,12", max_size=12).map(lambda text: " ".join(text.split()))
SMALL = st.floats(-0.05, 0.05).map(lambda value: round(value, 6))
POWER = st.floats(-30.0, 30.0)


@st.composite
def cases(draw):
    """Rings of up to six buses, whose branches, loads and shunts may be anything small."""
    n = draw(st.integers(2, 6))
    buses = tuple(
        gf.Bus(k, draw(NAMES), draw(st.sampled_from([20.0, 230.0])), draw(st.integers(1, 3)))
        for k in range(1, n + 1)
    )
    branches = []
    for k in range(1, n + 1):
        ratio = draw(st.sampled_from([1.0, 1.0, 0.97, 1.04]))
        branches.append(
            gf.Branch(
                k, k % n + 1, f"{k}", abs(draw(SMALL)), 0.1, abs(draw(SMALL)), ratio,
                draw(st.sampled_from([0.0, 0.0, 2.0])) if ratio != 1 else 0.0,
                from_conductance=abs(draw(SMALL)), from_susceptance=draw(SMALL),
                to_susceptance=draw(SMALL),
            )
        )  # fmt: skip
    loads = tuple(
        gf.Load(k, "1", *(draw(POWER) for _ in range(2)), draw(st.booleans()),
                *(draw(POWER) / 3 for _ in range(4)))
        for k in range(1, n + 1)
    )  # fmt: skip
    shunts = (gf.Shunt(n, "X", abs(draw(POWER)) / 10, draw(POWER), draw(st.booleans())),)
    generators = (
        gf.Generator(1, "1", control=gf.Control.SLACK, voltage_pu=1.01, base_mva=200.0),
        gf.Generator(
            2, "G", draw(st.floats(0.0, 40.0)), 3.0, draw(st.floats(0.98, 1.02)), share=3.0
        ),
        gf.Generator(2, "W", 5.0, 1.0, 1.0, in_service=False),
    )
    return gf.Case("ring", buses, tuple(branches), generators, loads, shunts)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(cases())
def test_any_small_case_comes_back(tmp_path, case):
    folder = tmp_path / "folder"
    assert write_case(case, folder, overwrite=True) == ()
    assert gf.load_case(folder) == case
    read, lost = through_raw(case, tmp_path)
    assert farthest(case, read) < 1e-10
    told = "\n".join(lost)
    if "quotes" not in told:
        assert [bus.name for bus in read.buses] == [bus.name for bus in case.buses]
    assert [load.power(1.03) for load in read.loads] == pytest.approx(
        [load.power(1.03) for load in case.loads]
    )


@pytest.mark.parametrize(
    "path", sorted((ROOT / "tests" / "io" / "raw").glob("*.raw")), ids=lambda p: p.stem
)
def test_every_kind_of_record_comes_back(tmp_path, path):
    try:
        case = gf.load_case(path, allow_unsupported_network=True)
    except gf.CaseError:
        pytest.skip("a file that is refused")
    write_case(case, tmp_path / "folder")
    folder, (again, _) = gf.load_case(tmp_path / "folder"), through_raw(case, tmp_path)
    assert folder.fingerprint == case.fingerprint
    assert folder.flow_controls == case.flow_controls
    assert farthest(case, again) < 1e-10
    for table in ("buses", "branches", "generators", "loads", "shunts", "dc_lines"):
        names = [sorted(map(str, getattr(one, table))) for one in (case, folder, again)]
        assert names[0] == names[1] == names[2], table


def records_of_psse(in_network):
    """For each model of PSS/E a device with other values for each parameter, ICONs whole."""
    for device in DEVICES.values():
        if device.psse_record:
            names = [parameter.name for parameter in device.parameters]
            icons = device.psse_record[: device.psse_icons]
            values = {
                n: k + (0.0 if n in icons else 0.5)
                for k, n in enumerate(names)
                if n in device.psse_record or n in in_network
            }
            unit = "load-1" if device.role is Role.LOAD else "1"
            yield device, gf.DeviceRecord(device.model, 101, unit, values)


def test_records_of_every_model_come_back_with_their_values(tmp_path):
    """Each value stands in its column, and what stands in the network is read from there."""
    in_network = ("resistance", "reactance")
    for device, record in records_of_psse(in_network):
        case = replace(two_plants(), devices=(record,))
        write_case(case, tmp_path / "one.raw", overwrite=True)
        (read,) = read_dyr(tmp_path / "one.dyr").records
        unit = read_network(tmp_path / "one.raw").generators[0]
        faults: list[str] = []
        given = source_impedance(device, unit) | named_parameters(read, device, "here", faults)
        assert faults == []
        suffix = "BL" if device.role is Role.LOAD else ""
        assert (read.model, read.bus, read.id) == (f"{device.model.upper()}{suffix}", 101, "1")
        assert {name: given[name] for name in record.parameters} == record.parameters, device.model


@pytest.mark.parametrize("name", PUBLIC)
def test_public_cases_come_back(tmp_path, name):
    paths = [CASES / file for file in PUBLIC[name]]
    for path in paths:
        if not path.is_file():
            pytest.skip(f"{path} is absent; GRIDFOLD_CASES names the folder of public cases")
    case = gf.load_case(*paths, **LENIENT, allow_unsupported_network=True)
    write_case(case, tmp_path / name)
    read = gf.load_case(tmp_path / name)
    assert same_but_for_the_order_of_devices(case, read)
    assert read.fingerprint == case.fingerprint
    again, _ = through_raw(case, tmp_path)
    assert by_unit(again) == by_unit(case)
    assert farthest(case, again) < 1e-10
    for table in ("buses", "generators", "loads", "shunts"):
        assert getattr(again, table) == getattr(case, table), table


def test_excited_units_start_from_the_saved_files_as_from_the_case(tmp_path):
    case = two_plants()
    (tmp_path / "x").mkdir()
    read, _ = through_raw(case, tmp_path / "x")
    one, other = gf.build_model(case), gf.build_model(read)
    assert one.n_states == other.n_states == 3 * 6 + 2
    assert np.allclose(one.x0, other.x0, atol=1e-9)
