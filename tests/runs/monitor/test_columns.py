"""What is watched against the laws that it obeys: balances, sums, and known motions."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from cases import one_machine_infinite_bus

import gridfold as gf
from gridfold.dynamics.network import LoadModel
from gridfold.grid.events import BranchOpenEnd, LoadShed

EVENTS = [
    gf.BusFault(3, 0.2, 0.1),
    gf.BranchFault("3-2", 0.6, 0.1, fraction=0.3, reactance=0.02),
    gf.MachineTrip(23, "1", 1.0),
    gf.LoadStep(5, 1.2, 100.0, 20.0),
    BranchOpenEnd("32-31", 31, 1.4),
    LoadShed(0.2, buses="31", time=1.6),
]
EVERYTHING = "flow, load, generation, voltage, area, frequency, voltage_angle"


@pytest.fixture(scope="module")
def run(npcc):
    return gf.simulate(npcc, EVENTS, 2.0, gf.RungeKutta4(0.01))


@pytest.fixture(scope="module")
def frame(run):
    """All of it, and the other ends of all lines."""
    case = run.model.case
    others = ",".join(_turned(name) for name in case.branch_names)
    return run.frame(f"{EVERYTHING}, flow {others}")


def _turned(name):
    ends, colon, circuit = name.partition(":")
    first, second = ends.split("-")
    return f"{second}-{first}{colon}{circuit}"


def _shunts(case, frame, bus):
    """Complex power of the fixed shunts at a bus, in MVA."""
    here = [s for s in case.shunts if s.bus == bus and s.in_service]
    drawn = sum((complex(s.conductance_mw, -s.susceptance_mvar) for s in here), 0j)
    return drawn * frame[f"voltage_pu:{bus}"] ** 2


def test_powers_at_every_bus_add_up_to_zero(run, frame):
    """Generation is load, shunts and what flows into the lines; not at a faulted bus."""
    case = run.model.case
    for bus in [bus.number for bus in case.buses]:
        sums = []
        for p, unit in (("p", "mw"), ("q", "mvar")):
            p, g, d = f"{p}_{unit}", f"generation_{unit}", f"load_{unit}"
            lines = [c for c in frame.columns if c.startswith(f"{p}:{bus}-")]
            units = [c for c in frame.columns if c.startswith(f"{g}:{bus}:")]
            load = frame.get(f"{d}:{bus}", 0.0)
            sums.append(frame[units].fillna(0).sum(axis=1) - load - frame[lines].sum(axis=1))
        rest = sums[0] + 1j * sums[1] - _shunts(case, frame, bus)
        kept = (frame["time"] < 0.195) | (frame["time"] > 0.305) if bus == 3 else slice(None)
        if bus == 5:  # a load step at a bus without a load of its own
            kept = frame["time"] < 1.195
        assert np.abs(rest[kept]).max() < 1e-6, bus


def test_at_the_start_units_and_loads_have_the_powers_of_the_power_flow(run, frame):
    case, flow = run.model.case, run.model.power_flow
    for k, unit in enumerate(case.generators):
        power = flow.unit_power[k] * case.base_mva
        assert frame[f"generation_mw:{unit.key}"].iloc[0] == pytest.approx(power.real, abs=1e-6)
        assert frame[f"generation_mvar:{unit.key}"].iloc[0] == pytest.approx(power.imag, abs=1e-6)
    for load in case.loads:
        assert frame[f"load_mw:{load.bus}"].iloc[0] == pytest.approx(load.active_mw, abs=1e-6)


def test_what_is_lost_in_a_line_is_the_sum_of_its_ends(run, frame):
    """R I^2 of a line without charging, from the voltages written out."""
    case = run.model.case
    position = next(
        k
        for k, b in enumerate(case.branches)
        if b.resistance and not b.susceptance and b.ratio == 1
    )
    branch, name = case.branches[position], case.branch_names[position]
    voltages = run.bus_voltage([branch.from_bus, branch.to_bus])
    current = (voltages[:, 0] - voltages[:, 1]) / complex(branch.resistance, branch.reactance)
    lost = frame[f"p_mw:{name}"] + frame[f"p_mw:{_turned(name)}"]
    np.testing.assert_allclose(lost, 100 * branch.resistance * np.abs(current) ** 2, atol=1e-9)
    told = run.frame(f"current {name}")[f"current_pu:{name}"]
    np.testing.assert_allclose(told, np.abs(current), atol=1e-12)


def test_an_open_line_carries_nothing_and_a_tripped_unit_gives_no_value(frame):
    after = frame["time"] > 0.7
    assert (frame.loc[after, ["p_mw:3-2", "q_mvar:2-3"]] == 0).all(axis=None)
    assert frame.loc[frame["time"] >= 1.0, "generation_mw:23:1"].isna().all()
    assert frame.loc[frame["time"] < 0.995, "generation_mw:23:1"].notna().all()


def test_a_line_that_is_open_at_its_far_end_carries_its_charging_alone(run, frame):
    branch = next(b for b in run.model.case.branches if (b.from_bus, b.to_bus) == (32, 31))
    near = frame["time"] >= 1.405
    assert (frame.loc[near, ["p_mw:31-32", "q_mvar:31-32"]] == 0).all(axis=None)
    charging = -100 * branch.susceptance * frame.loc[near, "voltage_pu:32"] ** 2
    np.testing.assert_allclose(frame.loc[near, "q_mvar:32-31"], charging, rtol=0.01)


def test_what_flows_into_a_fault_inside_a_line_is_what_its_parts_carry(run, frame):
    """Both ends against the two parts of the line in series with the fault, written out."""
    case = run.model.case
    branch = next(b for b in case.branches if (b.from_bus, b.to_bus) == (3, 2))
    row = int(np.flatnonzero(frame["time"] > 0.65)[0])
    first, second = run.bus_voltage([3, 2])[row]
    near = 1 / (complex(branch.resistance, branch.reactance) * 0.3)
    far = 1 / (complex(branch.resistance, branch.reactance) * 0.7)
    behind = first / (branch.ratio * np.exp(1j * np.deg2rad(branch.shift_deg)))
    middle = (near * behind + far * second) / (near + far + 1 / 0.02j)
    into = 100 * behind * np.conj(near * (behind - middle))
    assert frame["p_mw:3-2"][row] == pytest.approx(into.real, abs=1e-6)
    assert frame["q_mvar:3-2"][row] == pytest.approx(into.imag, abs=1e-6)
    other = 100 * second * np.conj(far * (second - middle))
    assert frame["p_mw:2-3"][row] == pytest.approx(other.real, abs=1e-6)


def test_sums_of_an_area_are_those_of_its_buses_and_ties(run, frame):
    case = run.model.case
    area = {bus.number: bus.area for bus in case.buses}
    units = [f"generation_mw:{u.key}" for u in case.generators if area[u.bus] == 1]
    loads = [f"load_mw:{load.bus}" for load in case.loads if area[load.bus] == 1]
    ties = [
        n for n in (*case.branch_names, *map(_turned, case.branch_names)) if _leaves(n, area, 1)
    ]
    at_ends = frame[[f"p_mw:{name}" for name in ties]].sum(axis=1)
    before = frame["time"] < 1.195  # the load step has no load of the case beside it
    np.testing.assert_allclose(frame["area_generation_mw:1"], frame[units].sum(axis=1), atol=1e-7)
    np.testing.assert_allclose(
        frame.loc[before, "area_load_mw:1"], frame.loc[before, loads].sum(axis=1), atol=1e-7
    )
    np.testing.assert_allclose(frame["area_interchange_mw:1"], at_ends, atol=1e-7)
    added = 100 * frame["voltage_pu:5"] ** 2 / frame["voltage_pu:5"][0] ** 2
    rest = frame["area_load_mw:1"] - frame[loads].sum(axis=1)
    np.testing.assert_allclose(rest[~before], added[~before], atol=1e-7)
    told = run.frame("interface OUT = area:1 to all")["interface_mw:OUT"]
    np.testing.assert_allclose(told, at_ends, atol=1e-7)


def _leaves(name, area, number):
    first, second = map(int, name.partition(":")[0].split("-"))
    return area[first] == number != area[second]


def test_the_frequency_of_the_stiff_end_is_that_of_its_angle(frame):
    """The filter written out for samples 10 ms apart, from the angles of the table."""
    turn = np.deg2rad(frame["voltage_angle_deg:78"].to_numpy())
    times = frame["time"].to_numpy()
    until = times < 0.195  # no event within
    lag, decay, expected = 0.0, np.exp(-0.01 / 0.04), [60.0]
    for rate in np.diff(turn[until]) / 0.01:
        lag = decay * lag + (1 - decay) * rate
        expected.append(60.0 + lag / (2 * np.pi))
    np.testing.assert_allclose(frame["frequency_hz:78"][until], expected, atol=1e-9)


def test_a_bus_that_turns_steadily_has_the_frequency_of_its_machine():
    """After its line has gone a machine without load runs away at P / 2H; the filter lags by T."""
    case = one_machine_infinite_bus()
    load = (gf.Load(1, "1", 40.0, 0.0),)
    case = replace(case, loads=load)
    trip = [gf.BranchTrip("1-2", 0.5)]
    run = gf.simulate(gf.build_model(case), trip, 1.5, gf.RungeKutta4(0.002), criterion=None)
    frame = run.frame("frequency 1, speed 1")
    kept = frame["time"] > 0.8
    slope = np.gradient(frame["speed_pu:1:1"][kept], frame["time"][kept]).mean()
    lagging = 60 * (frame["speed_pu:1:1"][kept] - 0.04 * slope)
    np.testing.assert_allclose(frame["frequency_hz:1"][kept], lagging, atol=2e-3)
    assert frame["frequency_hz:1"].iloc[-1] > 60.5


def test_a_jump_of_the_angle_at_an_event_is_no_frequency(run, frame):
    """At the load step the angle at bus 5 jumps within no time."""
    at = int(np.flatnonzero(frame["time"] >= 1.2)[0])
    steps = np.abs(np.diff(frame["voltage_angle_deg:5"]))
    assert steps[at - 1] > 2 * steps[at]
    assert abs(frame["frequency_hz:5"][at] - frame["frequency_hz:5"][at - 1]) < 0.01


def test_a_bus_without_voltage_has_no_angle_and_no_frequency(frame):
    on = (frame["time"] > 0.195) & (frame["time"] < 0.295)
    assert frame.loc[on, ["frequency_hz:3", "voltage_angle_deg:3"]].isna().all(axis=None)
    assert frame.loc[~on, ["frequency_hz:3", "voltage_angle_deg:3"]].notna().all(axis=None)


@pytest.mark.parametrize("shares", [(1.0, 0.0, 0.0), (0.3, 0.4, 0.3)], ids=str)
def test_loads_follow_their_own_law_of_voltage(shares):
    case = gf.load_case("npcc")
    model = gf.build_model(case, loads=LoadModel(shares))
    run = gf.simulate(model, [gf.LoadStep(31, 0.1, 50.0, 10.0)], 0.3, gf.RungeKutta4(0.01))
    bus = next(load.bus for load in case.loads if load.active_mw > 100 and load.bus != 31)
    frame = run.frame(f"load {bus}, voltage {bus}")
    ratio = frame[f"voltage_pu:{bus}"] / frame[f"voltage_pu:{bus}"][0]
    law = shares[0] + shares[1] * ratio + shares[2] * ratio**2
    start = frame[f"load_mw:{bus}"][0]
    np.testing.assert_allclose(frame[f"load_mw:{bus}"], start * law, rtol=1e-9)


def test_relative_angles_are_those_of_the_trajectory(run):
    frame = run.frame("angle_coi 78, angle 78")
    coi = run.rotor_angle_deg(["78:1"], gf.AngleReference.CENTRE_OF_INERTIA)[:, 0]
    np.testing.assert_allclose(frame["angle_coi_deg:78:1"], coi)
    np.testing.assert_allclose(frame["angle_deg:78:1"], run.rotor_angle_deg(["78:1"])[:, 0])


def test_each_fifth_step_is_kept_and_no_column_twice(run):
    every = run.frame("voltage 1-3, voltage 2-5, speed 78")
    assert list(every.columns) == [
        "time", *(f"voltage_pu:{bus}" for bus in range(1, 6)), "speed_pu:78:1",
    ]  # fmt: skip
    few = run.frame("voltage 1-3, voltage 2-5, speed 78, every 5")
    pd.testing.assert_frame_equal(few, every.iloc[::5].reset_index(drop=True))
    all_of_it = run.frame().iloc[::50].reset_index(drop=True)
    pd.testing.assert_frame_equal(run.frame("every 50"), all_of_it)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("volts 3", "there is no quantity 'volts'; did you mean 'voltage'"),
        ("field_volts", "did you mean 'field_voltage'"),
        ("voltage 999, flow 3-9", "voltage: there is no bus 999 .*; flow: there is no line 3-9"),
        ("angle 3", "angle: there is no machine at bus 3"),
        ("voltage study area", "no study area is given here"),
        ("voltage none", "nothing is chosen to be watched"),
        ("flow none", "no line is chosen by 'none'"),
        ("area 99", "area: there is no area 99 in case npcc"),
    ],
)
def test_what_is_not_there_is_told_with_what_is(run, text, said):
    with pytest.raises(gf.OptionError, match=said):
        run.frame(text)


def test_outside_the_study_area_a_reduced_run_is_approximate(npcc_parts, npcc_linear):
    run = gf.simulate_adaptive(
        npcc_parts.model, npcc_linear, gf.SwitchingRule(np.inf), [gf.BusFault(3, 0.1, 0.1)], 1.0
    ).trajectory
    detailed = gf.simulate(npcc_parts.model, [gf.BusFault(3, 0.1, 0.1)], 1.0)
    monitor = "voltage study area, voltage 78, flow 3-2, speed 78"
    columns = run.columns(monitor)
    assert run.approximate(columns) == ("voltage_pu:78", "speed_pu:78:1")
    told = run.frame(monitor).attrs["columns"]
    assert (told["study_buses"], told["approximate"]) == (
        "1-36",
        ["voltage_pu:78", "speed_pu:78:1"],
    )
    exact = detailed.frame("voltage 1-36, voltage 78")
    apart = (run.frame("voltage study area, voltage 78") - exact).abs().max()
    assert apart.drop(["time", "voltage_pu:78"]).max() < 2e-4
    assert apart["voltage_pu:78"] < 2e-3
    assert detailed.approximate(detailed.columns("voltage 78")) == ()
