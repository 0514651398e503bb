"""A branch seen from its buses, against formulas for lines and transformers written out here."""

from __future__ import annotations

import numpy as np
import pytest

import gridfold as gf
from gridfold.errors import NetworkError
from gridfold.grid.branch_port import two_port
from gridfold.grid.network_state import BranchFaultPoint

R, X, B = 0.02, 0.2, 0.3
Z, Y_HALF = complex(R, X), 0.5j * B
TAP = 1.05 * np.exp(1j * np.deg2rad(10.0))
LINE = gf.Branch(1, 2, resistance=R, reactance=X, susceptance=B)
TRANSFORMER = gf.Branch(
    1, 2, resistance=R, reactance=X, ratio=1.05, shift_deg=10.0, from_conductance=0.01,
    from_susceptance=-0.04,
)  # fmt: skip
WITH_REACTORS = gf.Branch(
    1, 2, resistance=R, reactance=X, susceptance=B, from_susceptance=-0.1, to_susceptance=-0.2
)


def charged(behind: complex) -> complex:
    """Input admittance of half the charging, the series impedance, and what is `behind` it."""
    return Y_HALF + 1 / (Z + 1 / behind)


@pytest.mark.parametrize("end", [0, 1])
def test_a_line_open_at_one_end_draws_its_charging_through_its_impedance(end):
    port = two_port(LINE, open_ends=[end])
    near = 1 - end
    assert port[near, near] == pytest.approx(charged(Y_HALF), rel=1e-12)
    assert np.count_nonzero(port) == 1


def test_reactors_at_the_open_end_stay_with_the_line():
    port = two_port(WITH_REACTORS, open_ends=[1])
    assert port[0, 0] == pytest.approx(charged(Y_HALF - 0.2j) - 0.1j, rel=1e-12)
    port = two_port(WITH_REACTORS, open_ends=[0])
    assert port[1, 1] == pytest.approx(charged(Y_HALF - 0.1j) - 0.2j, rel=1e-12)


def test_a_transformer_open_at_its_far_side_draws_its_magnetizing_current_alone():
    port = two_port(TRANSFORMER, open_ends=[1])
    assert port[0, 0] == pytest.approx(0.01 - 0.04j, rel=1e-12)
    # From the other side it is seen through the ratio, whatever the phase shift.
    port = two_port(TRANSFORMER, open_ends=[0])
    magnetizing = (0.01 - 0.04j) * abs(TAP) ** 2
    assert port[1, 1] == pytest.approx(1 / (Z + 1 / magnetizing), rel=1e-12)


@pytest.mark.parametrize("fraction", [0.25, 0.6])
@pytest.mark.parametrize("fault_impedance", [0j, 0.01 + 0.03j])
def test_a_fault_on_a_line_open_at_the_far_end(fraction, fault_impedance):
    near, far = (
        (1j * B / 2 * part, Z * part) for part in (fraction, 1 - fraction)
    )  # half charging and impedance of both sides
    stub = far[0] + 1 / (far[1] + 1 / far[0])
    port = two_port(LINE, BranchFaultPoint(0, fraction, fault_impedance), [1])
    if fault_impedance == 0:
        expected = near[0] + 1 / near[1]
    else:
        expected = near[0] + 1 / (near[1] + 1 / (near[0] + stub + 1 / fault_impedance))
    assert port[0, 0] == pytest.approx(expected, rel=1e-12)


def test_a_bolted_fault_behind_the_open_breaker_is_fed_through_the_whole_line():
    port = two_port(LINE, BranchFaultPoint(0, 0.0, 0j), [0])
    assert port[1, 1] == pytest.approx(Y_HALF + 1 / Z, rel=1e-12)
    port = two_port(LINE, BranchFaultPoint(0, 1.0, 0.02j), [1])
    assert port[0, 0] == pytest.approx(charged(Y_HALF + 1 / 0.02j), rel=1e-12)


def test_a_bolted_fault_inside_separates_the_ends():
    port = two_port(LINE, BranchFaultPoint(0, 0.25, 0j))
    assert port[0, 1] == port[1, 0] == 0
    assert port[0, 0] == pytest.approx(1j * B * 0.25 / 2 + 1 / (0.25 * Z), rel=1e-12)


def test_a_branch_open_at_both_ends_is_not_there():
    assert not two_port(LINE, open_ends=[0, 1]).any()


def test_an_open_end_in_resonance_is_an_error():
    """Half the charging cancels the series admittance seen from the open end."""
    resonant = gf.Branch(1, 2, reactance=0.5, susceptance=4.0)
    with pytest.raises(NetworkError, match="branch 1-2:1: its open end resonates"):
        two_port(resonant, open_ends=[1])
