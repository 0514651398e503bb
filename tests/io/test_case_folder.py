import pytest
from bad_input_samples import SMALL_CASE, append, put, swap, write_small_case

import gridfold as gf


@pytest.fixture
def folder(tmp_path):
    return write_small_case(tmp_path / "small")


def child_of(folder, **files):
    child = folder.parent / "child"
    put("case.toml", 'extends = "../small"\n')(child)
    for name, text in files.items():
        put(name.replace("__", "/") + ".csv", text)(child)
    return child


def test_tables_become_records(folder):
    case = gf.load_case(folder)
    assert (case.name, case.base_mva, case.frequency_hz) == ("small", 100.0, 60.0)
    assert case.area_names == {1: "All"}
    assert (case.zone_names, case.owner_names) == ({}, {2: "City"})
    assert case.buses[0] == gf.Bus(1, "North", 230.0, 1, voltage_pu=1.04)
    assert case.branches[2] == gf.Branch(1, 3, "1", 0.008, 0.08, 0.02, 1.02)
    assert case.generators[0] == gf.Generator(
        1, "1", 80.0, 10.0, 1.04, 150.0, gf.Control.SLACK, 1.0
    )
    assert case.loads == (gf.Load(3, "1", 140.0, 30.0),)
    assert case.shunts == (gf.Shunt(3, "1", 0.0, 15.0),)
    assert [str(device) for device in case.devices] == [
        "first_order_governor 1:1",
        "ieee_type1 1:1",
        "ieee_type1 2:1",
        "non_reheat_turbine 1:1",
        "two_axis 1:1",
        "two_axis 2:1",
    ]
    assert case.devices[0].parameters == {"droop": 0.05, "governor_time": 2.0}


def test_records_know_their_file_and_line(folder):
    case = gf.load_case(folder)
    assert case.locate(case.branches[1]) == "branch 1-2:2 (branches.csv:3)"
    assert case.locate(case.devices[-1]) == "two_axis 2:1 (devices/two_axis.csv:3)"


def test_folder_may_be_given_as_text_path_or_relative_to_here_or_home(folder, monkeypatch):
    case = gf.load_case(folder)
    monkeypatch.chdir(folder.parent)
    monkeypatch.setenv("HOME", str(folder.parent))
    for source in (str(folder), "small", "~/small"):
        assert gf.load_case(source) == case


def test_name_is_that_of_the_folder_unless_given(folder):
    swap("case.toml", 'name = "small"', "")(folder)
    assert gf.load_case(folder).name == "small"
    assert gf.load_case(folder.rename(folder.with_name("other"))).name == "other"


def test_tables_other_than_the_network_may_be_left_out(folder):
    for name in ("loads.csv", "shunts.csv"):
        (folder / name).unlink()
    case = gf.load_case(folder)
    assert case.loads == case.shunts == ()


def test_an_empty_device_cell_is_a_parameter_not_given(folder):
    swap("devices/two_axis.csv", "1,1,4.0,2.0,", "1,1,4.0,,")(folder)
    first = next(d for d in gf.load_case(folder).devices if d.model == "two_axis")
    assert "damping" not in first.parameters


def test_an_extending_case_replaces_and_adds_rows(folder):
    base = gf.load_case(folder)
    child = gf.load_case(
        child_of(
            folder,
            loads="bus,id,active_mw\n2,1,7\n3,1,50\n",
            devices__two_axis=SMALL_CASE["devices/two_axis.csv"].replace("2,1,3.0", "2,1,9.0"),
            devices__classical="bus,id,inertia\n1,1,2\n",
        )
    )
    assert child.name == "child"
    assert child.loads == (gf.Load(3, "1", 50.0), gf.Load(2, "1", 7.0))
    assert child.buses == base.buses
    assert child.area_names == base.area_names
    kept = [str(device) for device in base.devices]
    assert [str(device) for device in child.devices] == [*kept, "classical 1:1"]
    assert child.devices[5].parameters["inertia"] == 9.0
    assert child.devices[4] == base.devices[4]
    assert child.locate(child.loads[0]) == "load 3:1 (loads.csv:3)"
    assert child.locate(child.branches[0]) == "branch 1-2:1 (branches.csv:2)"


def test_a_row_given_twice_in_an_extending_case_is_refused_not_overruled(folder):
    child = child_of(folder, loads="bus,active_mw\n3,50\n3,60\n")
    with pytest.raises(gf.CaseFileError, match=r"loads.csv:3: load 3:1 is given at line 2 already"):
        gf.load_case(child)


def test_an_extending_case_may_change_settings(folder):
    child = child_of(folder)
    append("case.toml", "frequency_hz = 50")(child)
    assert gf.load_case(child).frequency_hz == 50
    assert gf.load_case(folder).frequency_hz == 60


def test_a_case_may_extend_a_built_in_one(tmp_path):
    put("case.toml", 'extends = "npcc"')(tmp_path / "mine")
    put("loads.csv", "bus,id,active_mw,reactive_mvar\n3,1,10,88\n")(tmp_path / "mine")
    mine, npcc = gf.load_case(tmp_path / "mine"), gf.load_case("npcc")
    changed = [(a, b) for a, b in zip(mine.loads, npcc.loads, strict=True) if a != b]
    assert changed == [(gf.Load(3, "1", 10.0, 88.0), gf.Load(3, "1", 9.0, 88.0))]


def test_cases_may_extend_one_another_in_a_chain(folder):
    previous = "small"
    for name in ("a", "b", "c"):
        put("case.toml", f'extends = "../{previous}"')(folder.parent / name)
        previous = name
    assert gf.load_case(folder.parent / "c").branches == gf.load_case(folder).branches
