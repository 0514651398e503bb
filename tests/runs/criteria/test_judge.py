"""Runs held against criteria: the findings are those of formulas written here."""

import numpy as np
import pytest
from cases import lossless_classical_system, one_machine_infinite_bus

import gridfold as gf

FAULT = gf.BusFault(1, start=0.5, duration=0.1)


@pytest.fixture(scope="module")
def smib():
    return gf.build_model(one_machine_infinite_bus(damping=4.0))


@pytest.fixture(scope="module")
def ring():
    model = gf.build_model(lossless_classical_system())
    return gf.simulate(model, [FAULT], t_end=3.0, stepper=gf.RungeKutta4(0.005))


def finding(run, criterion):
    return gf.judge(run, [criterion])[0]


def test_the_dip_is_that_of_the_voltages_after_the_clearing(ring):
    late = ring.times >= 0.6 - 1e-9
    voltage = np.abs(ring.bus_voltage())[late]
    lowest = voltage.min()
    found = finding(ring, gf.VoltageDip(0.9))
    bus = 1 + int(voltage.min(axis=0).argmin())
    assert found.value == pytest.approx(lowest, rel=1e-12)
    assert (found.signal, found.where) == (f"voltage_pu:{bus}", f"bus {bus}")
    assert found.at == pytest.approx(ring.times[late][voltage[:, bus - 1].argmin()])
    assert found.verdict is (gf.Verdict.VIOLATED if lowest < 0.9 else gf.Verdict.KEPT)
    assert finding(ring, gf.VoltageDip(lowest - 1e-6)).verdict is gf.Verdict.KEPT
    assert finding(ring, gf.VoltageDip(lowest + 1e-6)).verdict is gf.Verdict.VIOLATED


def test_recovery_and_spells_are_counted_from_the_samples(ring):
    voltage, late = np.abs(ring.bus_voltage([2]))[:, 0], ring.times >= 0.6 - 1e-9
    level = 0.5 * (voltage[late].min() + voltage[late].max())
    below = np.flatnonzero(late & (voltage < level))
    back = ring.times[below[-1] + 1] - 0.6 if below[-1] + 1 < len(voltage) else None
    runs = np.split(below, np.flatnonzero(np.diff(below) > 1) + 1)
    spells = [ring.times[min(run[-1] + 1, len(voltage) - 1)] - ring.times[run[0]] for run in runs]
    found = finding(ring, gf.VoltageDip(level, longest=10.0, buses="2"))
    assert found.value == pytest.approx(max(spells), abs=1e-9)
    recovered = finding(ring, gf.VoltageRecovery(level, within=0.01, buses="2"))
    assert recovered.verdict is gf.Verdict.VIOLATED
    assert recovered.value == pytest.approx(2.4 if back is None else back, abs=1e-9)


def test_a_level_may_be_a_part_of_the_initial_voltage(ring):
    initial = np.abs(ring.bus_voltage())[0]
    found = finding(ring, gf.VoltageDip(0.97, of_initial=True))
    bus = int(found.signal.partition(":")[2])
    assert found.limit == pytest.approx(0.97 * initial[bus - 1], rel=1e-9)


def test_the_band_is_left_at_the_extremes_of_the_centre_of_inertia(smib):
    """The one machine beside the infinite bus is the centre of inertia."""
    run = gf.simulate(smib, [gf.BusFault(1, start=0.5, duration=0.1)], t_end=3.0)
    hertz = 60 * run.signal("speed", ["1:1"])[:, 0]
    upper = hertz.max()
    above = finding(run, gf.FrequencyBand(50.0, upper - 1e-3))
    assert above.verdict is gf.Verdict.VIOLATED
    assert above.value == pytest.approx(upper, abs=1e-9)
    assert above.margin == pytest.approx(-1e-3, abs=1e-9)
    assert above.at == pytest.approx(run.times[hertz.argmax()])
    kept = finding(run, gf.FrequencyBand(50.0, upper + 1e-3))
    assert kept.verdict is gf.Verdict.KEPT
    assert kept.share == pytest.approx(1e-3 / (upper + 1e-3 - 60), rel=1e-6)
    below = finding(run, gf.FrequencyBand(lowest_hz=50.0))
    assert below.value == pytest.approx(hertz.min(), abs=1e-9)
    assert below.margin == pytest.approx(hertz.min() - 50.0)


def test_how_long_the_band_is_left_is_the_longest_spell(smib):
    run = gf.simulate(smib, [gf.BusFault(1, start=0.5, duration=0.1)], t_end=3.0)
    hertz = 60 * run.signal("speed", ["1:1"])[:, 0]
    level = 60 + 0.5 * (hertz.max() - 60)
    rows = np.flatnonzero(hertz > level)
    spells = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    longest = max(run.times[spell[-1] + 1] - run.times[spell[0]] for spell in spells)
    found = finding(run, gf.FrequencyBand(highest_hz=level, longest=longest - 0.005))
    assert (found.verdict, found.unit) == (gf.Verdict.VIOLATED, "s")
    assert found.value == pytest.approx(longest, abs=1e-9)
    kept = finding(run, gf.FrequencyBand(highest_hz=level, longest=longest))
    assert kept.verdict is gf.Verdict.KEPT


