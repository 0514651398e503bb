"""An external area of further PSS/E devices: linearized, reduced, and in small-signal analysis."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from device_alone import named
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.equivalents.families import Mode
from gridfold.partition import linearize_external

#: Exciter, governor and stabilizer at the first and at the second machine of the areas 2 and 3.
ESST4B = (0.0, 3.9, 3.9, 1.0, -1.0, 0.01, 1.0, 0.0, 1.0, -1.0, 0.0, 6.9, 0.0, 9.0, 0.08, 0.0, 0.0)
GGOV1 = (
    1, 0, 0.04, 1, 0.05, -0.05, 10, 2, 0, 1, 1, 0.15, 0.1289, 1.5, 0.2, 0.5, 0, 0, 3, 1, 1.2, 1,
    0, 0.1, -0.1, 0, 0.01, 10, 0.1, 0, 0, 4, 5, 99, -99,
)  # fmt: skip
ESAC1A = (
    0.02, 1.2, 0.4, 60.0, 0.05, 12.0, -12.0, 0.8, 0.03, 1.0, 0.2, 0.3, 1.0, 1.5, 0.05, 3.5, 0.4,
    12.0, -12.0,
)  # fmt: skip
IEESGO = (0.1, 0.0, 0.2, 0.3, 7.0, 0.5, 20.0, 0.7, 0.4, 1.2, 0.0)
STAB1 = (6.0, 1.5, 13.3, 0.0447, 5.0, 0.05, 0.1)
FIRST = {"esst4b": ESST4B, "ggov1": GGOV1}
SECOND = {"esac1a": ESAC1A, "ieesgo": IEESGO, "stab1": STAB1}
MACHINES = {1: "genroe", 2: "gensae"}
NOT_OF_SALIENT_POLES = ("q_open_circuit_time", "q_transient_reactance")
FAULT, T_END = gf.BusFault(15, duration=0.05), 5.0


def devices_of(record: gf.DeviceRecord) -> list[gf.DeviceRecord]:
    """The machine of an external unit with its other controls; nothing for its former ones."""
    if record.bus < 20:
        return [record]
    if record.model != "genrou":
        return []
    second = record.bus % 10
    values = dict(record.parameters)
    if second == 2:
        values = {k: v for k, v in values.items() if k not in NOT_OF_SALIENT_POLES}
    machine = gf.DeviceRecord(MACHINES[second], record.bus, "1", values)
    controls = FIRST if second == 1 else SECOND
    own = (gf.DeviceRecord(m, record.bus, "1", named(m, row)) for m, row in controls.items())
    return [machine, *own]


@cache
def parts() -> gf.Partition:
    case = row_of_areas()
    devices = tuple(device for record in case.devices for device in devices_of(record))
    model = gf.build_model(replace(case, devices=devices))
    return gf.partition(model, [bus.number for bus in case.buses if bus.area == 1])


@cache
def detailed() -> gf.Trajectory:
    return gf.simulate(parts().model, [FAULT], T_END)


def test_modes_are_those_of_the_equations_of_motion():
    """Every mode that is not fast, from a matrix of central differences of the equations."""
    model = parts().model
    assert np.abs(model.compiled(model.x0)).max() < 1e-9
    columns = [
        (model.compiled(model.x0 + 1e-6 * e) - model.compiled(model.x0 - 1e-6 * e)) / 2e-6
        for e in np.eye(model.n_states)
    ]
    expected = np.linalg.eigvals(np.array(columns).T)
    found = gf.small_signal(model).eigenvalues
    distance = np.abs(found[:, None] - expected[None, :]).min(axis=1)
    slow = np.abs(found) > 0.05
    assert np.max(distance[slow] / np.abs(found[slow])) < 1e-3
    swings = [mode for mode in found if mode.real < 0 and 2 < mode.imag < 12]
    assert len(swings) >= 5


def test_hybrid_model_with_every_machine_nonlinear_is_the_detailed_one():
    family = gf.reduce(parts(), gf.Unreduced(), column_norm=0.0)
    run = gf.simulate_adaptive(parts().model, family, gf.SwitchingRule(0.0), [FAULT], T_END)
    assert {switch.after for switch in run.switches} == {Mode.DETAILED, Mode.HYBRID}
    assert max(unit.largest_deg for unit in gf.compare(detailed(), run.trajectory).units) < 1e-8


def test_reduced_external_area_keeps_its_bound_and_follows_the_detailed_run():
    family = gf.reduce(parts(), gf.BalancedTruncation(tolerance=1e-2))
    full, small = linearize_external(parts()).system, family.reduction.system
    assert small.n < 0.6 * full.n
    s = 1j * np.logspace(-3, 3, 60)
    error = np.linalg.norm(full.transfer(s) - small.transfer(s), 2, axis=(1, 2)).max()
    assert error <= family.reduction.bound * (1 + 1e-6)
    rule = gf.SwitchingRule(float("inf"), limits=False)
    run = gf.simulate_adaptive(parts().model, gf.SmallModels(family), rule, [FAULT], T_END)
    assert {switch.after for switch in run.switches} == {Mode.DETAILED, Mode.LINEAR}
    worst = gf.compare(detailed(), run.trajectory, parts().study_units).worst.rms_deg
    assert worst < 3.0
