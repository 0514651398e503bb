"""What events do to the NPCC system."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf


def texts(run: gf.Trajectory) -> list[str]:
    return [notice.text for notice in run.notices]


def voltage(run: gf.Trajectory, bus: int) -> np.ndarray:
    return np.abs(run.bus_voltage([bus])[:, 0])


def test_voltage_at_the_faulted_bus_is_zero_exactly_while_the_fault_is_on(npcc):
    run = gf.simulate(npcc, [gf.BusFault(3, start=0.1, duration=0.2)], t_end=1.0)
    on = (run.times >= 0.1 - 1e-9) & (run.times < 0.3 - 1e-9)
    assert (voltage(run, 3)[on] == 0).all()
    assert (voltage(run, 3)[~on] > 0.5).all()


def test_fault_impedance_softens_the_fault(npcc):
    hard, soft = (
        gf.simulate(npcc, [gf.BusFault(20, duration=0.05, reactance=x)], t_end=0.06)
        for x in (0.0, 0.1)
    )
    assert (voltage(soft, 20) > 0.1).all()
    assert np.ptp(soft.rotor_angle_deg()) < np.ptp(hard.rotor_angle_deg())


@pytest.mark.parametrize("branch", ["3-2", "3-4", "2-3"])
def test_off_nominal_transformers_at_bus_3_can_be_faulted_and_tripped(npcc, branch):
    fraction = 1.0 if branch == "2-3" else 0.0
    run = gf.simulate(npcc, [gf.BranchFault(branch, duration=0.2, fraction=fraction)], t_end=16.0)
    assert run.status is gf.Status.COMPLETED
    assert voltage(run, 3)[10] == 0
    far = int(branch.split("-")[1]) if branch.startswith("3") else 2
    assert abs(voltage(run, 3)[-1] - voltage(run, far)[-1]) > 1e-3
    assert texts(run) == [f"fault on branch {branch}", f"branch {branch} tripped"]


def test_tripping_bus_3_loses_its_load_and_nothing_else(npcc):
    run = gf.simulate(npcc, [gf.BusFault(3, duration=0.2, trip_bus=True)], t_end=16.0)
    assert run.status is gf.Status.COMPLETED
    assert texts(run)[1:] == ["bus 3 tripped", "bus 3 de-energized, 9.0 MW of load lost"]
    after = run.times >= 0.2
    assert (voltage(run, 3)[after] == 0).all()
    others = [bus.number for bus in npcc.case.buses if bus.number != 3]
    assert (np.abs(run.bus_voltage(others)[after]) > 0.5).all()


def test_a_part_split_off_with_a_machine_runs_on_as_an_island_and_is_reported(npcc):
    run = gf.simulate(npcc, [gf.BranchTrip("33-36", time=0.5)], t_end=16.0)
    assert texts(run)[1] == "bus 36 runs on as an island of its own with machines 36:1"
    # Its load is 9 MW of 554: it speeds up alone, which is no loss of synchronism.
    assert run.status is gf.Status.COMPLETED
    assert run.signal("speed", ["36:1"])[-1, 0] > 1.01
    assert voltage(run, 36)[-1] > 0.5


def test_tripping_and_reclosing_a_branch_is_the_same_as_a_trip_until_then_and_recovers(npcc):
    events = [gf.BranchTrip("37-29", 0.2), gf.BranchReclose("29-37", 0.4)]
    run = gf.simulate(npcc, events, t_end=16.0)
    open_only = gf.simulate(npcc, events[:1], t_end=0.4)
    np.testing.assert_array_equal(run.states[:41], open_only.states)
    assert np.abs(run.rotor_angle_deg()[-1] - run.rotor_angle_deg()[0]).max() < 1.0


def test_a_tripped_machine_gives_no_power_and_drops_out_of_the_outputs(npcc):
    run = gf.simulate(npcc, [gf.MachineTrip(23, "2", time=0.5)], t_end=10.0)
    after = run.times >= 0.5
    assert np.isnan(run.signal("active_power", ["23:2"])[after]).all()
    assert np.isfinite(run.signal("active_power", ["23:2"])[~after]).all()
    assert np.isnan(run.rotor_angle_deg(["23:2"], gf.AngleReference.CENTRE_OF_INERTIA)[after]).all()
    frozen = run.model.slots("rotor_angle", (gf.UnitKey(23, "2"),))
    assert np.ptp(run.states[after][:, frozen]) == 0
    # The frequency falls: a power of 226 MW is missing.
    assert np.nanmax(run.signal("speed")[-1]) < 1.0


def test_balance_of_powers_holds_after_a_machine_trip(npcc):
    """Sum of generation = sum of bus injections, at every sample."""
    run = gf.simulate(npcc, [gf.MachineTrip(24, "1", time=0.5)], t_end=2.0)
    final = run.models[-1]
    voltages = run.bus_voltage()[-1]
    total = np.nansum(run.signal("active_power")[-1])
    y = final.equations.matrix
    machines = {u: a for u, a in final.injections.machine.items() if u != gf.UnitKey(24, "1")}
    shunt = np.zeros(len(voltages), dtype=complex)
    for unit, admittance in machines.items():
        shunt[npcc.case.bus_index[unit.bus]] += admittance
    consumed = np.sum(voltages * np.conj(y @ voltages - shunt * voltages)).real
    assert total == pytest.approx(consumed, rel=1e-9)


def test_a_load_step_draws_its_power_at_the_initial_voltage(npcc):
    step = gf.LoadStep(20, time=0.0, active_mw=200.0)
    run = gf.simulate(npcc, [step], t_end=20.0)
    before = np.abs(npcc.power_flow.voltage[19])
    added = 2.0 * (voltage(run, 20)[0] / before) ** 2
    assert 1.5 < added < 2.0
    assert run.signal("speed")[-1].max() < 1.0
    shed = gf.simulate(npcc, [gf.LoadStep(20, time=0.0, active_mw=-200.0)], t_end=20.0)
    assert shed.signal("speed")[-1].min() > 1.0


def test_loss_of_synchronism_ends_the_run_and_names_the_machine(npcc):
    run = gf.simulate(npcc, [gf.BusFault(3, duration=2.0)], t_end=16.0)
    assert run.status is gf.Status.LOST_SYNCHRONISM
    assert run.times[-1] < 5.0
    angle = run.rotor_angle_deg(reference=gf.AngleReference.CENTRE_OF_INERTIA)
    name = run.culprit.removeprefix("rotor_angle:")
    units = [str(unit) for unit in npcc.machines]
    assert abs(angle[-1, units.index(name)]) > 180
    assert texts(run) == ["fault at bus 3"]  # it ended before the fault was cleared
    assert (np.abs(angle[:-1]) <= 180).all()


def test_the_criterion_can_be_changed_and_switched_off(npcc):
    fault = [gf.BusFault(3, duration=0.6)]
    wide = gf.simulate(npcc, fault, 16.0, criterion=gf.SynchronismCriterion(720.0))
    narrow = gf.simulate(npcc, fault, 16.0, criterion=gf.SynchronismCriterion(90.0))
    off = gf.simulate(npcc, fault, 3.0, criterion=None)
    assert narrow.times[-1] < wide.times[-1]
    assert off.status is gf.Status.COMPLETED


def test_events_between_time_steps_happen_at_their_own_instant(npcc):
    fault = gf.BusFault(7, start=0.1234, duration=0.0201)
    run = gf.simulate(npcc, [fault], t_end=2.0)
    fine = gf.simulate(npcc, [fault], t_end=2.0, stepper=gf.RungeKutta4(0.001))
    assert {0.1234, round(0.1435, 9)} <= set(np.round(run.times, 9))
    difference = run.rotor_angle_deg()[-1] - fine.rotor_angle_deg()[-1]
    assert np.abs(difference).max() < 1e-3


def test_models_of_network_states_are_shared_through_a_store(npcc):
    store: dict = {}
    fault = gf.BusFault(3, duration=0.1)
    first = gf.simulate(npcc, [fault], 0.5, store=store)
    second = gf.simulate(npcc, [fault], 0.5, store=store)
    assert first.models[0] is second.models[0]
    np.testing.assert_array_equal(first.states, second.states)
