"""What is drawn follows from seed and number; both fillings are what they are called."""

import numpy as np
import pytest

import gridfold as gf
from gridfold.sampling.draw import Happenings, draw, filling
from gridfold.sampling.plan import SamplePlan
from gridfold.sampling.prepare import chunks
from gridfold.study.generate import Contingency

FAULTS = Happenings(
    (
        Contingency(1, "bus 1", "bus fault", (gf.BusFault(1, duration=0.01),)),
        Contingency(2, "line", "line fault", (gf.BranchFault("1-2", duration=0.01),)),
        Contingency(3, "trip", "machine trip", (gf.MachineTrip(1),)),
        Contingency(4, "own", "bus fault", (gf.BusFault(2, duration=0.5),)),
    ),
    timed=3,
)


def plan(**given):
    return SamplePlan.model_validate(
        {
            "samples": 64,
            "seed": 5,
            "load": [{"factor": {"uniform": [0.8, 1.2]}}, {"factor": 1.0}],
            "generation": [{"change_mw": {"normal": [0, 50], "within": [-100, 100]}}],
            "faults": {"bus_faults": "1", "clearing_time": {"uniform": [0.1, 0.2]}},
            **given,
        }
    )


def test_a_plain_number_has_no_dimension():
    assert filling(plan()).shape == (64, 4)


@pytest.mark.parametrize("kind", ["sobol", "latin_hypercube"])
def test_the_seed_alone_makes_the_samples(kind):
    first = filling(plan(filling=kind))
    assert np.array_equal(first, filling(plan(filling=kind)))
    assert np.array_equal(first, filling(plan(filling=kind, chunk=3, name="other")))
    assert not np.array_equal(first, filling(plan(filling=kind, seed=6)))


def test_a_sobol_row_does_not_hang_on_the_count():
    assert np.array_equal(filling(plan(samples=11)), filling(plan(samples=3000))[:11])


def test_a_latin_hypercube_has_one_sample_in_every_stratum_of_every_dimension():
    strata = np.floor(filling(plan(samples=37, filling="latin_hypercube")) * 37)
    assert np.array_equal(np.sort(strata, axis=0), np.tile(np.arange(37)[:, None], (1, 4)))


def test_sixteen_sobol_samples_have_one_in_every_sixteenth_of_every_dimension():
    strata = np.floor(filling(plan(samples=16)) * 16)
    assert np.array_equal(np.sort(strata, axis=0), np.tile(np.arange(16)[:, None], (1, 4)))


@pytest.mark.parametrize(("samples", "chunk"), [(1, 1), (10, 3), (10, 10), (10, 11), (12, 4)])
def test_chunks_have_every_number_once(samples, chunk):
    numbers = [
        number
        for part in chunks(plan(samples=samples, chunk=chunk))
        for number in range(part.first, part.first + len(part))
    ]
    assert numbers == list(range(1, samples + 1))


def test_values_stand_where_their_dimension_is():
    drawn = draw(plan(), FAULTS, 7, np.array([0.25, 0.5, 0.3, 0.75]))
    assert drawn.values == pytest.approx({"load_1": 0.9, "load_2": 1.0, "generation_1": 0.0})
    assert (drawn.number, drawn.contingency.name) == (7, "line")
    assert drawn.clearing_time == drawn.contingency.events[0].duration == pytest.approx(0.175)


@pytest.mark.parametrize(
    ("u", "name", "seconds"), [(0.0, "bus 1", 0.1), (0.5, "trip", None), (1.0, "own", 0.5)]
)
def test_only_generated_faults_have_the_time_drawn(u, name, seconds):
    drawn = draw(plan(), FAULTS, 1, np.array([0.5, 0.5, u, 0.0]))
    assert (drawn.contingency.name, drawn.clearing_time) == (name, seconds)
