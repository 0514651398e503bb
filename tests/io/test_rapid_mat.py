import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import gridfold as gf
from gridfold.io.rapid_mat import read_rapid

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
POLISH = CASES / "polish" / "Data_POLISH.mat"

# A ring of three feeders with a machine each; bus 9 hangs on a line that RAPID would call open.
BUS = [  # number, type, Pd, Qd, Gs, Bs, area, Vm, Va, base kV, zone, largest and smallest Vm
    [1, 3, 0, 0, 0, 0, 1, 1.05, 2, 18, 1, 1.1, 0.9],
    [2, 2, 0, 0, 0, 0, 1, 1.04, 1, 15, 2, 1.1, 0.9],
    [3, 2, -5, 1, 0, 0, 2, 1.03, 0, 13.8, 2, 1.1, 0.9],
    [4, 1, 0, 0, 0, 0, 1, 1, 0, 230, 1, 1.1, 0.9],
    [5, 1, 90, 30, 0, 0, 1, 1, -3, 230, 1, 1.1, 0.9],
    [6, 1, 0, 0, 2, 20, 1, 1, 0, 230, 2, 1.1, 0.9],
    [7, 1, 100, 35, 0, 0, 2, 1, 0, 230, 2, 1.1, 0.9],
    [8, 1, 0, 0, 0, 0, 2, 1, 0, 0, 2, 1.1, 0.9],
    [9, 1, 0, 0, 0, 0, 2, 1, 0, 230, 3, 1.1, 0.9],
]
GEN = [  # bus, Pg, Qg, largest and smallest Qg, Vg, base MVA, status, largest and smallest Pg
    [1, 0, 0, 99, -99, 1.04, 0, 1, 0, 0],
    [2, 80, 7, 99, -99, 1.02, 100, 1, 0, 0],
    [3, 30, -3, 99, -99, 1.01, 100, 1, 0, 0],
]
BRANCH = [  # ends, r, x, b, three ratings, ratio, shift, status
    [1, 4, 0, 0.06, 0, 0, 0, 0, 1.02, 1.5, 1],
    [2, 6, 0, 0.06, 0, 0, 0, 0, 0, 0, 1],
    [3, 8, 0, 0.07, 0, 0, 0, 0, 0, 0, 1],
    [4, 5, 0.01, 0.09, 0.1, 0, 0, 0, 0, 0, 1],
    [5, 6, 0.01, 0.1, 0.1, 0, 0, 0, 0, 0, 1],
    [6, 7, 0.01, 0.1, 0.1, 0, 0, 0, 0, 0, 1],
    [7, 8, 0.01, 0.1, 0.1, 0, 0, 0, 0, 0, 1],
    [8, 4, 0.02, 0.16, 0.2, 0, 0, 0, 0, 0, 1],
    [4, 8, 0.02, 0.17, 0.2, 0, 0, 0, 0, 0, 0],
    [9, 7, 999999, 999999, 0, 0, 0, 0, 0, 0, 1],
]
GEN_DATA = [  # bus, X, X', X" of d; T'd0, T"d0; X, X', X" of q; T'q0, T"q0; H, D, Ra, Xl, Tc, f, MVA
    [1, 1.8, 0.3, 0.3, 8, 0.03, 1.7, 0.55, 0.55, 0.4, 0.05, 6, 0.5, 0.003, 0.2, 0.01, 50, 130],
    [2, 1.2, 0.25, 0.2, 6, 0.03, 0.8, 0.25, 0.2, 0.5, 0.05, 4, 1.5, 0, 0.1, 0.01, 50, 120],
    [3, 1.0, 0.35, 0.35, 5, 0.03, 0.9, 0.4, 0.4, 0.6, 0.05, 3, 0, 0, 0.1, 0.01, 50, 60],
]
EXC_DATA = [  # KA, TA, KE, TE, KF, TF, AE, BE, largest and smallest VR, TR
    [20, 0.2, 1, 0.314, 0.063, 0.35, 0.0039, 1.555, 5, -5, 0.06],
    [21, 0.21, 1.1, 0.32, 0.064, 0.36, 0.004, 1.5, 5, -5, 0.06],
    [22, 0.22, 1.2, 0.33, 0.065, 0.37, 0.005, 1.4, 5, -5, 0.06],
]
TURB_DATA = [  # TCH, droop, TSV, largest and smallest valve position
    [0.5, 0.05, 0.2, 3, 0],
    [0.4, 0.06, 0.3, 3, 0],
    [0.3, 0.04, 0.1, 3, 0],
]


