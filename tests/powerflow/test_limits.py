"""Set points, reactive limits and switched shunts, against solutions of the written-out equations."""

from dataclasses import replace

import numpy as np
import pytest
from raw_texts import UNITS, raw_text, with_field
from scipy.optimize import root

import gridfold as gf
from gridfold.grid.flow_controls import ShuntControl, ShuntMode, UnitControl
from gridfold.io.powerio_cases import read_network
from gridfold.powerflow.controlled import (
    Controlled,
    Held,
    Solution,
    _balance,
    _control_errors,
    _jacobian,
)
from gridfold.powerflow.limits import with_limits

SLACK = gf.Control.SLACK
LINES = ((1, 2, 0.01, 0.1), (2, 3, 0.01, 0.1), (3, 4, 0.02, 0.15), (1, 4, 0.02, 0.2))


def grid(load_mvar=40.0, controls=(), shunts=(), units=((2, 50.0),), **changes):
    """Four buses in a ring: slack at 1, units, a load at 3."""
    case = gf.Case(
        "ring",
        tuple(gf.Bus(k) for k in (1, 2, 3, 4)),
        tuple(gf.Branch(a, b, "1", r, x, 0.02) for a, b, r, x in LINES),
        (
            gf.Generator(1, control=SLACK),
            *(gf.Generator(bus, active_mw=mw, reactive_mvar=10.0) for bus, mw in units),
        ),
        loads=(gf.Load(3, active_mw=90.0, reactive_mvar=load_mvar),),
        shunts=tuple(shunts),
        flow_controls=(UnitControl(1, "1", 1.02, 1, -999.0, 999.0), *controls),
    )
    return replace(case, **changes)


def unit(bus, set_point, least=-999.0, most=999.0, holds=None, part=100.0):
    return UnitControl(bus, "1", set_point, bus if holds is None else holds, least, most, part)


def solved(case, held=(), reactive=None, shunts=None):
    """Voltages by a general root finder: `held` are (bus, p.u.), `reactive` Mvar by bus made there.

    As many units make what they have to as voltages are held beside that of the slack.
    """
    n, y = 4, np.zeros((4, 4), dtype=complex)
    for a, b, r, x in LINES:
        i, j = a - 1, b - 1
        y[[i, j], [i, j]] += 1 / complex(r, x) + 0.01j
        y[[i, j], [j, i]] -= 1 / complex(r, x)
    for bus, mvar in (shunts or {}).items():
        y[bus - 1, bus - 1] += 1j * mvar / 100
    free = [u.bus for u in case.generators[1:] if u.bus not in (reactive or {})]
    made = np.zeros(n, dtype=complex)
    for load in case.loads:
        made[load.bus - 1] -= complex(load.active_mw, load.reactive_mvar) / 100
    for u in case.generators[1:]:
        made[u.bus - 1] += u.active_mw / 100 + 1j * (reactive or {}).get(u.bus, 0.0) / 100

    def parts(z):
        v = np.array([1.02, *z[3:6]]) * np.exp(1j * np.array([0.0, *z[:3]]))
        given = made.copy()
        for bus, q in zip(free, z[6:], strict=True):
            given[bus - 1] += 1j * q
        return v, given

    def error(z):
        v, given = parts(z)
        balance = (v * np.conj(y @ v) - given)[1:]
        wanted = [abs(v[bus - 1]) - pu for bus, pu in held]
        return np.concatenate([balance.real, balance.imag, wanted])

    found = root(error, [0, 0, 0, 1, 1, 1, *[0.1] * len(free)], tol=1e-13)
    assert found.success
    return parts(found.x)[0], dict(zip(free, found.x[6:] * 100, strict=True))


def stored(case):
    return np.array([b.voltage_pu * np.exp(1j * np.deg2rad(b.angle_deg)) for b in case.buses])


def told(case):
    return " | ".join(case.notices)


