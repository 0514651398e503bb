"""Relays act at their own instants: against ramps and impedances that are known without a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from cases import X_GRID, X_LINE, X_MACHINE, H, one_machine_infinite_bus

import gridfold as gf
from gridfold.runs.measuring import Meter

F0 = 60.0
LOAD = 0.8
START = 1.0


@pytest.fixture(scope="module")
def alone() -> gf.DetailedModel:
    """A classical machine without damping that feeds an impedance through a line, alone."""
    machine = {"inertia": H, "damping": 0.0, "transient_reactance": X_MACHINE}
    return gf.build_model(
        gf.Case(
            name="alone",
            buses=(gf.Bus(1), gf.Bus(2)),
            branches=(gf.Branch(1, 2, reactance=X_LINE),),
            generators=(gf.Generator(1, active_mw=100 * LOAD, control=gf.Control.SLACK),),
            loads=(gf.Load(2, active_mw=100 * LOAD),),
            devices=(gf.DeviceRecord("classical", 1, "1", machine),),
        )
    )


@pytest.fixture(scope="module")
def two_lines() -> gf.DetailedModel:
    """A machine on an infinite bus through two lines in parallel."""
    case = one_machine_infinite_bus()
    second = replace(case.branches[0], circuit="2")
    return gf.build_model(replace(case, branches=(*case.branches, second)))


def acted(run: gf.Trajectory, word: str) -> list[float]:
    """When relays acted whose notice has a word."""
    return [notice.time for notice in run.notices if word in notice.text]


def ramp(model: gf.DetailedModel, added_mw: float, shares: Sequence[float] = ()) -> float:
    """dw/dt of the machine in p.u. per second, with load added and shares of the other one shed.

    Its internal voltage is constant, and so is the power of an impedance: E'^2 G, G seen from it.
    """
    size = abs(model.power_flow.voltage[1])
    admittance = LOAD / size**2 * (1 - sum(shares)) + added_mw / 100 / size**2
    seen = 1 / (1j * (X_MACHINE + X_LINE) + 1 / admittance)
    start = 1 / (1j * (X_MACHINE + X_LINE) + size**2 / LOAD)
    internal_squared = LOAD / start.real
    return (LOAD - internal_squared * seen.real) / (2 * H)


def test_stages_of_under_frequency_shedding_act_along_a_ramp_as_by_hand(alone):
    """Each slope is known, so are the times at which 59.5 and 59.2 Hz are passed, and the delays."""
    stages = (gf.SheddingStage(59.5, 0.1, 0.05), gf.SheddingStage(59.2, 0.15, 0.25))
    relay = gf.UnderFrequencyShedding(stages, buses="2")
    run = gf.simulate(alone, [gf.LoadStep(2, START, active_mw=20.0), relay], 4.0, criterion=None)
    first_slope, second_slope = ramp(alone, 20.0) * F0, ramp(alone, 20.0, [0.05]) * F0
    first = START + (59.5 - F0) / first_slope + 0.1
    at_first = F0 + first_slope * (first - START)
    second = first + (59.2 - at_first) / second_slope + 0.15
    assert acted(run, "under-frequency") == pytest.approx([first, second], abs=1e-6)
    assert run.models[-1].state.load_shed == ((2, 0.3),)
    slope = (np.diff(run.signal("speed", ["1:1"])[:, 0]) / np.diff(run.times))[-1]
    assert slope == pytest.approx(ramp(alone, 20.0, [0.05, 0.25]), rel=1e-6)


@pytest.mark.parametrize("step", [0.002, 0.01, 0.037])
def test_the_instant_does_not_hang_on_the_step(alone, step):
    relay = gf.UnderFrequencyShedding((gf.SheddingStage(59.5, 0.1, 0.1),), buses="2")
    event = gf.LoadStep(2, START, active_mw=20.0)
    run = gf.simulate(alone, [event, relay], 2.0, gf.RungeKutta4(step), criterion=None)
    expected = START + (59.5 - F0) / (ramp(alone, 20.0) * F0) + 0.1
    assert acted(run, "under-frequency") == pytest.approx([expected], abs=1e-6)


def test_a_relay_that_drops_out_before_its_delay_does_not_act(alone):
    """The load comes and goes again: the frequency is below 59.9 Hz for a known time."""
    slope = ramp(alone, 20.0) * F0
    below = 0.5 + 0.1 / slope  # of the half second of the ramp down; it then stays where it is
    relays = [
        gf.UnderFrequencyShedding((gf.SheddingStage(59.9, delay, 0.1),), buses="2")
        for delay in (below + 0.3, below + 0.6)
    ]
    back = gf.LoadStep(2, START + 0.5, active_mw=-20.0)
    up = gf.LoadStep(2, START + 0.5 + 0.4, active_mw=-200.0)
    events = [gf.LoadStep(2, START, active_mw=20.0), back, up]
    run = gf.simulate(alone, [*events, *relays], 4.0, criterion=None)
    assert len(acted(run, "under-frequency")) == 1


def test_without_delay_a_voltage_relay_acts_in_the_instant_of_the_dip(alone):
    relay = gf.UnderVoltageShedding((gf.SheddingStage(0.9, 0.0, 0.5),), buses="2")
    run = gf.simulate(alone, [gf.LoadStep(2, START, active_mw=60.0), relay], 2.0, criterion=None)
    assert acted(run, "under-voltage") == [START]
    assert len(run.run.pieces) == 2
    delayed = replace(relay, stages=(gf.SheddingStage(0.9, 0.25, 0.5),))
    run = gf.simulate(alone, [gf.LoadStep(2, START, active_mw=60.0), delayed], 2.0, criterion=None)
    assert acted(run, "under-voltage") == pytest.approx([START + 0.25], abs=1e-9)


def test_one_bus_may_measure_for_many(npcc):
    """Load of a whole area goes at one instant, by the frequency of one bus."""
    stage = (gf.SheddingStage(59.97, 0.2, 0.1),)
    relay = gf.UnderFrequencyShedding(stage, areas="1", measured_at=3)
    run = gf.simulate(npcc, [gf.LoadStep(3, 0.5, active_mw=900.0), relay], 8.0)
    (when,) = acted(run, "under-frequency")
    before = run.times <= when
    meter = Meter(npcc, [gf.grid.measurements.Frequency(3, below=59.97)])
    margin = meter.margins(run.models[1], run.models[1], None, run.states[before])[:, 0, 0]
    passed = run.times[before][np.flatnonzero(margin >= 0)[0]]
    assert passed + 0.2 - 0.01 <= when <= passed + 0.2
    area = {bus.number for bus in npcc.case.buses if bus.area == 1}
    loads = {load.bus for load in npcc.case.loads if load.in_service}
    assert dict(run.models[-1].state.load_shed) == dict.fromkeys(area & loads, 0.1)


def test_the_frequency_of_a_bus_is_the_slope_of_its_angle(npcc):
    """Against differences of the phasors along a run."""
    run = gf.simulate(npcc, [gf.BusFault(3, 0.0, 0.05)], 1.0, gf.RungeKutta4(0.002))
    meter = Meter(npcc, [gf.grid.measurements.Frequency(bus, above=F0) for bus in (3, 21, 78)])
    piece = run.run.pieces[1]
    found = meter.margins(run.models[1], run.models[1], None, piece.states)[1:-1, :, 0]
    voltages = run.models[1].bus_voltages(piece.states)[:, [2, 20, 77]]
    turned = np.angle(voltages[2:] / voltages[:-2]) / (piece.times[2:] - piece.times[:-2])[:, None]
    np.testing.assert_allclose(found, turned / (2 * np.pi), atol=2e-4)
    assert np.ptp(found) > 0.05


def test_a_generator_trips_on_overspeed_of_its_island_and_on_low_voltage(alone):
    slope = ramp(alone, -20.0) * F0
    relay = gf.GeneratorFrequencyTrip(1, delay=0.2, above=61.0)
    run = gf.simulate(alone, [gf.LoadStep(2, START, active_mw=-20.0), relay], 4.0, criterion=None)
    expected = START + 1.0 / slope + 0.2
    assert acted(run, "frequency trip of machine 1:1, above 61 Hz") == pytest.approx([expected])
    assert run.models[-1].state.units_out == {gf.UnitKey(1, "1")}
    assert np.abs(run.bus_voltage()[-1]).max() == 0
    low = gf.GeneratorVoltageTrip(1, delay=0.2, below=0.9)
    run = gf.simulate(alone, [gf.LoadStep(2, START, active_mw=60.0), low], 4.0, criterion=None)
    assert acted(run, "voltage trip of machine 1:1, below 0.9 p.u.") == pytest.approx([START + 0.2])


def test_a_machine_that_is_out_and_a_dead_bus_are_not_watched(alone):
    """After the trip of the only machine there is neither voltage nor frequency to act upon."""
    relays = [
        gf.GeneratorVoltageTrip(1, delay=0.1, below=0.9),
        gf.UnderVoltageShedding((gf.SheddingStage(0.9, 0.1, 0.5),), buses="2"),
        gf.UnderFrequencyShedding((gf.SheddingStage(59.0, 0.1, 0.5),), buses="2"),
    ]
    run = gf.simulate(alone, [gf.MachineTrip(1, time=START), *relays], 2.0, criterion=None)
    assert len(run.run.pieces) == 2


@pytest.mark.parametrize("loads", [None, "0.5,0,0.5"])
@pytest.mark.parametrize(
    ("fraction", "near", "far"),
    [(0.5, 0.05, 0.05), (0.1, 0.05, 0.35), (0.9, 0.35, 0.05), (0.0, 0.05, 0.35), (1.0, 0.35, 0.05)],
)
def test_distance_relays_clear_a_fault_by_the_zone_that_it_is_in(npcc, fraction, near, far, loads):
    """Reach 0.8 and 1.2: a fault within the first fifth is zone 1 here and zone 2 at the other end."""
    model = npcc if loads is None else gf.build_model(npcc.case, loads=gf.LoadModel.parse(loads))
    relays = [
        gf.DistanceRelay("2-33", 2), gf.DistanceRelay("2-33", 33),
        gf.DistanceRelay("2-1", 2), gf.DistanceRelay("2-1", 1), gf.DistanceRelay("5-31", 5),
    ]  # fmt: skip
    fault = gf.BranchFault("2-33", 0.2, 0.6, fraction=fraction)
    run = gf.simulate(model, [fault, *relays], 1.0, criterion=None)
    times = {2: 0.2 + near, 33: 0.2 + far}
    for bus, time in times.items():
        assert acted(run, f"relay of branch 2-33 at bus {bus}") == pytest.approx([time])
    assert not acted(run, "branch 2-1 ")
    assert run.models[-1].state.branches_out == npcc.case.branches_out | {2}
    assert run.notices[-1].text == "branch 2-33 tripped: no effect, it was so already"


def test_a_fault_behind_a_relay_is_none_of_its_business(npcc):
    """At a bolted fault of its bus there is no voltage: it goes by the one that it remembers."""
    relays = [gf.DistanceRelay("2-33", 2, delay_1=0.01), gf.DistanceRelay("2-1", 2, delay_1=0.01)]
    run = gf.simulate(npcc, [gf.BusFault(2, 0.2, 0.2), *relays], 0.5)
    assert [notice.text for notice in run.notices] == ["fault at bus 2", "fault at bus 2 cleared"]


def test_transfer_trip_opens_both_ends(two_lines):
    relay = gf.DistanceRelay("1-2:2", 1, transfer_trip=True)
    fault = gf.BranchFault("1-2:2", 0.2, 1.0, fraction=0.3)
    run = gf.simulate(two_lines, [fault, relay], 1.5)
    assert acted(run, "distance") == pytest.approx([0.25])
    assert run.models[2].state.branches_out == {1}
    assert not run.models[2].state.faulted


def seen_across(angle: np.ndarray, internal: float, grid: complex) -> np.ndarray:
    """Part of Z = V1 / I across a lossless line, for an internal voltage ahead of a grid by `angle`.

    I = (E - G) / (j X), V1 = E - j X' I: V1 / I = j X / (1 - G / E) - j X'; the line is j X_LINE.
    """
    total = X_MACHINE + X_LINE + X_GRID
    ahead = internal * np.exp(1j * angle)
    impedance = 1j * total / (1 - grid / ahead) - 1j * X_MACHINE
    return np.abs((impedance / (1j * X_LINE)).imag)


def test_an_out_of_step_relay_acts_where_the_swing_gets_within_its_inner_blinders():
    """The rotor angle tells the impedance; the times of passing follow from it."""
    model = gf.build_model(one_machine_infinite_bus())
    blocks = {block.device.model: block for block in model.layout.blocks}
    machine, source = (blocks[name] for name in ("classical", "infinite_bus"))

    def value(block, name):
        return float(block.parameters[block.device.parameter_rows.index(name), 0])

    internal = value(machine, "internal_voltage")
    grid = complex(value(source, "internal_real"), value(source, "internal_imag"))
    relay = gf.OutOfStepRelay("1-2", 1, outer=2.0, inner=0.5, delay=0.03, reach=2.0)
    fault = gf.BusFault(1, 0.1, 0.5)
    fast = gf.RungeKutta4(0.001)
    free = gf.simulate(model, [fault], 1.5, fast, criterion=None)
    across = seen_across(free.signal("rotor_angle", ["1:1"])[:, 0], internal, grid)
    after = free.times > 0.6 + 1e-9
    times = [free.times[after][np.flatnonzero(across[after] < size)[0]] for size in (2.0, 0.5)]
    assert times[1] - times[0] > 0.03
    run = gf.simulate(model, [fault, relay], 1.5, fast, criterion=None)
    assert acted(run, "out-of-step relay of branch 1-2 at bus 1: tripped") == pytest.approx(
        [times[1]], abs=1e-3
    )
    slower = replace(relay, delay=times[1] - times[0] + 0.01)
    assert not acted(
        gf.simulate(model, [fault, slower], times[1] + 0.01, fast, criterion=None), "step"
    )


def test_a_fault_is_not_taken_for_a_swing(two_lines):
    """The impedance jumps within both pairs of blinders at once."""
    relay = gf.OutOfStepRelay("1-2:2", 1, delay=0.01)
    fault = gf.BranchFault("1-2:2", 0.2, 0.15, fraction=0.4, trip=False)
    run = gf.simulate(two_lines, [fault, relay], 2.0)
    assert run.status is gf.Status.COMPLETED
    assert not acted(run, "out-of-step")


def test_an_event_that_a_relay_has_overtaken_has_no_effect_and_says_why(two_lines):
    relay = gf.DistanceRelay("1-2:2", 1, transfer_trip=True)
    events = [
        gf.BranchFault("1-2:2", 0.2, 0.1, fraction=0.3, trip=False),
        gf.BranchFault("1-2:2", 1.0, 0.05),
    ]
    assert gf.simulate(two_lines, events, 1.5).notices[2].text == "fault on branch 1-2:2"
    run = gf.simulate(two_lines, [*events, relay], 1.5)
    assert "fault on branch 1-2:2: no effect, fault on branch 1-2:2: it is open at 1 s" in [
        notice.text for notice in run.notices
    ]


def test_streamed_and_whole_runs_with_relays_have_the_same_rows(npcc, tmp_path):
    from gridfold.runs.streaming import simulate_to_files
    from gridfold.runs.table_files import TableFile, TableFormat

    stage = (gf.SheddingStage(59.97, 0.2, 0.1),)
    relay = gf.UnderFrequencyShedding(stage, areas="1", measured_at=3)
    events = [gf.LoadStep(3, 0.5, active_mw=900.0), relay]
    run = gf.simulate(npcc, events, 4.0)
    path = tmp_path / "run.csv"
    table = TableFile(path, TableFormat.CSV, run.columns())
    streamed = simulate_to_files(npcc, [table], events, 4.0).trajectory
    assert streamed.notices == run.notices
    written = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_allclose(written, run.frame().to_numpy(), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("relay", [gf.DistanceRelay("2-3", 2), gf.OutOfStepRelay("2-3", 3)])
def test_a_relay_of_a_branch_without_impedance_has_no_reach(alone, relay):
    coupler = gf.Branch(2, 3)
    case = replace(
        alone.case, buses=(*alone.case.buses, gf.Bus(3)), branches=(*alone.case.branches, coupler)
    )
    with pytest.raises(gf.EventError, match=r"relay of branch 2-3 at .* has no impedance"):
        gf.simulate(gf.build_model(case), [relay], 1.0)


@pytest.mark.parametrize(
    ("relay", "message"),
    [
        (gf.UnderFrequencyShedding((), buses="2"), "it has no stages"),
        (gf.UnderFrequencyShedding((gf.SheddingStage(59.0, 0.1, 0.1),)), "say where"),
        (
            gf.UnderFrequencyShedding((gf.SheddingStage(59.0, 0.1, 0.6),) * 2, buses="2"),
            "the stages shed more than all load",
        ),
        (
            gf.UnderVoltageShedding((gf.SheddingStage(0.9, -0.1, 0.1),), buses="2"),
            "stage 1: delay must be 0 s or later",
        ),
        (
            gf.UnderVoltageShedding((gf.SheddingStage(0.9, 0.1, 0.1),), buses="2", measured_at=9),
            "there is no bus 9",
        ),
        (gf.GeneratorVoltageTrip(1, 0.1), "give below or above"),
        (gf.GeneratorFrequencyTrip(2, 0.1, below=59.0), "no such machine in service"),
        (gf.DistanceRelay("1-2", 3), "its ends are buses 1 and 2"),
        (gf.DistanceRelay("1-2", 1, reach_2=0.0), "reach_2 must be a positive number"),
        (gf.OutOfStepRelay("1-2", 1, outer=0.5), "inner 1 must be less than outer 0.5"),
    ],
)
def test_a_relay_that_does_not_fit_is_an_error_before_anything_runs(alone, relay, message):
    with pytest.raises(gf.EventError, match=message):
        gf.simulate(alone, [relay], 1.0)
