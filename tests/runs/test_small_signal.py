from __future__ import annotations

from dataclasses import replace

import numpy as np

import gridfold as gf


def test_eigenvalues_are_those_of_the_jacobian_sorted_from_the_right(npcc):
    modes = gf.small_signal(npcc)
    expected = np.linalg.eigvals(npcc.jacobian(npcc.x0))
    assert np.all(np.diff(modes.eigenvalues.real) <= 1e-9)
    distance = np.abs(modes.eigenvalues[:, None] - expected[None, :]).min(axis=1)
    assert distance.max() < 1e-6


def test_linearized_response_of_one_mode_decays_and_turns_as_its_eigenvalue_says(npcc):
    """A small push along an eigenvector, simulated in full, against exp(lambda t)."""
    modes = gf.small_signal(npcc)
    k = next(
        k for k, name in enumerate(modes.eigenvalues) if "26:1" in modes.dominant_states(k)[0][0]
        and modes.eigenvalues[k].imag > 5
    )  # fmt: skip
    values, vectors = np.linalg.eig(npcc.jacobian(npcc.x0))
    at = int(np.argmin(np.abs(values - modes.eigenvalues[k])))
    vector = vectors[:, at] / np.abs(vectors[:, at]).max()
    pushed = replace(npcc, x0=npcc.x0 + 1e-6 * vector.real)
    run = gf.simulate(pushed, t_end=1.0, stepper=gf.RungeKutta4(0.005))
    expected = (1e-6 * vector * np.exp(values[at])).real
    np.testing.assert_allclose(run.states[-1] - npcc.x0, expected, atol=2e-9)


def test_swing_modes_are_dominated_by_angle_and_speed_of_one_machine(npcc):
    modes = gf.small_signal(npcc)
    worst = int(np.nanargmin(np.where(modes.eigenvalues.imag > 0, modes.damping_ratio, np.nan)))
    names = {name.split(":")[0] for name, _ in modes.dominant_states(worst, 2)}
    assert names == {"rotor_angle", "speed"}
    assert 0.02 < modes.damping_ratio[worst] < 0.1
