from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from area_cases import Unreduced

import gridfold as gf
from gridfold.dynamics.network.loads import BREAK_VOLTAGE, NonlinearLoads
from gridfold.equivalents.families import reduce_external
from gridfold.numerics.implicit import numerical_jacobian
from gridfold.partition import partition

MODELS = ["1,0,0", "0,1,0", "0.3,0.3,0.4"]
FAULT = [gf.BusFault(3, duration=0.1)]


@pytest.fixture(scope="module", params=MODELS)
def shares(request):
    return gf.LoadModel.parse(request.param)


@pytest.fixture(scope="module")
def model(npcc, shares):
    return gf.build_model(npcc.case, npcc.power_flow, loads=shares)


def drawn_by_loads(model, run):
    """Power into the loads of each bus along a run: what branches, shunts and machines leave."""
    case, flow = model.case, model.power_flow
    v = run.bus_voltage()
    y = gf.grid.admittance.bus_admittance(case)
    power = -v * np.conj((y @ v.T).T)
    for unit in run.model.layout.source_units:
        p, q = (run.signal(name, [unit])[:, 0] for name in ("active_power", "reactive_power"))
        power[:, case.bus_index[unit.bus]] += p + 1j * q
    for unit, admittance in model.injections.negative_load.items():
        at = case.bus_index[unit.bus]
        power[:, at] -= np.conj(admittance) * np.abs(v[:, at]) ** 2
    return v, power, flow


def test_loads_draw_what_their_shares_say_along_a_run(model, shares):
    run = gf.simulate(model, FAULT, 1.0)
    v, power, flow = drawn_by_loads(model, run)
    after = run.times > 0.1
    m, m_0 = np.abs(v[after]), np.abs(flow.voltage)
    assert m.min() > BREAK_VOLTAGE
    p, i, z = shares.shares
    wanted = flow.load_power * (p + i * m / m_0 + z * (m / m_0) ** 2)
    np.testing.assert_allclose(power[after], wanted, rtol=0, atol=1e-7)


def test_the_start_is_an_equilibrium(model):
    assert np.abs(model.compiled(model.x0)).max() < 1e-10


def test_the_jacobian_has_the_slopes_of_the_loads(model):
    x = model.x0 + 0.02 * np.random.default_rng(3).standard_normal(model.n_states)
    difference = model.jacobian(x) - numerical_jacobian(model.compiled, x)
    assert np.abs(difference).max() < 1e-5


def test_dense_and_sparse_solutions_are_the_same(npcc, shares):
    dense, sparse = (
        gf.build_model(npcc.case, npcc.power_flow, backend, loads=shares)
        for backend in (gf.NetworkBackend.DENSE, gf.NetworkBackend.SPARSE)
    )
    x = npcc.x0 + 0.05 * np.random.default_rng(2).standard_normal(npcc.n_states)
    np.testing.assert_allclose(dense.compiled(x), sparse.compiled(x), rtol=0, atol=1e-8)


def test_shares_of_the_case_are_taken_as_they_are(npcc, shares):
    p, i, z = shares.shares
    flow, loads = npcc.power_flow, []
    for load in npcc.case.loads:
        m = abs(flow.voltage[npcc.case.bus_index[load.bus]])
        fields = {}
        for name, share, scale in (("current", i, m), ("impedance", z, m**2)):
            fields[f"{name}_active_mw"] = share * load.active_mw / scale
            fields[f"{name}_reactive_mvar"] = share * load.reactive_mvar / scale
        own = {"active_mw": p * load.active_mw, "reactive_mvar": p * load.reactive_mvar}
        loads.append(replace(load, **own, **fields))
    raw = gf.build_model(replace(npcc.case, loads=tuple(loads)), loads=gf.LoadModel(None))
    given = gf.build_model(npcc.case, npcc.power_flow, loads=shares)
    x = npcc.x0 + 0.05 * np.random.default_rng(2).standard_normal(npcc.n_states)
    np.testing.assert_allclose(raw.compiled(x), given.compiled(x), rtol=0, atol=1e-7)


