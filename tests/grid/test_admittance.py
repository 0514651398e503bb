from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.grid.admittance import branch_admittances, bus_admittance, split_branch

BRANCHES = st.builds(
    gf.Branch,
    from_bus=st.just(1),
    to_bus=st.just(2),
    resistance=st.floats(0.0, 0.2),
    reactance=st.floats(0.01, 1.0),
    susceptance=st.floats(0.0, 1.0),
    ratio=st.floats(0.8, 1.2),
    shift_deg=st.floats(-60.0, 60.0),
)
FRACTIONS = st.floats(0.01, 0.99)


def two_port(branch):
    y = branch_admittances([branch])
    return np.array([[y.from_from[0], y.from_to[0]], [y.to_from[0], y.to_to[0]]])


def cascade(near, far):
    """Two two-ports in a row with the node between them eliminated."""
    y = np.zeros((3, 3), dtype=complex)
    y[:2, :2] += near
    y[1:, 1:] += far
    outer = [0, 2]
    return y[np.ix_(outer, outer)] - np.outer(y[outer, 1], y[1, outer]) / y[1, 1]


def test_two_port_of_a_line_by_hand():
    # 1/(0.03 + 0.04j) = 12 - 16j; half of the charging is 0.1j
    line = gf.Branch(1, 2, resistance=0.03, reactance=0.04, susceptance=0.2)
    own, mutual = 12 - 15.9j, -12 + 16j
    np.testing.assert_allclose(two_port(line), [[own, mutual], [mutual, own]], rtol=1e-14)


def test_two_port_of_a_phase_shifting_transformer_by_hand():
    # t = 0.8 at 90 degrees = 0.8j: the from side sees (12 - 15.9j)/0.64, the others -(12-16j)/t
    branch = gf.Branch(
        1, 2, resistance=0.03, reactance=0.04, susceptance=0.2, ratio=0.8, shift_deg=90.0
    )
    expected = [[18.75 - 24.84375j, -20 - 15j], [20 + 15j, 12 - 15.9j]]
    np.testing.assert_allclose(two_port(branch), expected, rtol=1e-13)


@settings(max_examples=40, deadline=None)
@given(BRANCHES)
def test_unloaded_transformer_gives_the_from_voltage_over_its_ratio(branch):
    y = two_port(replace(branch, susceptance=0.0))
    open_end = -y[1, 0] / y[1, 1]
    tap = branch.ratio * np.exp(1j * np.deg2rad(branch.shift_deg))
    assert open_end == pytest.approx(1 / tap, rel=1e-12)


@settings(max_examples=40, deadline=None)
@given(BRANCHES)
def test_branch_without_resistance_loses_no_power(branch):
    y = two_port(replace(branch, resistance=0.0))
    voltage = np.array([1.02 * np.exp(0.3j), 0.97 * np.exp(-0.2j)])
    power = voltage * np.conj(y @ voltage)
    assert power.real.sum() == pytest.approx(0.0, abs=1e-12 * abs(y).max())


def test_rows_of_untapped_lines_sum_to_the_shunts():
    case = gf.Case(
        "triangle",
        tuple(gf.Bus(number) for number in (10, 20, 30)),
        (
            gf.Branch(10, 20, resistance=0.01, reactance=0.1, susceptance=0.2),
            gf.Branch(20, 30, resistance=0.02, reactance=0.3, susceptance=0.4),
            gf.Branch(30, 10, reactance=0.2, susceptance=0.6),
        ),
        (),
        shunts=(
            gf.Shunt(20, conductance_mw=5.0, susceptance_mvar=30.0),
            gf.Shunt(20, "2", susceptance_mvar=-10.0),
            gf.Shunt(30, susceptance_mvar=99.0, in_service=False),
        ),
        base_mva=50.0,
    )
    y = bus_admittance(case).toarray()
    np.testing.assert_allclose(y.sum(axis=1), [0.4j, 0.1 + 0.7j, 0.5j], atol=1e-14)
    np.testing.assert_allclose(y, y.T)


def test_parallel_circuits_add_up(ring):
    y = bus_admittance(ring).toarray()
    assert y[0, 1] == pytest.approx(-1 / (0.01 + 0.10j) - 1 / (0.01 + 0.12j))


def test_branches_out_of_service_are_left_out_unless_told_otherwise(ring):
    assert bus_admittance(ring).toarray()[0, 3] == 0
    closed = bus_admittance(ring, branches_out=[]).toarray()
    assert closed[0, 3] == pytest.approx(1 / -0.25j)
    assert bus_admittance(ring, branches_out=[0, 1]).toarray()[0, 1] == 0


def test_a_case_without_branches_has_its_shunts_alone():
    case = gf.Case("one", (gf.Bus(1),), (), (), shunts=(gf.Shunt(1, susceptance_mvar=20.0),))
    np.testing.assert_array_equal(bus_admittance(case).toarray(), [[0.2j]])


@settings(max_examples=60, deadline=None)
@given(BRANCHES, FRACTIONS)
def test_parts_of_a_branch_without_charging_in_cascade_are_the_branch(branch, fraction):
    bare = replace(branch, susceptance=0.0)
    near, far = split_branch(bare, fraction)
    np.testing.assert_allclose(
        cascade(two_port(near), two_port(far)), two_port(bare), rtol=1e-9, atol=1e-9
    )


@settings(max_examples=60, deadline=None)
@given(BRANCHES, FRACTIONS)
def test_parts_of_a_branch_share_impedance_and_charging_in_proportion(branch, fraction):
    near, far = split_branch(branch, fraction)
    for name in ("resistance", "reactance", "susceptance"):
        whole = getattr(branch, name)
        assert getattr(near, name) == pytest.approx(fraction * whole)
        assert getattr(near, name) + getattr(far, name) == pytest.approx(whole)


def test_the_transformer_stays_with_the_first_part():
    branch = gf.Branch(1, 2, reactance=0.1, ratio=1.1, shift_deg=5.0)
    near, far = split_branch(branch, 0.3)
    assert (near.ratio, near.shift_deg) == (1.1, 5.0)
    assert (far.ratio, far.shift_deg) == (1.0, 0.0)
