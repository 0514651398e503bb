"""Elementary functions that become vector instructions."""

import mpmath
import numpy as np
import pytest

from gridfold.numerics.elementary import angle, exponential, logarithm, sine_cosine

#: Units in the last place, with some room.
ROUNDING = 4e-16


def errors(found, exact):
    """Relative errors, against more digits than a double has."""
    return [float(abs(mpmath.mpf(a) / b - 1)) for a, b in zip(found, exact, strict=True)]


def draw(low, high, size=2000):
    return np.random.default_rng(1).uniform(low, high, size).tolist()


@pytest.fixture(autouse=True)
def many_digits():
    with mpmath.workdps(40):
        yield


@pytest.mark.parametrize("reach", [1.0, 30.0, 708.0])
def test_exponential(reach):
    x = draw(-reach, reach)
    assert max(errors(map(exponential, x), map(mpmath.exp, x))) < ROUNDING


@pytest.mark.parametrize("reach", [1.0, 30.0, 1e6])
def test_sine_and_cosine(reach):
    x = draw(-reach, reach)
    assert max(errors([sine_cosine(v)[0] for v in x], map(mpmath.sin, x))) < ROUNDING
    assert max(errors([sine_cosine(v)[1] for v in x], map(mpmath.cos, x))) < ROUNDING


def test_sine_near_its_zeros():
    x = [float(k * np.pi) for k in range(1, 300)]
    assert max(errors([sine_cosine(v)[0] for v in x], map(mpmath.sin, x))) < 1e-11
    assert max(abs(sine_cosine(v)[0] - float(mpmath.sin(v))) for v in x) < 1e-22


@pytest.mark.parametrize("exponent", [0.1, 5.0, 300.0])
def test_logarithm(exponent):
    x = (10.0 ** np.array(draw(-exponent, exponent))).tolist()
    assert max(errors(map(logarithm, x), map(mpmath.log, x))) < ROUNDING


def test_angle():
    sizes = 10.0 ** np.random.default_rng(2).uniform(-5, 5, (2, 2000))
    signs = np.random.default_rng(3).choice([-1.0, 1.0], (2, 2000))
    y, x = (sizes * signs).tolist()
    assert max(errors(map(angle, y, x), map(mpmath.atan2, y, x))) < ROUNDING


def test_ends_of_the_exponential():
    assert exponential(800.0) == exponential(np.inf) == np.inf
    assert exponential(-800.0) == exponential(-np.inf) == 0.0
    assert exponential(0.0) == 1.0


def test_ends_of_the_logarithm():
    assert [logarithm(x) for x in (0.0, 1.0, np.inf)] == [-np.inf, 0.0, np.inf]
    assert np.isnan(logarithm(-1.0))


def test_angles_along_the_axes():
    along = [angle(y, x) for y, x in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))]
    assert along == [0.0, 0.0, np.pi / 2, np.pi, -np.pi / 2]


def test_what_is_no_number_stays_none():
    for function in (exponential, logarithm, lambda x: angle(x, 1.0), lambda x: angle(1.0, x)):
        assert np.isnan(function(np.nan))
    assert np.isnan(sine_cosine(np.nan)).all()