def tables():
    network = {"bus": BUS, "gen": GEN, "branch": BRANCH}
    return {
        "mpc": {"baseMVA": 100.0} | {name: np.array(rows, float) for name, rows in network.items()},
        "GenData": np.array(GEN_DATA, float),
        "ExcData": np.array(EXC_DATA, float),
        "TurbData": np.array(TURB_DATA, float),
    }


def written(folder, content):
    path = folder / "nine.mat"
    savemat(path, content)
    return path


def refused(folder, content):
    path = written(folder, content)
    with pytest.raises(gf.CaseFileError) as raised:
        read_rapid(path)
    assert str(path) in str(raised.value)
    return str(raised.value)


@pytest.fixture
def nine(tmp_path):
    return read_rapid(written(tmp_path, tables()))


def test_buses_loads_and_shunts_value_by_value(nine):
    assert (nine.name, nine.base_mva, nine.frequency_hz) == ("nine", 100.0, 50.0)
    assert nine.buses[1] == gf.Bus(2, "", 15.0, area=1, zone=2, voltage_pu=1.04, angle_deg=1.0)
    assert nine.buses[7].base_kv == 1.0  # 0 kV of the file says nothing
    assert nine.loads == (
        gf.Load(3, "1", -5.0, 1.0),
        gf.Load(5, "1", 90.0, 30.0),
        gf.Load(7, "1", 100.0, 35.0),
    )
    assert nine.shunts == (gf.Shunt(6, "1", 2.0, 20.0),)


def test_branches_have_circuits_ratios_and_shifts(nine):
    first, *_, closed, opened = nine.branches
    assert first == gf.Branch(1, 4, "1", 0.0, 0.06, 0.0, 1.02, 1.5)
    assert closed == gf.Branch(8, 4, "1", 0.02, 0.16, 0.2)
    assert opened == gf.Branch(4, 8, "2", 0.02, 0.17, 0.2, in_service=False)


def test_generators_hold_the_set_point_on_the_base_of_the_machine_data(nine):
    assert nine.generators == (
        gf.Generator(1, "1", 0.0, 0.0, 1.04, 130.0, gf.Control.SLACK, 130.0),
        gf.Generator(2, "1", 80.0, 7.0, 1.02, 120.0, gf.Control.VOLTAGE, 120.0),
        gf.Generator(3, "1", 30.0, -3.0, 1.01, 60.0, gf.Control.VOLTAGE, 60.0),
    )


def test_devices_value_by_value(nine):
    found = {device.model: dict(device.parameters) for device in nine.devices if device.bus == 1}
    assert found == {
        "two_axis": {
            "inertia": 6.0,
            "damping": 0.5,
            "resistance": 0.003,
            "d_reactance": 1.8,
            "q_reactance": 1.7,
            "d_transient_reactance": 0.3,
            "q_transient_reactance": 0.3,
            "d_open_circuit_time": 8.0,
            "q_open_circuit_time": 0.4,
        },
        "ieee_type1": {
            "regulator_gain": 20.0,
            "regulator_time": 0.2,
            "exciter_gain": 1.0,
            "exciter_time": 0.314,
            "feedback_gain": 0.063,
            "feedback_time": 0.35,
            "saturation_a": 0.0039,
            "saturation_b": 1.555,
        },
        "first_order_governor": {"droop": 0.05, "governor_time": 0.2},
        "non_reheat_turbine": {"charging_time": 0.5},
    }
    assert [(d.model, d.bus) for d in nine.devices[::4]] == [("two_axis", n) for n in (1, 2, 3)]