def test_a_linearized_external_area_has_the_slopes_of_its_loads(model):
    parts = partition(model, range(1, 37))
    everything = reduce_external(parts, Unreduced(), column_norm=0.0)
    x = model.x0 + 0.03 * np.random.default_rng(4).standard_normal(model.n_states)
    small = everything.hybrid(model)
    v = small.coordinates.restrict(x)
    rate = small.coordinates.lift(v + small.system.compiled(v)) - x
    np.testing.assert_allclose(rate, model.compiled(x), rtol=0, atol=1e-6)
    linear = reduce_external(parts, Unreduced()).linear(model)
    v0 = linear.coordinates.restrict(model.x0)
    slope = numerical_jacobian(linear.system.compiled, v0)
    lift = np.array([linear.coordinates.lift(v0 + row) - model.x0 for row in np.eye(len(v0))]).T
    np.testing.assert_allclose(model.jacobian(model.x0) @ lift, lift @ slope, atol=2e-5)


def test_slopes_equal_differences_on_both_sides_of_the_break_voltage():
    power = np.array([[1 + 0.5j, 0.3, 0.2j], [0.2j, 0.4 - 0.1j, 0.3]])
    loads = NonlinearLoads((1, 2), np.array([0.0, 1.0, 2.7]), power, np.ones(2))
    for size in (0.3, 0.69, 0.71, 1.05):
        v, h = size * np.exp(1j * np.array([0.3, -2.0])), 1e-7
        for column, turn in enumerate((1.0, 1j)):
            rate = (loads.currents(v + h * turn) - loads.currents(v - h * turn)) / (2 * h)
            found = loads.slopes(v)[:, :, column]
            np.testing.assert_allclose(found[:, 0] + 1j * found[:, 1], rate, atol=1e-6)


def test_below_the_break_voltage_a_load_is_an_impedance():
    power = np.array([[1 + 0.5j, 0.3, -0.2j]])
    loads = NonlinearLoads((1,), np.array([0.0, 1.0, 1.4]), power, np.ones(1))
    low, lower = (loads.currents(np.array([v + 0j])) for v in (0.6, 0.3))
    np.testing.assert_allclose(low, 2 * lower, rtol=1e-12)


def test_a_solid_fault_leaves_a_load_without_voltage_and_current(model):
    run = gf.simulate(model, [gf.BusFault(20, duration=0.02)], 0.5)
    assert run.status is gf.Status.COMPLETED


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("0.5,0.5", "P,I,Z"),
        ("a,b,c", "P,I,Z"),
        ("0.5,0.6,0.2", "add up to 1.3"),
        ("1.5,-0.5,0", "from 0 to 1"),
    ],
)
def test_wrong_shares_are_refused(text, match):
    with pytest.raises(gf.OptionError, match=match):
        gf.LoadModel.parse(text)


def test_a_strained_grid_of_constant_power_keeps_a_solution():
    """30 percent more load and generation than in the files; voltages fall far below the break."""
    folder = Path(__file__).parents[2] / "examples" / "psse_study"
    case = gf.load_case(folder / "two_areas.raw", folder / "two_areas.dyr")
    parts = ("active_mw", "current_active_mw", "impedance_active_mw")
    loads = [replace(u, **{k: 1.3 * getattr(u, k) for k in parts}) for u in case.loads]
    units = [replace(g, active_mw=1.3 * g.active_mw) for g in case.generators]
    strained = replace(case, loads=tuple(loads), generators=tuple(units))
    shares = gf.LoadModel.parse("1,0,0")
    model = gf.build_model(strained, loads=shares, on_limit=gf.OnLimit.ADJUST)
    lowest = np.inf
    for bus in (11, 21, 23):
        run = gf.simulate(model, [gf.BusFault(bus, duration=0.2)], 3.0)
        assert run.status is not gf.Status.NOT_FINITE
        v, power, flow = drawn_by_loads(model, run)
        after = run.times > 0.2
        m = np.abs(v[after])
        low = np.minimum(m / BREAK_VOLTAGE, 1.0)
        np.testing.assert_allclose(power[after], flow.load_power * low**2, rtol=0, atol=1e-7)
        lowest = min(lowest, m.min())
    assert lowest < BREAK_VOLTAGE
