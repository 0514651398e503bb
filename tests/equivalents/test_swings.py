from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents import swings
from gridfold.equivalents.swings import FLOOR, port_swings, sample_swings
from gridfold.errors import OptionError


def deviations(area, parts, samples):
    """Angles, then logarithms of the port voltages against those at the operating point."""
    case, x = parts.model.case, np.vstack(samples)
    index = [case.bus_index[bus] for bus in area.ports.buses]
    voltages, start = (parts.model.bus_voltages(s)[:, index] for s in (x, parts.model.x0[None]))
    return np.hstack([np.angle(voltages / start), np.log(np.abs(voltages) / np.abs(start))])


def test_there_is_a_swing_after_a_fault_at_each_boundary_bus_halved_until_it_is_stable(
    npcc, npcc_parts, npcc_swings
):
    assert len(npcc_swings) == len(npcc_parts.boundary_buses) == 2
    durations = []
    for bus, states in zip(npcc_parts.boundary_buses, npcc_swings, strict=True):
        for duration in (0.1, 0.05, 0.025):
            run = gf.simulate(npcc, [gf.BusFault(bus, duration=duration)], 3.0)
            if run.status is gf.Status.COMPLETED:
                break
        np.testing.assert_array_equal(states, run.run.pieces[1].full_states)
        durations.append(duration)
    assert 0.1 in durations
    assert min(durations) < 0.1


def test_no_more_than_four_faults_are_sampled_spread_over_the_boundary():
    def chosen(*buses):
        return [fault.bus for fault in swings.sample_faults(SimpleNamespace(boundary_buses=buses))]

    assert chosen(3, 5, 8) == [3, 5, 8]
    assert chosen(*range(10, 17)) == [10, 12, 14, 16]


def test_the_last_try_counts_even_if_synchronism_is_lost(npcc_parts):
    found = swings._boundary_swing(npcc_parts, gf.BusFault(29, duration=16.0), 20.0, None)
    assert found.status is gf.Status.LOST_SYNCHRONISM
    assert found.events[0].duration == 1.0


def test_a_swing_after_which_the_network_is_not_intact_gives_no_sample(npcc_parts):
    with pytest.raises(OptionError, match="intact"):
        sample_swings(npcc_parts, [[gf.BranchFault("3-2")]], 1.0)


def test_where_ports_swing_independently_the_weights_are_the_root_of_the_covariance(
    npcc, npcc_parts, npcc_retained
):
    rng, area = np.random.default_rng(3), npcc_retained.area
    samples = [npcc.x0 + 0.1 * rng.standard_normal((200, npcc.n_states)) for _ in range(2)]
    u = deviations(area, npcc_parts, samples)
    found = port_swings(area, npcc_parts, tuple(samples))
    spread = np.linalg.eigvalsh(u.T @ u)
    assert spread[0] > FLOOR**2 * spread[-1]
    np.testing.assert_allclose(found @ found.T, u.T @ u / len(u), rtol=1e-9, atol=1e-15)


def test_of_swings_that_go_together_the_directions_that_are_not_seen_count_a_hundredth(
    npcc_parts, npcc_swings, npcc_retained
):
    area = npcc_retained.area
    found = port_swings(area, npcc_parts, npcc_swings)
    np.testing.assert_allclose(found, found.T, atol=1e-15)
    sizes = np.linalg.eigvalsh(found)
    assert sizes[0] == pytest.approx(FLOOR * sizes[-1])
    u = deviations(area, npcc_parts, npcc_swings)
    missing = np.linalg.eigvalsh(found @ found - u.T @ u / len(u))
    assert missing[0] > -1e-12
    assert missing[-1] <= (FLOOR * sizes[-1]) ** 2 * (1 + 1e-9)


def test_angles_beyond_half_a_turn_are_followed(npcc, npcc_parts, npcc_linear):
    turned = np.repeat(npcc.x0[None], 9, axis=0)
    angles = npcc.slots("rotor_angle", npcc.machines)
    turned[:, angles] += np.linspace(0.0, 4.0, 9)[:, None]
    found = port_swings(npcc_linear.area, npcc_parts, (turned,))
    n = len(npcc_linear.ports.buses)
    together = np.r_[np.ones(n), np.zeros(n)] / np.sqrt(n)
    mean_square = (np.linspace(0.0, 4.0, 9) ** 2).mean()
    assert together @ found @ found @ together == pytest.approx(n * mean_square, rel=1e-9)
