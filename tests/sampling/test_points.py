"""Operating points: powers add up as the plan says, and nothing else moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gridfold as gf
from gridfold.dynamics.registry import DEVICES
from gridfold.sampling.plan import SamplePlan
from gridfold.sampling.points import OperatingPoints

FACTORS = st.floats(0.8, 1.2)


@pytest.fixture(scope="module")
def case():
    return gf.load_case("npcc")


def points(case, **tables):
    plan = SamplePlan.model_validate(
        {"samples": 1, "seed": 0, "faults": {"bus_faults": "1"}, **tables}
    )
    return OperatingPoints.of(plan, case, DEVICES)


def load_mw(case, inside=lambda bus: True):
    return sum(item.active_mw for item in case.loads if inside(item.bus))


def power(case, inside=lambda bus: True):
    return sum(unit.active_mw for unit in case.generators if inside(unit.bus))


def slack_buses(case):
    return {unit.bus for unit in case.generators if unit.control is gf.Control.SLACK}


@given(FACTORS, FACTORS)
def test_loads_keep_their_power_factor_and_units_take_up_the_difference(case, west, rest):
    made = points(
        case,
        load=[
            {"name": "west", "where": "1-36", "factor": 1.0},
            {"name": "rest", "where": "all except 1-36", "factor": 1.0},
        ],
    ).case_at({"west": west, "rest": rest})
    for old, new in zip(case.loads, made.loads, strict=True):
        factor = west if old.bus <= 36 else rest
        assert new.active_mw == pytest.approx(old.active_mw * factor)
        assert new.reactive_mvar == pytest.approx(old.reactive_mvar * factor)
    assert power(made) - power(case) == pytest.approx(load_mw(made) - load_mw(case), abs=1e-6)
    slack = slack_buses(case)
    for old, new in zip(case.generators, made.generators, strict=True):
        if old.bus in slack or old.active_mw <= 0:
            assert new == old


@given(st.floats(-200, 200))
def test_a_change_is_shared_in_proportion_and_taken_up_by_others(case, change):
    made = points(case, generation=[{"name": "moved", "where": "1-36", "change_mw": 0.0}]).case_at(
        {"moved": change}
    )
    moved = [
        new.active_mw / old.active_mw
        for old, new in zip(case.generators, made.generators, strict=True)
        if old.bus <= 36 and old.active_mw > 0 and old.bus not in slack_buses(case)
    ]
    assert np.ptp(moved) == pytest.approx(0.0, abs=1e-12)
    assert power(made, lambda bus: bus <= 36) - power(case, lambda bus: bus <= 36) == pytest.approx(
        change, abs=1e-6
    )
    assert power(made) == pytest.approx(power(case), abs=1e-6)


def test_without_sharing_units_the_slack_takes_it(case):
    made = points(case, load=[{"name": "all", "factor": 1.0}], balance={"units": "none"}).case_at(
        {"all": 1.1}
    )
    assert made.generators == case.generators
    assert load_mw(made) == pytest.approx(1.1 * load_mw(case))


def test_a_unit_that_would_give_less_than_nothing_is_named(case):
    found = points(case, load=[{"name": "all", "factor": 1.0}], balance={"units": "21"})
    with pytest.raises(gf.EventError, match=r"generator 21:1 would give -.* less than nothing"):
        found.case_at({"all": 0.5})


def test_parameters_are_those_of_the_chosen_units_alone(case):
    made = points(
        case,
        parameter=[
            {"name": "h", "where": "21-23", "parameter": "inertia", "factor": 1.0},
            {"name": "d", "where": "21", "parameter": "damping", "value": 1.0},
        ],
    ).case_at({"h": 0.5, "d": 3.0})
    for old, new in zip(case.devices, made.devices, strict=True):
        if old.model == "two_axis" and 21 <= old.bus <= 23:
            assert new.parameters["inertia"] == 0.5 * old.parameters["inertia"]
            assert (new.parameters.get("damping") == 3.0) == (new.bus == 21)
        else:
            assert new is old


def test_what_nothing_changes_is_the_case(case):
    assert points(case, load=[{"name": "all", "factor": 1.0}]).case_at({"all": 1.0}) == case


def test_all_that_is_not_in_the_case_is_told_at_once(case):
    with pytest.raises(gf.OptionError) as caught:
        points(
            case,
            load=[{"where": "9999", "factor": 1.0}],
            generation=[{"where": str(min(slack_buses(case))), "factor": 1.0}],
            parameter=[
                {"parameter": "inertias", "factor": 1.0},
                {"parameter": "inertia", "model": "genrou", "factor": 1.0},
            ],
            balance={"units": "area:77"},
        )
    text = str(caught.value)
    assert "load 1, where: " in text
    assert "generation 1, where: " in text
    assert "slack" in text
    assert "parameter 1, where: " in text
    assert "did you mean 'inertia'?" in text
    assert "parameter 2, where: no device genrou there has a parameter 'inertia'" in text
    assert "balance.units: " in text