def test_notices_say_what_was_left_out(nine):
    assert nine.notices == (
        "open, for their impedance is 100000 p.u. or more: 9-7:1",
        "without connection: bus 9 left out, with 1 branch",
        "GenData: X'q is taken as X'd in 2 machines where it differs",
        "GenData: X\" is left out in 1 machines where it differs from X'",
        "ExcData: limits of VR and the voltage filter TR are left out",
        "TurbData: limits of the valve position are left out",
    )
    assert len(nine.buses) == 8


def test_records_know_their_variable_and_row(nine):
    assert nine.origins["branch 4-5:1"] == "mpc.branch row 4"
    assert nine.origins["generator 2:1"] == "mpc.gen row 2, GenData row 2"
    assert nine.origins["ieee_type1 3:1"] == "ExcData row 3"


def test_the_case_starts_at_an_equilibrium_and_load_case_reads_it(nine, tmp_path):
    assert gf.load_case(tmp_path / "nine.mat") == nine
    model = gf.build_model(nine)
    assert np.abs(model.compiled(model.x0)).max() < 1e-10
    assert len(model.machines) == 3


def test_machine_data_may_stand_in_another_order(nine, tmp_path):
    content = tables()
    for name in ("GenData", "ExcData", "TurbData"):
        content[name] = content[name][::-1]
    assert read_rapid(written(tmp_path, content)).devices == nine.devices


def test_a_generator_without_machine_data_becomes_a_negative_load(tmp_path):
    content = tables()
    for name in ("GenData", "ExcData", "TurbData"):
        content[name] = content[name][:2]
    case = read_rapid(written(tmp_path, content))
    assert case.devices[-1] == gf.DeviceRecord("negative_load", 3, "1")
    assert "without machine data, so negative loads: 3:1" in case.notices
    (replaced,) = case.replacements
    assert (replaced.outcome, replaced.units) == ("negative load", (gf.UnitKey(3, "1"),))
    assert len(gf.build_model(case).machines) == 2


def test_of_two_units_at_the_slack_bus_the_first_balances(tmp_path):
    content = tables()
    content["mpc"]["gen"][1, 0] = content["GenData"][1, 0] = 1
    content["mpc"]["gen"][1, 5] = 1.04
    content["mpc"]["bus"][1, 1] = 1
    units = read_rapid(written(tmp_path, content)).generators
    assert [str(unit.key) for unit in units] == ["1:1", "1:2", "3:1"]
    assert [unit.control.value for unit in units] == ["slack", "voltage", "voltage"]


def test_a_generator_at_a_pq_bus_holds_its_power_and_one_that_is_out_stays_out(tmp_path):
    content = tables()
    content["mpc"]["bus"][2, 1] = 1
    content["mpc"]["gen"][2, 1] = -30
    content["mpc"]["gen"][1, 7] = 0
    _, out, motor = read_rapid(written(tmp_path, content)).generators
    assert (motor.control, motor.active_mw, motor.in_service) == (gf.Control.POWER, -30.0, True)
    assert not out.in_service


def test_isolated_buses_are_left_out_with_all_that_is_there(tmp_path):
    content = tables()
    content["mpc"]["bus"][2, 1] = 4
    case = read_rapid(written(tmp_path, content))
    assert case.notices[1] == "isolated bus 3 left out, with 1 branch, 1 generator, 1 load"
    assert {device.bus for device in case.devices} == {1, 2}


def test_wrong_files_are_refused(tmp_path):
    for content, fault in (
        (b"not MATLAB", "cannot be read"),
        (b"", "cannot be read"),
        (None, "cannot be read: No such file"),
    ):
        path = tmp_path / "wrong.mat"
        path.unlink(missing_ok=True)
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(gf.CaseFileError) as raised:
            gf.load_case(path)
        assert fault in str(raised.value)
        assert str(path) in str(raised.value)


