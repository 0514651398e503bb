from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from row_of_areas import row_of_areas

import gridfold as gf
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents import choice
from gridfold.equivalents.area_bases import PORT_TOLERANCE
from gridfold.equivalents.choice import ModelSettings, ReductionSettings, RetainSettings
from gridfold.equivalents.families import Mode, ReducedExternal, WholeSystem
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import (
    PORTED,
    PRINTED,
    TOLERANCE,
    ModelKind,
    Outputs,
    ReducerKind,
    Weights,
)
from gridfold.equivalents.ranking import rank_retained
from gridfold.equivalents.swings import sample_swings
from gridfold.equivalents.switching import SwitchingRule
from gridfold.errors import OptionError
from gridfold.partition import couple

INFINITE = float("inf")
LAGGED, STATES, POLAR = BoundaryCoupling.LAGGED, Outputs.STATES, Outputs.POLAR


@pytest.fixture(scope="module")
def parts():
    return gf.partition(gf.build_model(row_of_areas()), range(11, 16))


@pytest.fixture(scope="module")
def swings(parts):
    return sample_swings(parts)


@pytest.fixture(scope="module")
def one_retained(parts):
    """Settings that keep the machine at bus 21."""
    return RetainSettings(buses="21")


@pytest.mark.parametrize("kind", ModelKind)
def test_a_model_with_ports_has_none_where_states_or_a_lag_are_asked_for(kind):
    assert ModelSettings(kind).ported is (kind in (ModelKind.AUTO, *PORTED))
    for options in ({"outputs": STATES}, {"coupling": LAGGED}):
        if kind in (ModelKind.LINEAR, ModelKind.DETAILED, *PRINTED):
            assert not ModelSettings(kind, **options).ported
        else:
            with pytest.raises(OptionError, match=f"has no effect on the {kind.value} model"):
                ModelSettings(kind, **options)


@pytest.mark.parametrize("kind", ModelKind)
def test_ports_are_refused_by_models_that_form_states(kind):
    if kind in PRINTED:
        with pytest.raises(OptionError, match=f"the {kind.value} model forms states"):
            ModelSettings(kind, outputs=POLAR)
    else:
        assert ModelSettings(kind, outputs=POLAR).outputs is POLAR
    with pytest.raises(OptionError, match="lagged coupling needs outputs 'states'"):
        ModelSettings(kind, outputs=POLAR, coupling=LAGGED)


@pytest.mark.parametrize(
    ("kind", "rule"),
    [
        (ModelKind.LINEAR, SwitchingRule(15.0, INFINITE, dwell=0.5)),
        (ModelKind.RETAINED, SwitchingRule(0.0, longest_above=INFINITE)),
        (ModelKind.ADAPTIVE, SwitchingRule(67.0, whole_deg=15.0, dwell=0.5)),
        (ModelKind.WHOLE, SwitchingRule(6.0, dwell=0.5)),
        (ModelKind.HYBRID, SwitchingRule(0.0)),
        (ModelKind.PROJECTED, SwitchingRule(0.0)),
        (ModelKind.PAPER, SwitchingRule(67.0)),
        (ModelKind.PAPER_WHOLE, SwitchingRule(6.0)),
    ],
)
def test_each_model_switches_by_a_rule_of_its_own(kind, rule):
    assert ModelSettings(kind).rule == rule


def test_thresholds_that_are_given_take_the_place_of_the_defaults():
    options = {"angle_deg": 30.0, "whole_deg": 2.0, "longest_above": 1.0}
    adaptive, paper = (
        ModelSettings(kind, **options).rule for kind in (ModelKind.ADAPTIVE, ModelKind.PAPER)
    )
    assert adaptive == SwitchingRule(30.0, 1.0, whole_deg=2.0, dwell=0.5)
    assert paper == SwitchingRule(30.0, 1.0)
    linear = ModelSettings(ModelKind.LINEAR, whole_deg=2.0)
    assert linear.rule == SwitchingRule(2.0, INFINITE, dwell=0.5)
    assert replace(linear, outputs=STATES).rule.angle_deg == INFINITE


@pytest.mark.parametrize(
    ("settings", "ported", "expected"),
    [
        (ReductionSettings(), True, gf.BalancedTruncation(PORT_TOLERANCE)),
        (ReductionSettings(), False, gf.BalancedTruncation(TOLERANCE)),
        (ReductionSettings(weights=Weights.STATES), True, gf.BalancedTruncation(TOLERANCE)),
        (ReductionSettings(tolerance=0.1), True, gf.BalancedTruncation(0.1)),
        (ReductionSettings(order=9), True, gf.BalancedTruncation(None, 9)),
        (
            ReductionSettings(order=9, slow_modes=0.1),
            False,
            gf.BalancedTruncation(None, 9, 0.1),
        ),
        (ReductionSettings(ReducerKind.MODAL, order=9), True, gf.ModalTruncation(9)),
    ],
)
def test_the_bound_of_a_reduction_is_that_of_its_form(settings, ported, expected):
    assert settings.build(ported) == expected


