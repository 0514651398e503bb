"""Reduced models of systems with PSS/E devices: an own small case, and the public ones at hand."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from row_of_areas import row_of_areas
from scipy.linalg import expm

import gridfold as gf
from gridfold.equivalents.families import Mode, ModelFamily
from gridfold.partition import linearize_external
from gridfold.runs.loading import load_psse
from gridfold.simulation import Segment, run_segments
from gridfold.systems.modal import ModalSystem

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
TOLERANCE, T_END = 1e-2, 5.0
DETAILED, LINEAR, HYBRID = Mode.DETAILED, Mode.LINEAR, Mode.HYBRID
LINEAR_ONLY, HYBRID_ONLY = gf.SwitchingRule(float("inf")), gf.SwitchingRule(0.0)


def public(raw: str, dyr: str, **options: object) -> gf.Case:
    for path in (CASES / raw, CASES / dyr):
        if not path.is_file():
            pytest.skip(f"{path} is absent; GRIDFOLD_CASES names the folder of public cases")
    return load_psse(CASES / raw, CASES / dyr, **options).case


def kundur() -> gf.Case:
    return public("kundur/kundur.raw", "kundur/kundur_full.dyr")


def npcc_conversion() -> gf.Case:
    return public("npcc/npcc_curent.raw", "npcc/npcc_curent.dyr")


def new_england() -> gf.Case:
    return public(
        "ieee39/IEEE39.raw",
        "ieee39/IEEE39.dyr",
        unsupported="drop",
        allow_unsupported_network=True,
    )


@dataclass(frozen=True)
class System:
    """A case, its study area (area 1 where no buses are given), a fault, and the largest order."""

    load: Callable[[], gf.Case]
    fault: gf.BusFault
    order: int
    buses: tuple[int, ...] = ()


SYSTEMS = {
    "own": System(row_of_areas, gf.BusFault(15, duration=0.05), 26),
    "kundur": System(kundur, gf.BusFault(7, duration=0.1), 18),
    "npcc": System(npcc_conversion, gf.BusFault(23, duration=0.1), 125),
    "ieee39": System(
        new_england,
        gf.BusFault(16, duration=0.1),
        40,
        (15, 16, 19, 20, 21, 22, 23, 24, 33, 34, 35, 36),
    ),
}
ALL = pytest.mark.parametrize("name", SYSTEMS)


@cache
def parts_of(name: str) -> gf.Partition:
    system = SYSTEMS[name]
    model = gf.build_model(system.load())
    area = [bus.number for bus in model.case.buses if bus.area == 1]
    return gf.partition(model, system.buses or area)


@cache
def detailed(name: str) -> gf.Trajectory:
    run = gf.simulate(parts_of(name).model, [SYSTEMS[name].fault], T_END)
    assert run.status is gf.Status.COMPLETED
    return run


@cache
def reduced(name: str) -> gf.SmallModels:
    return gf.SmallModels(gf.reduce(parts_of(name), gf.BalancedTruncation(tolerance=TOLERANCE)))


@cache
def whole(name: str) -> gf.SmallModels:
    return gf.SmallModels(gf.whole_system(parts_of(name)))


def run_of(name: str, small: gf.SmallModels | ModelFamily, rule: gf.SwitchingRule):
    return gf.simulate_adaptive(parts_of(name).model, small, rule, [SYSTEMS[name].fault], T_END)


def rms_deg(name: str, run) -> float:
    return gf.compare(detailed(name), run.trajectory, parts_of(name).study_units).worst.rms_deg


def modes(run) -> set[Mode]:
    return {switch.after for switch in run.switches}


@ALL
def test_with_all_machines_nonlinear_and_nothing_reduced_a_run_is_the_detailed_one(name):
    family = gf.reduce(parts_of(name), gf.Unreduced(), column_norm=0.0)
    run = run_of(name, family, HYBRID_ONLY)
    assert modes(run) == {DETAILED, HYBRID}
    errors = gf.compare(detailed(name), run.trajectory)
    assert max(unit.largest_deg for unit in errors.units) < 1e-8


@ALL
def test_whole_hybrid_with_all_machines_nonlinear_is_the_detailed_run(name):
    run = run_of(name, gf.whole_system(parts_of(name), column_norm=0.0), HYBRID_ONLY)
    assert rms_deg(name, run) < 1e-8


#: Largest RMS errors in degrees: linear, hybrid, adaptive beyond 5 degrees, adaptive whole.
@pytest.mark.parametrize(
    ("name", "linear", "hybrid", "adaptive", "adaptive_whole"),
    [
        ("own", 3.6, 1.9, 1.9, 1.4),
        ("kundur", 2.0, 0.6, 2.0, 1.5),
        ("npcc", 0.7, 0.9, 0.9, 1.1),
    ],
)
def test_reduced_and_adaptive_runs_follow_the_detailed_one(
    name, linear, hybrid, adaptive, adaptive_whole
):
    runs = [
        (linear, run_of(name, reduced(name), LINEAR_ONLY), {LINEAR}),
        (hybrid, run_of(name, reduced(name), HYBRID_ONLY), {HYBRID}),
        (adaptive, run_of(name, reduced(name), gf.SwitchingRule(5.0)), {LINEAR, HYBRID}),
        (adaptive_whole, run_of(name, whole(name), gf.SwitchingRule(5.0)), {LINEAR, HYBRID}),
    ]
    for limit_deg, run, used in runs:
        assert run.trajectory.status is gf.Status.COMPLETED
        assert modes(run) <= used | {DETAILED}
        assert rms_deg(name, run) < limit_deg


@ALL
def test_the_order_is_far_below_the_external_states_and_the_bound_holds(name):
    family, parts = reduced(name).family, parts_of(name)
    full, small = linearize_external(parts).system, family.reduction.system
    assert small.n <= SYSTEMS[name].order < 0.7 * full.n
    assert family.reduction.bound <= TOLERANCE
    s = 1j * np.logspace(-3, 3, 60)
    difference = full.transfer(s) - small.transfer(s)
    error = np.linalg.norm(difference, 2, axis=(1, 2)).max()
    assert error <= family.reduction.bound * (1 + 1e-6)


def test_a_growing_mode_of_the_external_area_is_kept_exactly():
    model = parts_of("npcc").model
    mode = gf.small_signal(model).rightmost
    assert 0.011 < mode.real < 0.012
    assert mode.imag == 0
    other = gf.partition(model, [bus.number for bus in model.case.buses if bus.area == 2])
    reduction = gf.reduce(other, gf.BalancedTruncation(tolerance=TOLERANCE)).reduction
    assert reduction.kept_exactly == 1
    assert abs(reduction.system.poles - mode).min() < 1e-9


def test_rate_limits_that_act_at_once_keep_the_detailed_model_in_use():
    """A speed deviation of 1e-4 is enough for the gates of IEEEG1 in the New England case."""
    run = run_of("ieee39", reduced("ieee39"), LINEAR_ONLY)
    assert modes(run) == {DETAILED}
    assert "ieeeg1" in run.switches[-1].reason
    assert rms_deg("ieee39", run) < 1e-8
    blind = run_of("ieee39", reduced("ieee39"), replace(LINEAR_ONLY, limits=False))
    assert any("no limit here" in notice.text for notice in blind.trajectory.notices)
    assert 1.0 < rms_deg("ieee39", blind) < 12.0


def test_limits_of_kept_machines_count_where_the_area_is_reduced():
    """What a limit does passes through the reduction; without one the kept machine is as it is."""
    parts = parts_of("own")
    model = parts.model
    for reducer, watched in (
        (gf.BalancedTruncation(tolerance=TOLERANCE), True),
        (gf.Unreduced(), False),
    ):
        family = gf.reduce(parts, reducer, column_norm=1e-6)
        assert family.kept == parts.external_units
        limits = gf.SmallModels(family).limits(model, HYBRID)
        names = " ".join(limits.direct.names) if limits is not None else ""
        assert all((str(unit) in names) is watched for unit in family.kept)


def test_a_hybrid_model_whose_kept_machines_reach_limits_gives_way_to_the_detailed_one():
    run = run_of("ieee39", reduced("ieee39"), HYBRID_ONLY)
    assert modes(run) == {DETAILED}
    assert rms_deg("ieee39", run) < 1e-8


def test_two_lags_in_a_row_with_one_time_constant_are_linked():
    """The New England governors have two of 999 s; a mode that occurs twice in a chain."""
    small = whole("ieee39").get(parts_of("ieee39").model, LINEAR)
    assert isinstance(small.system, ModalSystem)
    assert small.system.form.links.gains.size == 10
    assert (
        gf.reduce(parts_of("ieee39"), gf.BalancedTruncation(tolerance=1e-11)).reduction.order > 70
    )


def test_without_modal_form_a_linear_run_equals_the_matrix_exponential(monkeypatch):
    monkeypatch.setattr("gridfold.equivalents.families.chained_form", lambda matrix: None)
    parts = parts_of("own")
    model = parts.model
    small = gf.whole_system(parts).linear(model)
    shift = 0.02 * np.random.default_rng(2).standard_normal(model.n_states)
    segment = Segment(small.system, 1.0, coordinates=small.coordinates)
    run = run_segments([segment], model.x0 + shift, gf.RungeKutta4(0.005))
    expected = model.x0 + expm(model.jacobian(model.x0)) @ shift
    assert np.abs(run.pieces[-1].full_states[-1] - expected).max() < 1e-6