def test_missing_variables_are_named_together(tmp_path):
    text = refused(tmp_path, {"ExcData": np.eye(3), "TurbData": np.zeros((0, 5)), "other": 1})
    assert "the variable mpc is missing" in text
    assert "the variable GenData is missing" in text
    assert "ExcData has 3 rows and 3 columns; at least one row and 8 columns" in text
    assert "TurbData has 0 rows and" in text


def test_missing_fields_of_the_network_are_named(tmp_path):
    content = tables()
    del content["mpc"]["branch"]
    content["mpc"]["gen"] = "none"
    content["mpc"]["baseMVA"] = np.zeros(2)
    text = refused(tmp_path, content)
    for fault in ("mpc.branch is missing", "mpc.gen is not a table", "mpc.baseMVA is not a number"):
        assert fault in text
    assert "mpc is not a structure" in refused(tmp_path, tables() | {"mpc": 3.0})


@pytest.mark.parametrize(
    ("table", "row", "column", "value", "fault"),
    [
        ("GenData", 1, 11, np.nan, "GenData row 2, column 12: nan is no number"),
        ("GenData", 1, 0, 5, "GenData row 2: there is no generator 5:1 in mpc.gen"),
        ("GenData", 1, 16, 60, "GenData column 17: 2 different frequencies"),
        ("GenData", 1, 17, 0, "generator 2:1 (mpc.gen row 2, GenData row 2): base_mva must be"),
        ("mpc.bus", 3, 1, 7, "mpc.bus row 4: there is no bus type 7"),
        ("mpc.bus", 3, 0, 4.5, "mpc.bus row 4, column 1: 4.5 is not whole"),
        ("mpc.gen", 0, 0, 77, "mpc.gen row 1: there is no bus 77"),
        ("mpc.branch", 4, 1, 77, "mpc.branch row 5: there is no bus 77"),
    ],
)
def test_a_wrong_value_is_named_with_its_row(tmp_path, table, row, column, value, fault):
    content = tables()
    inside, _, name = table.rpartition(".")
    (content[inside] if inside else content)[name][row, column] = value
    assert fault in refused(tmp_path, content)


def test_tables_must_have_equal_lengths(tmp_path):
    text = refused(tmp_path, tables() | {"TurbData": np.array(TURB_DATA[:2])})
    assert "TurbData has 2 rows, but GenData has 3" in text


@pytest.fixture(scope="module")
def polish():
    if not POLISH.is_file():
        pytest.skip(f"{POLISH} is absent; GRIDFOLD_CASES names the folder of public cases")
    return gf.build_model(read_rapid(POLISH))


def test_the_polish_grid_is_read_whole(polish):
    case = polish.case
    sizes = [len(rows) for rows in (case.buses, case.branches, case.generators, case.loads)]
    assert sizes == [2383, 2896, 327, 1826]
    assert len(polish.machines) == 327
    assert polish.n_states == 9 * 327
    assert any("327 machines" in line for line in case.notices)


def test_bases_of_the_polish_machines_follow_from_the_power_flow_with_the_set_points(polish):
    """Base = 1.3 times the apparent power, rounded, at least 1 MVA: no other start fits the data."""
    power = 100 * np.abs(polish.power_flow.unit_power)
    bases = np.array([unit.base_mva for unit in polish.case.generators])
    assert polish.power_flow.mismatch < 1e-10
    np.testing.assert_array_equal(bases, np.maximum(1, np.round(1.3 * power)))


def test_the_polish_grid_starts_flat(polish):
    assert np.abs(polish.compiled(polish.x0)).max() < 1e-6
    run = gf.simulate(polish, (), 2.0)
    assert np.abs(run.states - polish.x0).max() < 1e-8
