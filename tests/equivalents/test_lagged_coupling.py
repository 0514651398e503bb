from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.compare import compare
from gridfold.equivalents.error_budget import error_budget
from gridfold.equivalents.families import reduce_external
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.grid.timeline import build_timeline
from gridfold.numerics.steppers import ScipyReference
from gridfold.partition import partition
from gridfold.reduction import BalancedTruncation, Unreduced

FAULT = [gf.BusFault(3, duration=0.2)]
HYBRID, LINEAR = SwitchingRule(0.0), SwitchingRule(np.inf)


@pytest.fixture(scope="module")
def parts(npcc):
    return partition(npcc, range(1, 37))


@pytest.fixture(scope="module")
def lagged(parts):
    return reduce_external(parts, coupling=BoundaryCoupling.LAGGED)


def worst(npcc, parts, family, rule, step, t_end=4.0):
    stepper = gf.RungeKutta4(step)
    detailed = gf.simulate(npcc, FAULT, t_end, stepper)
    run = simulate_adaptive(npcc, family, rule, FAULT, t_end, stepper).trajectory
    return compare(detailed, run, parts.study_units).worst.rms_deg


def test_with_every_function_kept_the_lag_is_an_error_of_first_order_in_the_step(npcc, parts):
    family = reduce_external(parts, Unreduced(), 0.0, coupling=BoundaryCoupling.LAGGED)
    coarse, fine = (worst(npcc, parts, family, HYBRID, step) for step in (0.02, 0.01))
    assert 0.01 < fine < 0.5
    assert coarse / fine == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("stepper", [gf.RungeKutta4(), gf.AdamsBashforthMoulton4()])
def test_without_a_disturbance_nothing_moves(npcc, lagged, stepper):
    run = simulate_adaptive(npcc, lagged, HYBRID, (), 2.0, stepper).trajectory
    assert np.abs(run.states - npcc.x0).max() < 1e-9


def test_held_voltages_are_those_at_the_end_of_the_previous_step(npcc, parts, lagged):
    x = npcc.x0 + 0.01 * np.random.default_rng(1).standard_normal(npcc.n_states)
    small = lagged.linear(npcc)
    v = small.coordinates.restrict(x)
    x = small.coordinates.lift(v)
    index = [npcc.case.bus_index[bus] for bus in parts.boundary_of_both]
    voltages = npcc.bus_voltages(x[None, :])[0][index]
    at = [k for k, name in enumerate(small.system.state_names) if name.startswith("held_")]
    v[at] = np.concatenate([voltages.real, voltages.imag])
    # Where the held voltages are the true ones, cut and whole network are the same equations.
    exact = reduce_external(parts).linear(npcc)
    w = exact.coordinates.restrict(x)
    free = np.setdiff1d(np.arange(len(v)), at)
    np.testing.assert_allclose(
        small.system.compiled(v)[free], exact.system.compiled(w), rtol=0, atol=1e-8
    )
    assert not small.system.compiled(v)[at].any()


def test_the_linear_run_differs_from_that_with_exact_coupling_by_the_lag(npcc, parts, lagged):
    exact = worst(npcc, parts, reduce_external(parts), LINEAR, 0.01, 16.0)
    late = worst(npcc, parts, lagged, LINEAR, 0.01, 16.0)
    assert late != pytest.approx(exact, rel=0.01)
    assert late == pytest.approx(0.6, abs=0.1)  # degrees, as the literature's prototype


def test_a_fault_on_a_tie_line_acts_as_with_exact_coupling(npcc, parts, lagged):
    """At the instant of the fault the held voltages are those of the faulted network."""
    tie = npcc.case.branches[parts.tie_lines[0].branch]
    fault = gf.BranchFault(f"{tie.from_bus}-{tie.to_bus}", fraction=0.5, reactance=0.01)
    faulted = npcc.for_state(build_timeline(npcc.case, [fault], 1.0)[0].state)
    rates = []
    for family in (lagged, reduce_external(parts)):
        small = family.linear(faulted)
        rates.append(small.system.compiled(small.coordinates.restrict(npcc.x0))[:50])
    np.testing.assert_allclose(rates[0], rates[1], atol=1e-9)
    assert np.abs(rates[0]).max() > 0.1


def test_a_stepper_that_cannot_hold_values_is_refused(npcc, lagged):
    with pytest.raises(OptionError, match="cannot hold values"):
        simulate_adaptive(npcc, lagged, HYBRID, (), 0.1, ScipyReference())


def test_the_budget_names_one_cause_at_a_time(npcc, parts):
    reducer = BalancedTruncation(order=40)
    family = reduce_external(parts, reducer)
    budget = error_budget(family, LINEAR, FAULT, 3.0)
    errors = {row.source: row.error.rms_deg for row in budget.rows}
    assert list(errors) == ["time step", "coupling", "linearization", "truncation", "all"]
    run = simulate_adaptive(npcc, family, LINEAR, FAULT, 3.0).trajectory
    detailed = gf.simulate(npcc, FAULT, 3.0)
    assert errors["all"] == compare(detailed, run, parts.study_units).worst.rms_deg
    assert errors["time step"] < 1e-3 < errors["linearization"]
    finer = error_budget(reduce_external(parts), LINEAR, FAULT, 3.0)
    assert finer.rows[3].error.rms_deg < errors["truncation"] / 10
