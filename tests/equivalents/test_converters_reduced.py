"""Converters in the external area: linearized, reduced, on the ladder, and in small-signal analysis."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from converter_cases import PLANT, RECORDS, TURBINE
from device_alone import named
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.dynamics.equilibrium import find_equilibrium
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import fold
from gridfold.grid.network_state import NetworkState
from gridfold.partition import couple

#: A photovoltaic plant and a wind turbine in the place of one machine each of areas 2 and 3.
CONVERTERS = {22: PLANT, 32: TURBINE}
#: The torque control gives the power of the turbine by its speed, so the plant leaves the power alone.
#: The blades are at their least pitch.
CHANGES = {(32, "repca1"): {"frequency_code": 0.0}, (32, "wtara1"): {"starting_pitch": 0.0}}
FAULT, T_END = gf.BusFault(15, duration=0.05), 5.0


@cache
def parts() -> gf.Partition:
    case = row_of_areas()
    machines = (record for record in case.devices if record.bus not in CONVERTERS)
    own = (
        gf.DeviceRecord(
            model, bus, "1", named(model, RECORDS[model], **CHANGES.get((bus, model), {}))
        )
        for bus, models in CONVERTERS.items()
        for model in models
    )
    model = gf.build_model(replace(case, devices=(*machines, *own)))
    return gf.partition(model, [bus.number for bus in case.buses if bus.area == 1])


@cache
def detailed() -> gf.Trajectory:
    return gf.simulate(parts().model, [FAULT], T_END)


def moving(model: gf.DetailedModel) -> np.ndarray:
    kinds = ("rotor_angle", "voltage_angle")
    return np.array([float(name.partition(":")[0] in kinds) for name in model.state_names])


def test_turning_rotors_and_followed_voltages_together_changes_nothing():
    model = parts().model
    assert model.residual < 1e-9
    jacobian = model.jacobian(model.x0)
    assert np.abs(jacobian @ moving(model)).max() < 1e-9 * np.abs(jacobian).max()
    modes = gf.small_signal(model)
    assert modes.common_angle.sum() == 1
    assert modes.rightmost.real < -1e-3
    # Both integrals of the pitch control and the pitch stand at their lower limit.
    assert modes.at_rest.sum() == 3


def test_equilibrium_at_another_frequency_is_followed_by_every_converter():
    model = parts().model
    more = model.for_state(NetworkState(load_steps=((15, 100 + 0j),)))
    point = find_equilibrium(more, model.x0)
    assert point.rate < -0.1
    rest = more.compiled(point.x) - point.rate * moving(model)
    assert np.abs(rest).max() < 1e-8
    slots = model.layout.signal_slots
    for bus in CONVERTERS:
        frequency = point.x[slots[gf.UnitKey(bus, "1"), "measured_frequency"]]
        assert frequency == pytest.approx(1 + point.rate / (120 * np.pi), abs=1e-10)


def test_converters_are_no_part_of_the_centre_of_inertia():
    run = detailed()
    assert {unit.bus for unit in run.model.machines} == {11, 12, 21, 31}
    weights = run.model.inertia(run.model.machines)
    angles = run.rotor_angle_deg()
    relative = run.rotor_angle_deg(None, gf.AngleReference.CENTRE_OF_INERTIA)
    mean = angles @ (weights / weights.sum())
    np.testing.assert_allclose(relative, angles - mean[:, None], atol=1e-9)


def test_column_norm_of_a_converter_is_that_of_its_rated_current():
    coupling = couple(parts())
    norms = dict(zip(coupling.units, coupling.norms, strict=True))
    assert all(norm > 0 for norm in norms.values())
    # Units of one rating at like places: a machine gives 1 / X'' = 4 times its rating for one volt.
    assert norms[gf.UnitKey(22, "1")] < norms[gf.UnitKey(21, "1")]
    assert coupling.reference.bus in (21, 31)


@pytest.mark.parametrize(("retained", "most"), [((), 2.0), ((gf.UnitKey(22, "1"),), 0.5)])
def test_linear_area_with_converters_follows_the_detailed_run(retained, most):
    folded = gf.SmallModels(fold(parts(), retained))
    rule = gf.SwitchingRule(float("inf"), limits=False)
    run = gf.simulate_adaptive(parts().model, folded, rule, [FAULT], T_END)
    mode = Mode.RETAINED if retained else Mode.LINEAR
    assert {switch.after for switch in run.switches} == {Mode.DETAILED, mode}
    worst = gf.compare(detailed(), run.trajectory, parts().study_units).worst.rms_deg
    assert worst < most


def test_hybrid_model_with_every_unit_nonlinear_is_the_detailed_one():
    family = gf.reduce(parts(), gf.Unreduced(), column_norm=0.0)
    run = gf.simulate_adaptive(parts().model, family, gf.SwitchingRule(0.0), [FAULT], T_END)
    assert {switch.after for switch in run.switches} == {Mode.DETAILED, Mode.HYBRID}
    assert max(unit.largest_deg for unit in gf.compare(detailed(), run.trajectory).units) < 1e-6
