"""Blocks of switched shunts in RAW files of all revisions."""

from __future__ import annotations

from pathlib import Path

import pytest
from raw_texts import LINES, TRANSFORMERS, UNITS, raw_text, with_field

import gridfold as gf
from gridfold.grid.flow_controls import ShuntControl
from gridfold.io.powerio_cases import read_network

_RATINGS = ",''" + 12 * ",0"
#: The records that are others in revision 35.
OF_35 = {
    "BRANCH": [line.replace(7 * ",0" + ",1,1", f"{_RATINGS},0,0,0,0,1,1") for line in LINES],
    "TRANSFORMER": [
        r.replace("0,0,0,0,0", 12 * "0," + "0,0") if r.startswith(("1.03", "0.98")) else r
        for r in TRANSFORMERS
    ],
    "GENERATOR": [with_field(unit, 7, "0,0") for unit in UNITS],
}


def blocks(folder: Path, written: str, revision: int) -> tuple[tuple[int, float], ...]:
    """Blocks that can be switched of a shunt with these fields behind its stored Mvar."""
    named = revision >= 35
    identifier, node = ("'A',", "0,") if named else ("", "")
    record = f"4,{identifier}1,0,1,1.05,0.95,0,{node}100,'',10.0,{written}"
    changes = {"SWITCHED SHUNT": [record], **(OF_35 if named else {})}
    path = folder / "case.raw"
    path.write_text(raw_text(changes, f"0,100.0,{revision},0,1,60.0"), encoding="utf-8")
    (found,) = (c for c in read_network(path).flow_controls if isinstance(c, ShuntControl))
    return found.blocks


@pytest.mark.parametrize(
    ("written", "found"),
    [
        ("1,2,10.0,1,3,20.0", ((2, 10.0), (3, 20.0))),
        ("1,2,10.0,0,3,20.0", ((2, 10.0),)),
        ("0,2,10.0,1,3,20.0", ((3, 20.0),)),
        ("0,2,10.0,,3,20.0", ((3, 20.0),)),
        ("1,2,10.0,1,0,0,1,3,20.0", ((2, 10.0),)),
        ("0,2,10.0", ()),
        ("1,2", ()),
    ],
)
def test_since_revision_35_blocks_out_of_service_cannot_be_switched(written, found, tmp_path):
    assert blocks(tmp_path, written, 35) == found


@pytest.mark.parametrize(
    ("written", "found"),
    [
        ("2,10.0,3,20.0", ((2, 10.0), (3, 20.0))),
        ("2,-10.0,0,0,3,20.0", ((2, -10.0),)),
        ("2,10.0,3", ((2, 10.0),)),
    ],
)
def test_before_it_a_block_is_steps_and_mvar_and_the_first_without_ends_them(
    written, found, tmp_path
):
    assert blocks(tmp_path, written, 33) == found


@pytest.mark.parametrize(
    ("written", "revision"),
    [
        ("99999999,10.0", 33),
        ("1.5,10.0", 33),
        ("-2,10.0", 33),
        ("x,10.0", 33),
        ("nan,10.0", 33),
        ("1e999,10.0", 33),
        ("1,1e30,10.0", 35),
    ],
)
def test_steps_that_cannot_be_counted_are_a_fault_with_their_line(written, revision, tmp_path):
    with pytest.raises(
        gf.CaseFileError, match=r"line \d+: N1 of a switched shunt is .* whole number"
    ):
        blocks(tmp_path, written, revision)
