"""A model moved to another operating point is the one that is built there, to the last digit."""

import re
from dataclasses import replace

import numpy as np
import pytest
from limited_cases import npcc_with_sexs

import gridfold as gf
from gridfold.dynamics.network.loads import LoadModel
from gridfold.grid.operating_point import at_operating_point
from gridfold.powerflow.network import FlowNetwork


def heavier(case, factor):
    loads = [
        replace(load, active_mw=load.active_mw * factor, reactive_mvar=load.reactive_mvar * factor)
        for load in case.loads
    ]
    units = [replace(unit, active_mw=unit.active_mw * factor) for unit in case.generators]
    return at_operating_point(case, loads, units)


def same(moved, built):
    assert np.array_equal(moved.x0, built.x0)
    assert np.array_equal(moved.constants, built.constants)
    for first, second in zip(moved.layout.blocks, built.layout.blocks, strict=True):
        assert np.array_equal(first.parameters, second.parameters, equal_nan=True)
        assert np.array_equal(first.inputs, second.inputs)
    x = built.x0 + 0.01
    assert np.array_equal(moved.compiled(x), built.compiled(x), equal_nan=True)


@pytest.mark.parametrize("shares", ["z", "0.3,0.2,0.5"])
def test_loads_and_generation_move(npcc, shares):
    loads = LoadModel.parse(shares)
    base = npcc if shares == "z" else gf.build_model(npcc.case, loads=loads)
    case = heavier(npcc.case, 1.03)
    same(base.at(gf.solve_power_flow(case)), gf.build_model(case, loads=loads))


def test_a_moved_model_moves_again_from_where_it_was_built(npcc):
    there = npcc.at(gf.solve_power_flow(heavier(npcc.case, 1.05)))
    same(there.at(gf.solve_power_flow(npcc.case)), npcc)


def test_parameters_move(npcc):
    records = [
        replace(
            record, parameters={**record.parameters, "inertia": record.parameters["inertia"] / 2}
        )
        if record.model == "two_axis"
        else record
        for record in npcc.case.devices
    ]
    case = at_operating_point(npcc.case, devices=records)
    same(npcc.at(gf.solve_power_flow(case)), gf.build_model(case))


def test_a_wrong_parameter_is_named(npcc):
    records = list(npcc.case.devices)
    at = next(k for k, record in enumerate(records) if record.model == "two_axis")
    wrong = records[at]
    records[at] = replace(wrong, parameters={**wrong.parameters, "inertia": -1.0})
    case = at_operating_point(npcc.case, devices=records)
    with pytest.raises(gf.CaseError, match=f"{wrong.key} .*inertia must be positive, not -1"):
        npcc.at(gf.solve_power_flow(case))


def test_limits_are_those_of_the_case_wherever_the_model_was_before(npcc):
    """A limit that one operating point has moved is not the one that the next one starts with."""
    case = npcc_with_sexs(npcc, room=0.05)
    model = gf.build_model(case, on_limit=gf.OnLimit.ADJUST)
    heavy = heavier(case, 1.1)
    there = model.at(gf.solve_power_flow(heavy))
    assert there.limits_moved
    same(there, gf.build_model(heavy, on_limit=gf.OnLimit.ADJUST))
    same(there.at(gf.solve_power_flow(case)), model)


@pytest.mark.parametrize("on_limit", list(gf.OnLimit))
def test_starts_that_are_solved_for_together_are_those_of_each_point(npcc, on_limit):
    case = npcc_with_sexs(npcc, room=0.03)
    model = gf.build_model(case, on_limit=on_limit)
    flows = [gf.solve_power_flow(heavier(case, factor)) for factor in (1.0, 1.002, 1.1, 0.998)]
    found = model.at_each(flows)
    assert len(found) == 4
    for flow, item in zip(flows, found, strict=True):
        if isinstance(item, gf.InitializationError):
            with pytest.raises(gf.InitializationError, match=re.escape(str(item))):
                model.at(flow)
            continue
        alone = model.at(flow)
        assert item.power_flow is flow
        assert np.abs(item.x0 - alone.x0).max() < 1e-12
        assert item.limits_moved == alone.limits_moved
        for first, second in zip(item.layout.blocks, alone.layout.blocks, strict=True):
            assert first.units == second.units
            assert first.parameters == pytest.approx(second.parameters, abs=1e-12, nan_ok=True)
    refused = sum(isinstance(item, gf.InitializationError) for item in found)
    assert refused == (on_limit is gf.OnLimit.ERROR)


def test_a_power_flow_on_a_known_network_is_the_same(npcc):
    case = heavier(npcc.case, 0.97)
    known = gf.solve_power_flow(case, network=FlowNetwork.of(npcc.case))
    assert np.array_equal(known.voltage, gf.solve_power_flow(case).voltage)


def test_what_is_known_of_a_case_goes_with_its_network_alone(npcc):
    _ = npcc.case.fingerprint, npcc.case.bus_index
    moved = heavier(npcc.case, 1.01)
    assert moved.bus_index is npcc.case.bus_index
    assert moved.fingerprint != npcc.case.fingerprint
