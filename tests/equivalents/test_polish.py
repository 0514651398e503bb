"""The Polish grid of RAPID, reduced; where the public case is at hand."""

import os
from pathlib import Path

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.folded import fold
from gridfold.partition.areas import study_buses
from gridfold.reduction import BalancedTruncation

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))
POLISH = CASES / "polish" / "Data_POLISH.mat"

#: The zone that is reduced: 95 machines behind 38 tie lines.
EXTERNAL_ZONE = 3
#: Of its 855 states.
ORDER = 300
#: Bus of a machine of 1,000 MW.
FAULTED = 31


@pytest.fixture(scope="module")
def model():
    if not POLISH.is_file():
        pytest.skip(f"{POLISH} is absent; GRIDFOLD_CASES names the folder of public cases")
    return gf.build_model(gf.load_case(POLISH))


@pytest.fixture(scope="module")
def parts(model):
    zones = {bus.zone for bus in model.case.buses} - {EXTERNAL_ZONE}
    return gf.partition(model, study_buses(model.case, zones=zones))


def test_the_grid_has_2383_buses_and_327_machines_with_nine_states(model):
    assert len(model.case.buses) == 2383
    assert len(model.machines) == 327
    assert model.n_states == 9 * 327


def test_the_start_is_an_equilibrium(model):
    assert np.abs(model.compiled(model.x0)).max() < 1e-8


def test_the_grid_stays_where_it_starts(model):
    run = gf.simulate(model, (), 2.0)
    assert run.status is gf.Status.COMPLETED
    assert np.abs(run.states - model.x0).max() < 1e-8


def test_the_large_zone_has_95_machines_and_38_tie_lines(parts):
    assert len(parts.external_units) == 95
    assert len(parts.tie_lines) == 38


def test_a_reduced_zone_follows_a_short_fault_within_a_degree(model, parts):
    family = fold(parts, reducer=BalancedTruncation(order=ORDER))
    fault = gf.BusFault(FAULTED, duration=0.1)
    detailed = gf.simulate(model, [fault], 3.0)
    reduced = gf.simulate_adaptive(model, family, gf.SwitchingRule(67.0), [fault], 3.0).trajectory
    errors = gf.compare(detailed, reduced, parts.study_units).units
    assert np.ptp(detailed.rotor_angle_deg([gf.UnitKey(FAULTED, "1")])) > 30
    assert max(error.rms_deg for error in errors) < 1
    assert max(error.relative_rms_deg for error in errors) < 0.1
