"""An external area with a motor, a load by frequency, an SVC and more: reduced, ladder, modes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from device_alone import named
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.ladder import Ladder
from gridfold.grid.network_state import NetworkState

CIM5 = (
    1,
    0.01,
    0.1,
    3.2,
    0.02,
    0.09,
    0.04,
    0.05,
    1.0,
    0.0,
    1.2,
    0.0,
    0.0,
    1.25,
    0.7,
    0,
    0,
    0,
    2,
    None,
)
IEEL = (0.4, 0.1, 0.5, 0.3, 0.1, 0.6, 1.5, -1.0, 2.0, 1.3, 0.0, 2.0, 1.0, 0.4)
GENTPJ1 = (8, 0.03, 0.4, 0.05, 6.5, 2, 1.8, 1.7, 0.3, 0.55, 0.25, 0.2, 0.05, 0.3, 0.1)
WSIEG1 = (
    0, None, 20, 0.1, 0, 0.2, 0.5, -0.5, 1.1, 0, 0.3, 0.3, 0, 7, 0.7, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
)  # fmt: skip
CSVGN1 = (40.0, 0.0, 0.0, 0.1, 0.0, 0.03, 0.0, 1.0, 0.0, 150.0)
IEEEVC = (0.0, -0.03)
MNLEX2 = (0.1, 1.0, 0.3, 0.5, 0.1, 2.5, 3.2)
MAXEX2 = (1, 3.0, 1.05, 20.0, 1.2, 5.0, 1.5, 2.0, 1.0, 0.02, -0.1)
FAULT, T_END = gf.BusFault(15, duration=0.05, reactance=0.1), 4.0


@cache
def parts() -> gf.Partition:
    """Part of the load of area 2 is a motor; area 3 has one of each of the other devices."""
    case = row_of_areas()
    motor = gf.Load(25, "M", active_mw=300.0, reactive_mvar=120.0)
    loads = tuple(
        replace(load, active_mw=load.active_mw - 300.0) if load.bus == 25 else load
        for load in case.loads
    )
    added = {
        "cim5": ((25, "load-M"), CIM5),
        "ieel": ((35, "load-1"), IEEL),
        "csvgn1": ((35, "S"), CSVGN1),
        "gentpj1": ((31, "1"), GENTPJ1),
        "wsieg1": ((31, "1"), WSIEG1),
        "ieeevc": ((32, "1"), IEEEVC),
        "mnlex2": ((32, "1"), MNLEX2),
        "maxex2": ((32, "1"), MAXEX2),
    }
    devices = [gf.DeviceRecord(m, *key, named(m, row)) for m, (key, row) in added.items()]
    kept = [d for d in case.devices if not (d.bus == 31 and d.model in ("genrou", "tgov1"))]
    svc = gf.Generator(35, "S", reactive_mvar=60.0, base_mva=200.0, control=gf.Control.POWER)
    whole = replace(
        case,
        generators=(*case.generators, svc),
        loads=(*loads, motor),
        devices=(*kept, *devices),
    )
    model = gf.build_model(whole)
    return gf.partition(model, [bus.number for bus in case.buses if bus.area == 1])


@cache
def detailed() -> gf.Trajectory:
    return gf.simulate(parts().model, [FAULT], T_END)


def worst_deg(run: gf.Trajectory) -> float:
    return gf.compare(detailed(), run, parts().study_units).worst.rms_deg


def test_loads_with_devices_are_units_of_their_area():
    units = [str(unit) for unit in parts().external_units]
    assert units == ["21:1", "22:1", "31:1", "32:1", "35:S", "35:load-1", "25:load-M"]
    assert [str(unit) for unit in parts().model.machines] == ["11:1", "12:1", *units[:4]]


def test_modes_are_those_of_the_equations_of_motion():
    """Off the kinks of idle limiters, beside which differences are those of both sides."""
    model = parts().model
    x = model.x0.copy()
    x[model.state_names.index("overexcitation_state:32:1")] = -1e-4
    x[model.state_names.index("underexcitation_state:32:1")] = 1e-4
    columns = [
        (model.compiled(x + 1e-6 * e) - model.compiled(x - 1e-6 * e)) / 2e-6
        for e in np.eye(model.n_states)
    ]
    expected = np.linalg.eigvals(np.array(columns).T)
    modes = gf.small_signal(model, x)
    distance = np.abs(modes.eigenvalues[:, None] - expected[None, :]).min(axis=1)
    slow = np.abs(modes.eigenvalues) > 0.05
    assert np.max(distance[slow] / np.abs(modes.eigenvalues[slow])) < 1e-3
    assert modes.common_angle.sum() == 1
    slips = [k for k, name in enumerate(model.state_names) if name.startswith("slip:")]
    assert modes.participation[slips].max() == 1.0


def test_hybrid_model_with_every_unit_nonlinear_is_the_detailed_one():
    family = gf.reduce(parts(), gf.Unreduced(), column_norm=0.0)
    run = gf.simulate_adaptive(parts().model, family, gf.SwitchingRule(0.0), [FAULT], T_END)
    assert {switch.after for switch in run.switches} == {Mode.DETAILED, Mode.HYBRID}
    assert max(unit.largest_deg for unit in gf.compare(detailed(), run.trajectory).units) < 1e-8


@cache
def folded() -> FoldedArea:
    return gf.fold(parts())


def run_with(family: FoldedArea | Ladder, whole_deg: float = 0.0) -> gf.AdaptiveRun:
    rule = gf.SwitchingRule(float("inf"), limits=False, whole_deg=whole_deg)
    return gf.simulate_adaptive(parts().model, family, rule, [FAULT], T_END)


def test_folded_area_with_the_motor_follows_the_detailed_run():
    names = [parts().model.state_names[k] for k in folded().area.state_index]
    assert {"slip:25:load-M", "bus_frequency_deviation:35:load-1"} <= set(names)
    run = run_with(folded())
    assert {switch.after for switch in run.switches} == {Mode.DETAILED, Mode.LINEAR}
    assert worst_deg(run.trajectory) < 1.0


def test_ladder_runs_with_them():
    run = run_with(Ladder((folded(),), whole=True), whole_deg=2.0)
    assert Mode.WHOLE in {switch.after for switch in run.switches}
    assert worst_deg(run.trajectory) < 1.0


def test_equilibrium_after_a_loss_of_load_turns_their_frames_with_the_rotors():
    model = parts().model.for_state(NetworkState(load_steps=((15, -100 + 0j),)))
    found = find_equilibrium(model, parts().model.x0)
    assert found.rate > 0.1
    rates = model.compiled(found.x)
    turning = model.layout.angle_states()
    np.testing.assert_allclose(rates[turning], found.rate, rtol=0, atol=1e-7)
    assert np.abs(np.delete(rates, turning)).max() < 1e-7


def test_a_load_that_gives_no_current_at_the_start_has_no_port_of_its_own():
    load = gf.UnitKey(35, "load-1")
    kept = [unit for unit in parts().external_units if unit.bus >= 31 and unit != load]
    area = gf.fold(parts(), kept)
    assert load not in area.ports.units
    assert np.abs(area.area.current).min() > 1.0
    assert worst_deg(run_with(area).trajectory) < 1.0


def test_loads_alone_are_no_linear_machines():
    loads = {gf.UnitKey(35, "load-1")}
    machines = [unit for unit in parts().external_units if unit not in loads]
    with pytest.raises(gf.OptionError, match="all external machines are retained"):
        gf.fold(parts(), machines)