def test_the_separation_is_the_largest_difference_of_two_angles(ring):
    angles = ring.rotor_angle_deg()
    spread = np.ptp(angles, axis=1)
    found = finding(ring, gf.AngleSeparation(spread.max() + 1.0))
    assert found.value == pytest.approx(spread.max(), rel=1e-12)
    assert found.margin == pytest.approx(1.0)
    assert found.at == ring.times[spread.argmax()]
    row = angles[spread.argmax()]
    ends = {str(ring.model.machines[k]) for k in (row.argmax(), row.argmin())}
    assert {name.partition(":")[2] for name in found.signal.split(",")} == ends
    pair = finding(ring, gf.AngleSeparation(90.0, machines="1,3"))
    assert pair.value == pytest.approx(np.abs(angles[:, 0] - angles[:, 2]).max(), rel=1e-12)


def test_the_damping_is_that_of_the_linearized_machine(smib):
    run = gf.simulate(smib, [gf.BusFault(1, duration=0.01)], t_end=12.0)
    mode = next(value for value in gf.small_signal(smib).eigenvalues if value.imag > 0)
    damping = -100 * mode.real / abs(mode)
    found = finding(run, gf.LeastDamping(damping * 1.05))
    assert found.verdict is gf.Verdict.VIOLATED
    assert found.value == pytest.approx(damping, rel=2e-2)
    assert finding(run, gf.LeastDamping(damping * 0.95)).verdict is gf.Verdict.KEPT


def test_without_a_disturbance_everything_is_kept(smib):
    run = gf.simulate(smib, [], t_end=2.0)
    asked = [
        gf.VoltageDip(0.9),
        gf.VoltageRecovery(0.9, 1.0),
        gf.FrequencyBand(59.9, 60.1),
        gf.LeastDamping(5.0),
        gf.AngleSeparation(90.0),
    ]
    assert {item.verdict for item in gf.judge(run, asked)} == {gf.Verdict.KEPT}


def test_a_lost_run_violates_or_is_open_but_never_kept(smib):
    run = gf.simulate(smib, [gf.BusFault(1, duration=1.0)], t_end=3.0)
    assert run.status is gf.Status.LOST_SYNCHRONISM
    asked = [gf.VoltageDip(0.01), gf.FrequencyBand(40.0), gf.LeastDamping(1.0)]
    found = gf.judge(run, [*asked, gf.VoltageRecovery(0.9, 1.0)])
    assert {item.verdict for item in found} == {gf.Verdict.OPEN}
    assert all(item.margin is None for item in found)
    assert "fault is on" in found[0].told
    assert "lost synchronism" in found[1].told


def test_a_trip_counts_from_its_own_time(smib):
    """Without a fault the time after which voltages count is that of the first event."""
    run = gf.simulate(smib, [gf.LoadStep(1, 0.7, 20.0)], t_end=3.0)
    voltage = np.abs(run.bus_voltage([1]))[:, 0]
    after = run.times >= 0.7 - 1e-9
    level = 0.5 * (voltage[after].min() + voltage[0])
    found = finding(run, gf.VoltageRecovery(level, 0.001, buses="1"))
    back = np.flatnonzero(after & (voltage < level))[-1] + 1
    expected = run.times[back] - 0.7 if back < len(voltage) else 3.0 - 0.7
    assert found.value == pytest.approx(expected, abs=1e-9)


def test_de_energized_buses_are_no_dip():
    case = lossless_classical_system()
    model = gf.build_model(case)
    run = gf.simulate(model, [gf.BusFault(3, duration=0.05, trip_bus=True)], t_end=1.0)
    found = finding(run, gf.VoltageDip(0.3))
    assert found.value > 0.3
    late = run.times >= 0.05 - 1e-9
    assert np.abs(run.bus_voltage([1, 2]))[late].min() == pytest.approx(found.value)


def test_what_a_reduced_model_stands_for_is_said(npcc_parts, npcc_linear):
    run = gf.simulate_adaptive(
        npcc_parts.model, npcc_linear, gf.SwitchingRule(np.inf), [gf.BusFault(3, 0.1, 0.1)], 1.0
    ).trajectory
    inside, every = gf.judge(run, [gf.VoltageDip(0.5), gf.VoltageDip(0.5, buses="all")])
    assert inside.notes == ()
    assert every.notes == (
        "104 of the 140 buses lie outside the study area, where the reduced model is approximate",
    )
