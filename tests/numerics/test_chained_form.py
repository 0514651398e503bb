"""Modes that coincide in a chain: against the matrix, its exponential, and ramps that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from gridfold.errors import OptionError
from gridfold.numerics.chained_form import chained_form
from gridfold.numerics.driven_modes import drive_modes
from gridfold.numerics.modal_form import modal_form
from gridfold.numerics.mode_links import ModeLinks
from gridfold.systems.modal import ModalSystem

RNG = np.random.default_rng(0)
TIMES = np.concatenate([[0.003], np.arange(1, 120) * 0.05])


def in_a_row(*lags: float) -> np.ndarray:
    """1 / (1 + s T) one after the other, of these T."""
    rates = 1 / np.array(lags)
    return np.diag(-rates) + np.diag(rates[1:], -1)


def driven_swing(*swings: float) -> np.ndarray:
    """A lag of 1 s, then swings of these rad/s that decay by 0.2 1/s, then a lag of 1 s, in a row."""
    n = 2 * len(swings) + 2
    a = np.zeros((n, n))
    a[0, 0] = a[-1, -1] = -1.0
    for k, rate in enumerate(swings):
        i = 2 * k + 1
        a[i : i + 2, i : i + 2] = [[-0.2, rate], [-rate, -0.2]]
        a[i, i - 1] = 0.7
    a[-1, -2] = 0.4
    return a


def shuffled(a: np.ndarray) -> np.ndarray:
    """The states in another order."""
    order = np.random.default_rng(len(a)).permutation(len(a))
    return a[np.ix_(order, order)]


#: Matrices without a basis of eigenvectors, and the most links in a row.
CHAINS = {
    "two lags": (in_a_row(0.5, 0.5), 1),
    "two integrators": (np.array([[0.0, 0.0], [1.0, 0.0]]), 1),
    "five lags": (in_a_row(1.0, 0.2, 1.0, 1.0, 0.2), 2),
    "very slow lags": (in_a_row(999.0, 999.0, 3.0), 1),
    "a swing between lags": (driven_swing(6.3), 1),
    "two swings of one rate": (driven_swing(6.3, 6.3), 1),
    "two swings nearly of one rate": (driven_swing(6.3, 6.30001), 1),
}
CHAINED = pytest.mark.parametrize(("a", "depth"), CHAINS.values(), ids=CHAINS)


@CHAINED
def test_a_chain_has_no_modal_form_but_a_chained_one_that_gives_the_matrix_back(a, depth) -> None:
    a = shuffled(a)
    form = chained_form(a)
    np.testing.assert_allclose(form.inverse @ form.basis, np.eye(len(a)), atol=1e-12)
    np.testing.assert_allclose(form.basis @ form.matrix() @ form.inverse, a, atol=1e-10)
    x = RNG.normal(size=(3, len(a)))
    rates = form.derivative(x @ form.inverse.T) @ form.basis.T
    np.testing.assert_allclose(rates, x @ a.T, atol=1e-9)
    assert form.links.depth == depth


@CHAINED
def test_links_join_modes_of_one_rate_alone(a, depth) -> None:
    form = chained_form(shuffled(a))
    rates, links = form.eigenvalues, form.links
    both = np.abs(rates[links.driven].real - rates[links.driving].real)
    both = both + np.abs(np.abs(rates[links.driven].imag) - np.abs(rates[links.driving].imag))
    assert both.max() < 1e-5


@CHAINED
def test_the_closed_form_of_a_chain_is_what_the_matrix_exponential_says(a, depth) -> None:
    a, exact = shuffled(a), a is not CHAINS["two swings nearly of one rate"][0]
    n, form = len(a), chained_form(a)
    start, offset = RNG.normal(size=(2, n))
    larger = np.zeros((n + 1, n + 1))
    larger[:n, :n], larger[:n, n] = a, offset
    expected = [(expm(larger * t) @ np.append(start, 1.0))[:n] for t in TIMES]
    system = ModalSystem(form, form.inverse @ offset)
    found = system.states_after(form.inverse @ start, TIMES)
    atol = (1e-9 if exact else 1e-5) * np.abs(expected).max()
    np.testing.assert_allclose(found @ form.basis.T, expected, rtol=0, atol=atol)
    rate = system.compiled(form.inverse @ start)
    np.testing.assert_allclose(form.basis @ rate, a @ start + offset, atol=1e-11)
    rows = RNG.normal(size=(4, n))
    reached = np.abs(found @ rows.T).max(axis=0)
    assert np.all(system.reach(form.inverse @ start, TIMES[-1], rows) >= reached * (1 - 1e-12))


def test_integrators_in_a_row_ramp_as_powers_of_time() -> None:
    a = np.diag(np.ones(3), -1)
    form = chained_form(a)
    system = ModalSystem(form, form.inverse @ [1.0, 0, 0, 0])
    found = system.states_after(np.zeros(4), TIMES) @ form.basis.T
    powers = [TIMES ** (k + 1) / np.prod(np.arange(1, k + 2)) for k in range(4)]
    np.testing.assert_allclose(found, np.transpose(powers), rtol=1e-11)


@pytest.mark.parametrize("time", [1e-4, 0.3, 0.9999, 1.0001, 4.0])
def test_a_ramp_through_two_lags_is_known(time) -> None:
    """1 / (1 + s)^2 answers a step by 1 - (1 + t) exp(-t)."""
    form = chained_form(in_a_row(1.0, 1.0))
    system = ModalSystem(form, form.inverse @ [1.0, 0.0])
    found = system.states_after(np.zeros(2), np.array([time])) @ form.basis.T
    expected = [-np.expm1(-time), -np.expm1(-time) - time * np.exp(-time)]
    np.testing.assert_allclose(found[0], expected, rtol=1e-7, atol=1e-15)


@CHAINED
def test_a_chain_under_a_load_is_what_an_integrator_finds(a, depth) -> None:
    form, times = chained_form(a), np.linspace(0, 2, 81)
    load = np.sin(np.outer(times, np.arange(1, len(a) + 1)))

    def rate(t: float, w: np.ndarray) -> np.ndarray:
        return form.matrix() @ w + [np.interp(t, times, column) for column in load.T]

    start = RNG.normal(size=len(a))
    exact = solve_ivp(rate, (0, 2), start, rtol=1e-9, atol=1e-10, t_eval=times, max_step=0.025).y.T
    found = drive_modes(form, times, start, load)
    np.testing.assert_allclose(found, exact, atol=2e-3 * np.abs(exact).max())


@pytest.mark.parametrize("a", [np.diag([-3.0, -1.0]), np.array([[-1.0, 2.0], [-2.0, -1.0]])])
def test_modes_that_can_be_told_apart_have_no_links(a) -> None:
    form, usual = chained_form(a), modal_form(a)
    assert not form.links.gains.size
    np.testing.assert_array_equal(form.basis, usual.basis)
    np.testing.assert_array_equal(form.diagonal, usual.diagonal)


def test_states_that_drive_one_another_to_one_rate_have_no_form() -> None:
    """Critical damping."""
    assert chained_form(np.array([[0.0, 1.0], [-1.0, -2.0]])) is None
    assert chained_form(np.array([[0.0, 1, 0], [-1.0, -2, 0], [1.0, 0, -3]])) is None


def test_equal_units_side_by_side_need_no_links() -> None:
    """Two rows of one lag and another of half its time, both driven by one state."""
    a = np.diag([-1.0, -2.0, -2.0, -4.0, -4.0])
    a[1, 0] = a[2, 0] = a[3, 1] = a[4, 2] = 1.0
    form = chained_form(a)
    assert not form.links.gains.size
    np.testing.assert_allclose(form.basis @ form.matrix() @ form.inverse, a, atol=1e-13)


def test_links_in_a_circle_or_beyond_the_modes_are_refused() -> None:
    form = modal_form(np.diag([-1.0, -2.0]))
    for driven, driving, words in (
        ([0, 1], [1, 0], "in a circle"),
        ([1], [1], "in a circle"),
        ([2], [0], "no position 2"),
        ([-1], [0], "no position -1"),
    ):
        links = ModeLinks(np.array(driven), np.array(driving), np.ones(len(driven)))
        with pytest.raises(OptionError, match=words):
            type(form)(*(getattr(form, name) for name in (
                "basis", "inverse", "diagonal", "coupling", "partner")), links)  # fmt: skip
    with pytest.raises(OptionError, match="driven has shape"):
        ModeLinks(np.array([0]), np.array([1]), np.ones(2))


def test_links_between_modes_that_are_kept_stay() -> None:
    links = ModeLinks(np.array([1, 2, 3]), np.array([0, 1, 2]), np.array([1.0, 2.0, 3.0]))
    kept = links.only(np.array([False, True, True, True]))
    np.testing.assert_array_equal(kept.matrix(3), [[0, 0, 0], [2, 0, 0], [0, 3, 0]])
    assert (links.depth, kept.depth) == (3, 2)