@pytest.mark.parametrize("kind", [*PRINTED, ModelKind.LINEAR])
def test_weights_of_ports_are_refused_where_there_are_none(kind):
    outputs = STATES if kind is ModelKind.LINEAR else None
    reduction = ReductionSettings(weights=Weights.INTERFACE)
    with pytest.raises(OptionError, match=f"'interface' have no effect on the {kind.value} model"):
        ModelSettings(kind, reduction=reduction, outputs=outputs)
    own = ReductionSettings(weights=Weights.STATES)
    assert not ModelSettings(kind, reduction=own, outputs=outputs).ported


def test_machines_are_retained_by_norm_by_buses_or_by_their_rank(parts, swings):
    coupling = couple(parts)
    norm = float(np.sort(coupling.norms)[-2])
    assert RetainSettings(norm).choose(parts, swings) == coupling.kept(norm)
    assert len(coupling.kept(norm)) == 2
    assert RetainSettings(buses="22,31").choose(parts, swings) == (
        gf.UnitKey(22, "1"),
        gf.UnitKey(31, "1"),
    )
    ranked = rank_retained(parts, swings)
    assert RetainSettings(count=3).choose(parts, swings) == ranked.units[:3]
    assert RetainSettings(count=0).choose(parts, ()) == ()


def test_what_cannot_be_retained_is_named(parts, swings):
    with pytest.raises(OptionError, match="to be retained: there is no machine at bus 11"):
        RetainSettings(buses="21,11").choose(parts, swings)
    with pytest.raises(OptionError, match="of 4 external machines 5 cannot be taken"):
        RetainSettings(count=5).choose(parts, swings)
    for wrong in (
        {"column_norm": 1.0, "count": 1},
        {"buses": "21", "count": 0},
        {"column_norm": 0.0, "buses": "21"},
    ):
        with pytest.raises(OptionError, match="give one of the column norm, the buses"):
            RetainSettings(**wrong)
    with pytest.raises(OptionError, match="must be 0 or more: -1"):
        RetainSettings(count=-1)


@pytest.mark.parametrize(
    ("kind", "rungs"),
    [
        (ModelKind.LINEAR, (Mode.LINEAR, Mode.WHOLE)),
        (ModelKind.RETAINED, (Mode.RETAINED,)),
        (ModelKind.WHOLE, (Mode.RETAINED, Mode.WHOLE)),
        (ModelKind.ADAPTIVE, (Mode.RETAINED, Mode.LINEAR, Mode.WHOLE)),
    ],
)
def test_models_with_ports_are_ladders_of_their_rungs(
    parts, one_retained, falling_costs, kind, rungs
):
    found = ModelSettings(kind, one_retained).build(parts)
    assert isinstance(found, Ladder)
    assert found.rungs == found.modes == rungs
    assert found.retained == (() if kind is ModelKind.LINEAR else (gf.UnitKey(21, "1"),))
    # What a step takes is measured where the angle decides.
    assert bool(found.step_seconds) is (kind in (ModelKind.WHOLE, ModelKind.ADAPTIVE))


def test_without_a_machine_to_retain_the_upper_rung_is_the_linear_one(parts, falling_costs):
    found = ModelSettings(ModelKind.ADAPTIVE, RetainSettings(count=0)).build(parts)
    assert found.modes == (Mode.LINEAR, Mode.LINEAR, Mode.WHOLE)
    assert found.areas[0] is found.areas[1]
    bands = ModelSettings(ModelKind.ADAPTIVE).rule.bands(found.modes)
    assert [(band.mode, band.lowest) for band in bands] == [(Mode.LINEAR, 15.0), (Mode.WHOLE, 0.0)]


def test_models_of_the_paper_have_its_forms(parts):
    norms = RetainSettings(2.0)
    reduction = ReductionSettings(order=20)
    paper, projected, whole, linear = (
        ModelSettings(kind, norms, reduction, **options).build(parts)
        for kind, options in (
            (ModelKind.PAPER, {"coupling": LAGGED}),
            (ModelKind.PROJECTED, {}),
            (ModelKind.PAPER_WHOLE, {}),
            (ModelKind.LINEAR, {"outputs": STATES}),
        )
    )
    assert isinstance(paper, ReducedExternal)
    assert (paper.kept, paper.boundary) == (couple(parts).kept(2.0), LAGGED)
    assert paper.reduction.order == 20
    assert projected.kept == parts.external_units
    assert isinstance(whole, WholeSystem)
    assert whole.kept == paper.kept
    assert isinstance(linear, ReducedExternal)
    for kind in PRINTED:
        settings = ModelSettings(kind, RetainSettings(count=1), reduction)
        with pytest.raises(OptionError, match="keeps machines by their column norm"):
            settings.build(parts)


