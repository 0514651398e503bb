from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import gridfold as gf
from gridfold.io.event_records import event_from_record


@pytest.fixture(scope="module")
def run(npcc) -> gf.Trajectory:
    events = [gf.BusFault(3, start=0.1, duration=0.1), gf.MachineTrip(36, "1", time=0.5)]
    return gf.simulate(npcc, events, t_end=1.0)


def test_there_is_one_row_a_time_step_and_each_event_instant_once(run):
    np.testing.assert_allclose(run.times, np.arange(101) * 0.01, atol=1e-12)
    assert run.run.step_count == 100


def test_terminal_powers_are_voltage_times_conjugate_current_at_the_bus(run):
    unit = gf.UnitKey(24, "1")
    power = run.signal("active_power", [unit]) + 1j * run.signal("reactive_power", [unit])
    index = run.model.layout.signal_slots
    source = [index[unit, name] for name in ("source_real", "source_imag")]
    signals = np.concatenate([part.model.signals(part.states) for part in run.parts])
    voltage = run.bus_voltage([24])[:, 0]
    norton = signals[:, source[0]] + 1j * signals[:, source[1]]
    current = norton - run.model.injections.machine[unit] * voltage
    np.testing.assert_allclose(power[:, 0], voltage * np.conj(current), atol=1e-9)
    np.testing.assert_allclose(run.signal("terminal_voltage", [unit])[:, 0], np.abs(voltage))


def test_angles_against_a_machine_and_against_the_centre_of_inertia(run):
    units = run.model.machines
    absolute = run.rotor_angle_deg()
    against = run.rotor_angle_deg(reference="78:1")
    column = [str(unit) for unit in units].index("78:1")
    np.testing.assert_allclose(against, absolute - absolute[:, [column]])
    coi = run.rotor_angle_deg(reference=gf.AngleReference.CENTRE_OF_INERTIA)
    weights = run.model.inertia(units)
    live = np.isfinite(coi)
    for row in (0, 15, 80):
        assert weights[live[row]] @ coi[row, live[row]] == pytest.approx(0, abs=1e-6)
    assert live[0].all()
    assert live[80].sum() == 47


def test_table_has_the_promised_columns_in_order(run):
    frame = run.frame("angle, speed, voltage, field_voltage")
    units = [str(unit) for unit in run.model.machines]
    buses = [bus.number for bus in run.model.case.buses]
    expected = ["time"]
    expected += [f"angle_deg:{unit}" for unit in units]
    expected += [f"speed_pu:{unit}" for unit in units]
    expected += [f"voltage_pu:{bus}" for bus in buses]
    expected += [f"field_voltage:{unit}" for unit in units]
    assert list(frame.columns) == expected
    assert frame.attrs["case"] == "npcc"


def test_csv_parquet_and_npz_hold_the_same_run_and_its_metadata(run, tmp_path):
    run.to_csv(tmp_path / "a.csv")
    run.to_parquet(tmp_path / "a.parquet")
    run.to_npz(tmp_path / "a.npz")
    csv = pd.read_csv(tmp_path / "a.csv")
    parquet = pd.read_parquet(tmp_path / "a.parquet")
    pd.testing.assert_frame_equal(parquet, run.frame())
    pd.testing.assert_frame_equal(csv, parquet, rtol=1e-14)
    metadata = json.loads((tmp_path / "a.csv.meta.json").read_text())
    schema = pq.read_schema(tmp_path / "a.parquet").metadata
    with np.load(tmp_path / "a.npz") as archive:
        np.testing.assert_array_equal(archive["states"], run.states)
        assert list(archive["state_names"]) == list(run.model.state_names)
        alone = {key: value for key, value in metadata.items() if key != "columns"}
        assert json.loads(str(archive["metadata"])) == alone
    assert json.loads(schema[b"gridfold"]) == metadata
    assert metadata["columns"]["area"]["1"] == "1-36"


def test_metadata_is_enough_to_repeat_the_run_to_the_last_bit(run, tmp_path):
    run.to_csv(tmp_path / "a.csv")
    record = json.loads((tmp_path / "a.csv.meta.json").read_text())
    case = gf.load_case(record["case"])
    assert case.fingerprint == record["fingerprint"]
    again = gf.simulate(
        gf.build_model(case, backend=gf.NetworkBackend(record["network_backend"])),
        [event_from_record(event) for event in record["events"]],
        record["t_end"],
        stepper={"rk4": gf.RungeKutta4}[record["stepper"]["name"]](record["stepper"]["step"]),
        criterion=gf.SynchronismCriterion(record["angle_limit_deg"]),
    )
    np.testing.assert_array_equal(again.states, run.states)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda run: run.signal("nonsense"), "no signal 'nonsense'; it has: .*field_voltage"),
        (lambda run: run.signal("speed", ["99:7"]), "no machine 99:7"),
        (lambda run: run.bus_voltage([1, 999]), "no bus 999"),
        (lambda run: run.rotor_angle_deg(reference="99:7"), "no machine 99:7"),
        (
            lambda run: run.frame("nonsense"),
            "no quantity 'nonsense'; known: voltage.*field_voltage",
        ),
    ],
)
def test_an_output_that_is_not_there_is_an_error_that_names_what_is(run, call, message):
    with pytest.raises(gf.OptionError, match=message):
        call(run)


def test_a_run_that_blows_up_is_cut_at_the_last_finite_sample_and_says_so(npcc):
    with pytest.warns(gf.StepWarning):
        run = gf.simulate(npcc, [gf.BusFault(3)], stepper=gf.RungeKutta4(1.0), criterion=None)
    assert run.status is gf.Status.NOT_FINITE
    assert run.culprit in npcc.state_names
    assert np.isfinite(run.states).all()
    assert len(run.times) == len(run.states)