def test_units_hold_their_set_points_in_place_of_stored_voltages():
    found = with_limits(grid(controls=[unit(2, 1.03)]))
    voltage, made = solved(grid(), [(2, 1.03)])
    np.testing.assert_allclose(stored(found), voltage, atol=1e-9)
    assert found.generators[1].reactive_mvar == pytest.approx(made[2], abs=1e-6)
    assert found.generators[1].voltage_pu == pytest.approx(1.03, abs=1e-9)
    assert "not the stored one" in found.notices[0]


@pytest.mark.parametrize(("least", "most", "limit"), [(-999.0, 15.0, 15.0), (60.0, 999.0, 60.0)])
def test_a_unit_beyond_a_limit_stays_there_and_lets_its_voltage_go(least, most, limit):
    free = with_limits(grid(controls=[unit(2, 1.03)]))
    assert least < free.generators[1].reactive_mvar < most or limit
    found = with_limits(grid(controls=[unit(2, 1.03, least, most)]))
    voltage, _ = solved(grid(), [], {2: limit})
    np.testing.assert_allclose(stored(found), voltage, atol=1e-9)
    assert (abs(voltage[1]) < 1.03) == (limit == most)
    assert f"at a reactive limit: generator 2:1 {limit:.1f} Mvar" in told(found)


def test_what_is_found_is_a_solution_as_stored_and_stays_when_solved_again():
    case = grid(controls=[unit(2, 1.03, most=15.0)])
    found = with_limits(case)
    np.testing.assert_allclose(gf.solve_power_flow(found).voltage, stored(found), atol=1e-9)
    again = with_limits(replace(found, notices=()))
    np.testing.assert_allclose(stored(again), stored(found), atol=1e-9)
    assert "voltages moved" not in told(again)


def test_a_unit_that_is_stored_at_a_limit_returns_to_its_set_point_where_it_can():
    case = grid(load_mvar=0.0, controls=[unit(2, 1.03, most=40.0)])
    low = tuple(replace(b, voltage_pu=0.95) if b.number == 2 else b for b in case.buses)
    units = (case.generators[0], replace(case.generators[1], reactive_mvar=40.0))
    found = with_limits(replace(case, buses=low, generators=units))
    voltage, _ = solved(case, [(2, 1.03)])
    np.testing.assert_allclose(stored(found), voltage, atol=1e-9)
    assert "at a reactive limit" not in told(found)


def test_a_unit_holds_a_remote_bus():
    found = with_limits(grid(controls=[unit(2, 1.01, holds=3)]))
    voltage, made = solved(grid(), [(3, 1.01)])
    np.testing.assert_allclose(stored(found), voltage, atol=1e-9)
    assert found.generators[1].reactive_mvar == pytest.approx(made[2], abs=1e-6)
    assert abs(stored(found)[1]) != pytest.approx(1.01, abs=1e-3)


def test_plants_that_hold_one_bus_share_by_their_parts_until_one_is_at_a_limit():
    units = ((2, 50.0), (4, 10.0))
    controls = [unit(2, 1.01, holds=3, part=100.0), unit(4, 1.01, holds=3, part=25.0)]
    found = with_limits(grid(controls=controls, units=units))
    first, second = (u.reactive_mvar for u in found.generators[1:])
    assert first == pytest.approx(4 * second, rel=1e-8)
    assert found.buses[2].voltage_pu == pytest.approx(1.01, abs=1e-9)
    limited = [controls[0]._replace(reactive_max_mvar=first - 10), controls[1]]
    case = grid(controls=limited, units=units)
    beside = with_limits(case)
    voltage, made = solved(case, [(3, 1.01)], {2: first - 10})
    np.testing.assert_allclose(stored(beside), voltage, atol=1e-9)
    assert beside.generators[2].reactive_mvar == pytest.approx(made[4], abs=1e-6)


def test_a_swing_unit_beyond_its_limits_is_told_and_not_held():
    case = grid(load_mvar=80.0, controls=[unit(2, 1.0, most=5.0)])
    swing = (UnitControl(1, "1", 1.02, 1, -10.0, 20.0), *case.flow_controls[1:])
    found = with_limits(replace(case, flow_controls=swing))
    voltage, _ = solved(case, [], {2: 5.0})
    np.testing.assert_allclose(stored(found), voltage, atol=1e-9)
    assert "generator 1:1 balances with" in told(found)
    assert "beyond its limits of -10 to 20 Mvar" in told(found)


