from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limited_cases import LIMITED, npcc_with_ieeet1, npcc_with_sexs

import gridfold as gf
from gridfold.dynamics.unit_limits import (
    limit_names,
    limits_acting,
    limits_passed,
    limits_touched,
    state_limits,
    touched_held,
    touched_let_go,
)
from gridfold.grid.network_state import NetworkState

ROOM = 0.1


@pytest.fixture(scope="module")
def limited(npcc) -> gf.DetailedModel:
    return gf.build_model(npcc_with_sexs(npcc, ROOM))


def slot(model: gf.DetailedModel, name: str, unit: str) -> int:
    return model.state_names.index(f"{name}:{unit}")


def test_a_case_without_limits_has_none(npcc):
    assert limit_names(npcc, npcc.machines) == ()
    assert limits_touched(npcc, npcc.x0, npcc.machines) == ()
    assert state_limits(npcc, npcc.x0, npcc.machines).names == ()


def test_a_limit_acts_beyond_its_value_and_is_told_by_symbol_model_and_unit(limited):
    x = limited.x0.copy()
    assert limits_acting(limited, x, limited.machines) == ()
    x[slot(limited, "exciter_voltage", "71:1")] += 1.01 * ROOM
    assert limits_acting(limited, x, limited.machines) == ("EMAX of sexs 71:1",)
    x[slot(limited, "exciter_voltage", "48:1")] -= 1.01 * ROOM
    found = limits_acting(limited, x, limited.machines)
    assert set(found) == {"EMAX of sexs 71:1", "EMIN of sexs 48:1"}
    others = [unit for unit in limited.machines if str(unit) != "71:1"]
    assert limits_acting(limited, x, others) == ("EMIN of sexs 48:1",)


def test_along_a_run_a_limit_acts_in_the_rows_in_which_it_acts_alone(limited):
    run = gf.simulate(limited, [gf.BusFault(3, duration=0.39)], 1.0)
    found = limits_passed(limited, run.states, limited.machines)
    assert set(limit_names(limited, limited.machines)) == {
        f"{end} of sexs {unit}" for end in ("EMIN", "EMAX") for unit in LIMITED
    }
    assert any(acts.any() for acts in found.values())
    for row in range(0, len(run.times), 10):
        alone = limits_acting(limited, run.states[row], limited.machines)
        assert {name for name, acts in found.items() if acts[row]} == set(alone)


def test_a_unit_that_is_out_has_no_limits(limited):
    unit = next(unit for unit in limited.machines if str(unit) == "71:1")
    out = limited.for_state(replace(limited.state, units_out=frozenset({unit})))
    assert not any("71:1" in name for name in limit_names(out, out.machines))
    assert "EMAX of sexs 71:1" not in state_limits(out, out.x0, out.machines).names


@pytest.mark.parametrize(("room", "touched"), [(0.0, True), (1e-9, True), (1e-4, False)])
def test_a_start_at_a_limit_touches_it_without_its_acting(npcc, room, touched):
    model = gf.build_model(npcc_with_sexs(npcc, room, ["71:1"]))
    assert limits_acting(model, model.x0, model.machines) == ()
    found = limits_touched(model, model.x0, model.machines)
    assert set(found) == ({"EMIN of sexs 71:1", "EMAX of sexs 71:1"} if touched else set())


def test_a_state_that_just_touches_a_limit_is_linearized_as_held_there(npcc):
    wide, tight = (gf.build_model(npcc_with_sexs(npcc, room)) for room in (1000.0, 0.0))
    smooth = touched_held(tight, tight.x0, tight.machines)
    expected = wide.jacobian(wide.x0)
    held = [slot(tight, "exciter_voltage", unit) for unit in LIMITED]
    expected[held] = 0.0
    found = smooth.jacobian(tight.x0)
    assert not found[held].any()
    assert not found[:, held].any()
    expected[:, held] = 0.0
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert touched_held(wide, wide.x0, wide.machines) is wide


def test_what_just_touches_a_limit_is_linearized_as_free_if_it_is_let_go(npcc):
    wide, tight = (gf.build_model(npcc_with_sexs(npcc, room)) for room in (1000.0, 0.0))
    free = touched_let_go(tight, tight.x0, tight.machines)
    np.testing.assert_allclose(free.jacobian(tight.x0), wide.jacobian(wide.x0), atol=1e-9)
    assert touched_let_go(wide, wide.x0, wide.machines) is wide


def test_limits_of_states_give_state_value_and_side(limited):
    found = state_limits(limited, limited.x0, limited.machines, without=["EMIN of sexs 48:1"])
    assert len(found.names) == 2 * len(LIMITED) - 1
    np.testing.assert_allclose(found.beyond(limited.x0), -ROOM)
    for index, name in zip(found.index, found.names, strict=True):
        assert limited.state_names[index] == f"exciter_voltage:{name.rpartition(' ')[2]}"
    x = limited.x0.copy()
    x[slot(limited, "exciter_voltage", "71:1")] += 3 * ROOM
    beyond = dict(zip(found.names, found.beyond(x), strict=True))
    assert beyond["EMAX of sexs 71:1"] == pytest.approx(2 * ROOM)
    assert beyond["EMIN of sexs 71:1"] == pytest.approx(-4 * ROOM)


def test_a_state_that_a_time_constant_of_zero_leaves_idle_is_not_bounded(npcc):
    model = gf.build_model(npcc_with_sexs(npcc, ROOM, ["71:1"], exciter_time=0.0))
    assert state_limits(model, model.x0, model.machines).names == ()
    assert len(limit_names(model, model.machines)) == 2


def test_the_moved_maximum_of_a_commutator_exciter_is_the_sum_of_both_parameters(npcc):
    case = npcc_with_ieeet1(npcc, ROOM, "71:1", regulator_maximum_added=0.25)
    model = gf.build_model(case)
    found = state_limits(model, model.x0, model.machines)
    assert found.names == ("VRMIN of ieeet1 71:1", "VRMAX of ieeet1 71:1")
    np.testing.assert_allclose(found.beyond(model.x0), [-ROOM, -ROOM - 0.25])
    x = model.x0.copy()
    x[found.index[0]] += ROOM + 0.24
    assert limits_acting(model, x, model.machines) == ()
    x[found.index[0]] += 0.02
    assert limits_acting(model, x, model.machines) == ("VRMAX of ieeet1 71:1",)


def test_a_state_that_a_time_constant_of_zero_leaves_idle_is_not_bounded_by_a_limit_that_acts(npcc):
    model = gf.build_model(npcc_with_sexs(npcc, 0.05, ["71:1"], exciter_time=0.0))
    faulted = model.for_state(NetworkState(bus_faults=frozenset({(71, 0j)})))
    assert state_limits(faulted, model.x0, model.machines).names == ()