@pytest.fixture
def ladder(parts, one_retained, falling_costs):
    return ModelSettings(ModelKind.ADAPTIVE, one_retained).build(parts)


@pytest.mark.parametrize("kind", PORTED)
def test_a_ladder_that_is_there_is_taken_as_far_as_the_model_goes(ladder, kind):
    costs = {mode: 2 * seconds for mode, seconds in ladder.step_seconds.items()}
    known = replace(ladder, step_seconds=costs)
    found = ModelSettings(kind).adopt(known)
    near, far = known.areas
    expected = {ModelKind.LINEAR: (far,), ModelKind.ADAPTIVE: (near, far)}.get(kind, (near,))
    assert len(found.areas) == len(expected)
    assert all(a is b for a, b in zip(found.areas, expected, strict=True))
    assert found.whole is (kind is not ModelKind.RETAINED)
    measured = kind in (ModelKind.ADAPTIVE, ModelKind.WHOLE)
    rungs = (Mode.DETAILED, *found.rungs) if measured else ()
    assert found.step_seconds == {mode: costs[mode] for mode in rungs}


def test_a_family_of_another_form_is_refused(parts, ladder):
    reduced = gf.reduce(parts, gf.BalancedTruncation(order=20))
    for kind in PORTED:
        with pytest.raises(OptionError, match=f"the {kind.value} model needs .* outputs 'polar'"):
            ModelSettings(kind).adopt(reduced)
    for kind in PRINTED:
        with pytest.raises(OptionError, match=f"the {kind.value} model needs .* outputs 'states'"):
            ModelSettings(kind).adopt(ladder)
    short = replace(ladder, areas=ladder.areas[:1])
    with pytest.raises(OptionError, match="no area in which all external machines are linear"):
        ModelSettings(ModelKind.LINEAR).adopt(short)
    assert ModelSettings(ModelKind.LINEAR, outputs=STATES).adopt(reduced).reduction.order == 20


def test_the_record_of_a_ladder_tells_its_rungs_and_what_a_step_takes(ladder):
    record = ModelSettings(ModelKind.ADAPTIVE).record(ladder)
    assert record["kept"] == ["21:1"]
    assert (record["angle_deg"], record["whole_deg"], record["longest_above"]) == (67, 15, 5)
    assert (record["outputs"], record["coupling"]) == ("polar", "exact")
    assert record["order"] == ladder.areas[0].bases.order
    assert record["bound"] == ladder.areas[0].bases.bound <= PORT_TOLERANCE
    assert record["ports"] == list(ladder.areas[0].ports.buses)
    rungs = [(rung["model"], rung["used"]) for rung in record["rungs"]]
    assert rungs == [("retained", True), ("linear", True), ("linear whole", True)]
    spent = [1e-6 * rung["step_us"] for rung in record["rungs"]]
    assert spent == pytest.approx([ladder.step_seconds[mode] for mode in ladder.rungs])
    dear = dict.fromkeys(ladder.step_seconds, 1.0) | {Mode.DETAILED: 0.5, Mode.WHOLE: 0.1}
    record = ModelSettings(ModelKind.ADAPTIVE).record(replace(ladder, step_seconds=dear))
    assert [rung["used"] for rung in record["rungs"]] == [False, False, True]
    alone = ModelSettings(ModelKind.RETAINED)
    assert "angle_deg" not in alone.record(alone.adopt(ladder))


def test_no_more_than_half_of_the_machines_are_retained_if_nothing_is_asked_for(parts, swings):
    """Here three of four external machines have norms above 1 p.u."""
    norms = dict(zip(couple(parts).units, couple(parts).norms, strict=True))
    assert len(RetainSettings(column_norm=1.0).choose(parts, swings)) == 3
    chosen = RetainSettings().choose(parts, swings)
    assert set(chosen) == set(sorted(norms, key=norms.get)[2:])


def test_units_without_a_norm_do_not_count_among_which_half_is_retained(parts, monkeypatch):
    """Loads that follow the frequency stand among the external units."""
    coupling = couple(parts)
    loads = tuple(gf.UnitKey(unit.bus, "load-1") for unit in coupling.units) * 2
    norms = np.concatenate([coupling.norms, np.zeros(len(loads))])
    beside = replace(coupling, units=(*coupling.units, *loads), norms=norms)
    monkeypatch.setattr(choice, "couple", lambda parts: beside)
    assert len(RetainSettings().choose(parts, ())) == 2