def shunt(mode, low, high, blocks, holds=3):
    return ShuntControl(3, "S1", mode, low, high, holds, blocks)


def with_shunt(mode, low, high, blocks, start=0.0, holds=3):
    return grid(
        load_mvar=60.0,
        controls=[unit(2, 1.08, most=20.0), shunt(mode, low, high, blocks, holds)],
        shunts=[gf.Shunt(3, "S1", susceptance_mvar=start)],
    )


def voltage_with(mvar, bus=3):
    return abs(solved(grid(load_mvar=60.0), [], {2: 20.0}, {3: mvar})[0][bus - 1])


def test_a_discrete_shunt_takes_the_first_step_that_brings_its_voltage_into_the_band():
    steps = [12.0 * k for k in range(7)]
    low = (voltage_with(steps[2]) + voltage_with(steps[3])) / 2
    case = with_shunt(ShuntMode.DISCRETE, low, low + 0.05, ((6, 12.0),))
    found = with_limits(case)
    assert found.shunts[0].susceptance_mvar == 36.0
    assert found.buses[2].voltage_pu == pytest.approx(voltage_with(36.0), abs=1e-8)
    assert "switched shunts moved: 3:S1 0.00 to 36.00 Mvar" in told(found)


def test_a_discrete_shunt_goes_down_through_its_reactors():
    high = (voltage_with(-10.0) + voltage_with(0.0)) / 2
    case = with_shunt(ShuntMode.DISCRETE, 0.8, high, ((2, 15.0), (2, -10.0)), start=30.0)
    assert with_limits(case).shunts[0].susceptance_mvar == -10.0


def test_a_discrete_shunt_may_hold_a_remote_bus():
    low = (voltage_with(0.0, 4) + voltage_with(15.0, 4)) / 2
    found = with_limits(with_shunt(ShuntMode.DISCRETE, low, 1.2, ((3, 15.0),), holds=4))
    assert found.shunts[0].susceptance_mvar == 15.0


@pytest.mark.parametrize(("start", "edge"), [(0.0, 0), (80.0, 1)])
def test_a_continuous_shunt_brings_its_voltage_to_the_edge_of_the_band(start, edge):
    band = (voltage_with(30.0), voltage_with(45.0))
    found = with_limits(with_shunt(ShuntMode.CONTINUOUS, *band, ((4, 25.0),), start))
    assert found.buses[2].voltage_pu == pytest.approx(band[edge], abs=1e-9)
    assert found.shunts[0].susceptance_mvar == pytest.approx((30.0, 45.0)[edge], abs=1e-5)


def test_a_continuous_shunt_ends_at_its_largest_susceptance():
    found = with_limits(with_shunt(ShuntMode.CONTINUOUS, 1.1, 1.1, ((2, 25.0),)))
    assert found.shunts[0].susceptance_mvar == pytest.approx(50.0, abs=1e-9)
    assert found.buses[2].voltage_pu == pytest.approx(voltage_with(50.0), abs=1e-8)


def test_within_the_band_a_shunt_stays_as_stored():
    found = with_limits(with_shunt(ShuntMode.DISCRETE, 0.9, 1.1, ((4, 25.0),), start=7.0))
    assert found.shunts[0].susceptance_mvar == 7.0


@pytest.mark.parametrize("mode", [ShuntMode.LOCKED, ShuntMode.OTHER])
def test_a_locked_shunt_stays_as_stored(mode):
    assert with_limits(with_shunt(mode, 1.1, 1.1, ((4, 25.0),))).shunts[0].susceptance_mvar == 0.0


def test_a_shunt_between_two_steps_stays_and_is_told():
    middle = (voltage_with(25.0) + voltage_with(50.0)) / 2
    case = with_shunt(ShuntMode.DISCRETE, middle - 1e-4, middle + 1e-4, ((4, 25.0),))
    found = with_limits(case)
    assert found.shunts[0].susceptance_mvar == 50.0
    assert "hunt between two steps, and stay: 3:S1" in told(found)


