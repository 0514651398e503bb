"""Impedances of transformers by correction tables, against straight lines written out here."""

import pytest
from raw_texts import TRANSFORMERS, raw_text

import gridfold as gf
from gridfold.io.impedance_tables import correction_factor
from gridfold.io.powerio_cases import read_network

BY_RATIO = "1,0.9,1.2,1.0,1.0,1.1,0.9"
BY_ANGLE = "2,-30.0,1.3,0.0,1.0,30.0,1.1"


def read(tmp_path, text):
    path = tmp_path / "tables.raw"
    path.write_text(text)
    return read_network(path)


def transformers(ratio, shift, number):
    winding = f"{ratio},0.0,{shift},0,0,0,0,0,1.1,0.9,1.1,0.9,33,{number},0,0"
    return (TRANSFORMERS[0], "0.01,0.05,100.0", winding, *TRANSFORMERS[3:])


@pytest.mark.parametrize(
    ("ratio", "shift", "number", "factor"),
    [
        (0.95, 0.0, 1, 1.1),
        (1.0, 20.0, 1, 1.0),
        (1.04, 0.0, 1, 0.96),
        (1.3, 0.0, 1, 0.9),
        (0.7, 0.0, 1, 1.2),
        (1.05, -10.0, 2, 1.1),
        (1.05, 15.0, 2, 1.05),
        (1.05, 60.0, 2, 1.1),
        (1.05, 15.0, 0, 1.0),
    ],
)
def test_a_factor_is_on_a_straight_line_between_points_and_stays_beyond(
    tmp_path, ratio, shift, number, factor
):
    sections = {
        "TRANSFORMER": transformers(ratio, shift, number),
        "IMPEDANCE CORRECTION": (BY_RATIO, BY_ANGLE),
    }
    branch = read(tmp_path, raw_text(sections)).branches[4]
    z = complex(branch.resistance, branch.reactance)
    assert z == pytest.approx(factor * (0.01 + 0.05j), rel=1e-12)
    assert (branch.ratio, branch.shift_deg) == (ratio, shift)


def test_each_winding_of_three_has_its_own_table(tmp_path):
    record = (
        "1,3,5,'T',1,1,1,0,0,2,'',1",
        "0.002,0.1,100,0.004,0.2,100,0.003,0.14,100,1.0,0.0",
        "0.95,0,0,0,0,0,0,0,1.1,0.9,1.1,0.9,33,1,0,0",
        "1.0,0,0,0,0,0,0,0,1.1,0.9,1.1,0.9,33,0,0,0",
        "1.0,0,-15,0,0,0,0,0,1.1,0.9,1.1,0.9,33,2,0,0",
    )
    sections = {
        "TRANSFORMER": (*TRANSFORMERS, *record),
        "IMPEDANCE CORRECTION": (BY_RATIO, BY_ANGLE),
    }
    legs = [b for b in read(tmp_path, raw_text(sections)).branches if b.circuit == "T"]
    z12, z23, z31 = 0.002 + 0.1j, 0.004 + 0.2j, 0.003 + 0.14j
    expected = [1.1 * (z12 + z31 - z23) / 2, (z12 + z23 - z31) / 2, 1.15 * (z23 + z31 - z12) / 2]
    found = [complex(leg.resistance, leg.reactance) for leg in legs]
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("table", "fault"),
    [
        ("1,1.0,1.0,0.9,1.2,1.1,0.9", "table 1 are not in ascending order"),
        ("1,0.9,1.0,0.9,1.2,1.1,0.9", "table 1 are not in ascending order"),
        ("3,0.9,1.2,1.1,0.9", "impedance correction table 1 is not in the file"),
    ],
)
def test_a_table_without_order_or_without_a_trace_is_told_with_the_branch(tmp_path, table, fault):
    sections = {"TRANSFORMER": transformers(1.04, 0.0, 1), "IMPEDANCE CORRECTION": (table,)}
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, raw_text(sections))
    assert "branch 1-3:1 (tables.raw:" in str(raised.value)
    assert fault in str(raised.value)


def test_complex_factors_turn_the_impedance():
    points = [
        {"value": 1.0, "factor_re": 1.0, "factor_im": 0.0},
        {"value": 1.1, "factor_re": 0.9, "factor_im": 0.02},
    ]
    table = {"table": 4, "variable": "ratio", "points": points}
    assert correction_factor(table, 1.05, 0.0) == pytest.approx(0.95 + 0.01j)


def test_a_table_that_no_winding_names_changes_nothing(tmp_path):
    plain = read(tmp_path, raw_text({"IMPEDANCE CORRECTION": (BY_RATIO,)}))
    assert plain.branches == read(tmp_path, raw_text()).branches