def test_where_a_plant_holds_the_voltage_its_shunts_stay():
    case = with_shunt(ShuntMode.DISCRETE, 1.05, 1.06, ((4, 25.0),))
    case = replace(
        case, flow_controls=(*case.flow_controls[:1], unit(2, 1.0, holds=3), case.flow_controls[2])
    )
    found = with_limits(case)
    assert found.shunts[0].susceptance_mvar == 0.0
    assert found.buses[2].voltage_pu == pytest.approx(1.0, abs=1e-9)


def test_levels_are_steps_in_order_from_all_reactors_to_all_capacitors():
    control = shunt(ShuntMode.DISCRETE, 0.9, 1.1, ((2, 10.0), (1, -5.0), (1, 30.0), (2, -20.0)))
    assert control.levels == (-45.0, -25.0, -5.0, 0.0, 10.0, 20.0, 50.0)


def test_joined_buses_and_several_swing_buses_are_solved_too():
    case = grid(controls=[unit(2, 1.03)])
    split = replace(
        case,
        buses=(*case.buses, gf.Bus(20)),
        branches=(*case.branches, gf.Branch(2, 20)),
        generators=(case.generators[0], replace(case.generators[1], bus=20)),
        flow_controls=(case.flow_controls[0], unit(20, 1.03)),
    )
    found = with_limits(split)
    np.testing.assert_allclose(stored(found)[:4], stored(with_limits(case)), atol=1e-9)
    swings = (case.generators[0], replace(case.generators[1], control=SLACK))
    turned = tuple(replace(b, angle_deg=3.0) if b.number == 2 else b for b in case.buses)
    both = with_limits(replace(case, generators=swings, buses=turned))
    assert stored(both)[1] == pytest.approx(1.03 * np.exp(1j * np.deg2rad(3.0)), abs=1e-9)


def test_without_set_points_and_limits_there_is_nothing_to_solve_by():
    with pytest.raises(gf.OptionError, match="gives no set points and limits"):
        with_limits(replace(grid(), flow_controls=()))


def test_an_operating_point_that_is_not_there_is_an_error_that_names_buses():
    with pytest.raises(gf.PowerFlowError, match=r"no operating point was found.*\n  bus \d: "):
        with_limits(grid(load_mvar=900.0, controls=[unit(2, 1.0, most=10.0)]))


@pytest.mark.parametrize(
    ("control", "fault"),
    [
        (unit(2, 0.0), "generator 2:1: the set point must be positive, not 0 p.u."),
        (
            unit(2, 1.0, 5.0, -5.0),
            "generator 2:1: the least reactive power 5 Mvar is above the most -5",
        ),
        (unit(2, 1.0, part=-1.0), "generator 2:1: its part RMPCT must be positive, not -1"),
        (
            ShuntControl(3, "S1", ShuntMode.DISCRETE, 1.05, 0.95, 3),
            "shunt 3:S1: its band of 1.05 to 0.95 p.u. is none",
        ),
    ],
)
def test_set_points_and_limits_that_cannot_be_meant_are_all_told(control, fault):
    case = grid(controls=[control], shunts=[gf.Shunt(3, "S1")])
    with pytest.raises(gf.CaseError) as raised:
        with_limits(case)
    assert raised.value.faults == [fault]
    out = tuple(replace(u, in_service=u.bus == 1) for u in case.generators)
    without = replace(case, generators=out, shunts=(gf.Shunt(3, "S1", in_service=False),))
    assert "not the stored one" in told(with_limits(without))


def test_a_regulated_bus_that_is_not_there_is_told_and_the_own_one_held():
    found = with_limits(grid(controls=[unit(2, 1.03, holds=99)]))
    assert found.buses[1].voltage_pu == pytest.approx(1.03, abs=1e-9)
    assert "out of reach, so that the own one is held: 2:1 (99)" in told(found)


def test_of_plants_that_hold_one_bus_at_two_voltages_the_first_counts_and_is_told():
    controls = [unit(2, 1.01, holds=3), unit(4, 1.04, holds=3)]
    found = with_limits(grid(controls=controls, units=((2, 50.0), (4, 10.0))))
    assert found.buses[2].voltage_pu == pytest.approx(1.01, abs=1e-9)
    assert "generator 4:1 holds 1.01 p.u. in place of 1.04, with generator 2:1" in told(found)


def test_the_jacobian_is_that_of_differences():
    rng = np.random.default_rng(3)
    y = rng.normal(size=(4, 4)) + 1j * rng.normal(size=(4, 4))
    from scipy.sparse import csc_array

    held = (
        Held(0, 0, 1.0, None),
        Held(1, 3, 1.0, None, 2.0),
        Held(2, 3, 1.0, None, 5.0),
        Held(3, 3, 1.0, 0.2, is_shunt=True),
        Held(2, 2, 0.9, None, is_shunt=True),
    )
    swing = np.array([True, False, False, False])
    problem = Controlled(csc_array(y), lambda v: np.full(4, 0.1 + 0.2j), swing, held)
    free = np.array([1, 2, 3])
    z = np.concatenate([rng.normal(size=3), 1 + 0.1 * rng.normal(size=4), rng.normal(size=5)])

    def residual(z):
        angle = np.array([0.0, *z[:3]])
        voltage = z[3:7] * np.exp(1j * angle)
        error = _balance(problem, voltage, z[7:])
        own = _control_errors(problem, z[3:7], z[7:])
        return np.concatenate([error[free].real, error.imag, own])

    step = 1e-6
    numeric = np.array(
        [(residual(z + step * e) - residual(z - step * e)) / (2 * step) for e in np.eye(12)]
    ).T
    voltage = z[3:7] * np.exp(1j * np.array([0.0, *z[:3]]))
    np.testing.assert_allclose(
        _jacobian(problem, voltage, z[7:], free).toarray(), numeric, atol=1e-8
    )
    assert Solution(voltage, z[7:], voltage, converged=False).voltage.shape == (4,)


def test_a_raw_file_gives_set_points_limits_remote_buses_and_shunts(tmp_path):
    units = (
        with_field(UNITS[0], 6, "1.01"),
        with_field(with_field(with_field(UNITS[1], 4, "25.0"), 5, "-15.0"), 7, "5"),
    )
    switched = (
        "3,0,0,1,1.05,0.95,0,100,'',30,2,20,1,-10",
        "4,2,0,1,1.05,0.95,5,90,'',30,2,20,1,-10",
        "5,3,0,1,1.05,0.95,0,100,'',30,2,20,1,-10",
    )
    path = tmp_path / "five.raw"
    path.write_text(raw_text({"GENERATOR": units, "SWITCHED SHUNT": switched}))
    by_place = {(c.bus, c.id): c for c in read_network(path).flow_controls}
    assert by_place[1, "1"] == UnitControl(1, "1", 1.01, 1, -200.0, 200.0, 100.0)
    assert by_place[2, "1"] == UnitControl(2, "1", 1.01, 5, -15.0, 25.0, 100.0)
    blocks = ((2, 20.0), (1, -10.0))
    assert by_place[4, "S1"] == ShuntControl(4, "S1", ShuntMode.CONTINUOUS, 0.95, 1.05, 5, blocks)
    assert by_place[3, "S1"].mode is ShuntMode.LOCKED
    assert by_place[5, "S1"].mode is ShuntMode.OTHER
    found = gf.load_case(path, solve="limits")
    assert found.buses[0].voltage_pu == pytest.approx(1.01, abs=1e-9)
    assert "generator 2:1 25.0 Mvar" in told(found)
    plain = gf.load_case(path)
    assert plain == read_network(path) == gf.load_case(path, solve="stored")
    with pytest.raises(gf.OptionError, match="solve must be one of stored, limits, not 'flat'"):
        gf.load_case(path, solve="flat")
    with pytest.raises(gf.OptionError, match="case npcc gives no set points"):
        gf.load_case("npcc", solve="limits")
