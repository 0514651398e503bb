"""What commands say of data that are hardly meant, and what --strict makes of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gridfold.grid.doubts import Doubt
from gridfold.report.tables import doubt_lines

OWN = Path(__file__).parents[1] / "io"
RAW, DYR = OWN / "raw" / "revision_33.raw", OWN / "dyr" / "plain.dyr"
RUNS = {
    "info": (),
    "eigenvalues": (),
    "simulate": ("--t-end", "0.1"),
    "cct": ("--buses", "3", "--t-end", "0.2", "--longest", "0.05"),
}


@pytest.fixture
def files(tmp_path):
    """A governor of no unit, and an inertia ten times too large."""
    dyr = tmp_path / "odd.dyr"
    dyr.write_text(
        DYR.read_text()
        .replace("1 'TGOV1'  1", "1 'TGOV1'  2")
        .replace("5.0000       0.0000", "50.000       0.0000")
    )
    return RAW, dyr


@pytest.mark.parametrize("name", RUNS)
def test_every_command_tells_doubts_and_goes_on(command, files, name):
    code, out, _ = command(name, *files, *RUNS[name])
    words = " ".join(out.split())
    assert code == 0
    assert "warning: genrou 1:1 (odd.dyr:2): inertia (H) is 50 s, usually 1 to 10" in words
    assert "TGOV1 1:2 (odd.dyr:7): bus 1 has no unit '2', but '1'" in words
    assert "not validated: 1 record of dynamic data at units that are not there" in words


@pytest.mark.parametrize("name", RUNS)
def test_strict_ends_every_command_with_all_of_them(command, files, name):
    code, out, err = command(name, *files, *RUNS[name], "--strict")
    words = " ".join(err.split())
    assert (code, out) == (2, "")
    assert "where warnings are errors: 2 faults" in words
    assert "TGOV1 1:2 (odd.dyr:7): bus 1 has no unit '2', but '1'" in words
    assert "genrou 1:1 (odd.dyr:2): inertia (H) is 50 s, usually 1 to 10" in words


@pytest.mark.parametrize("name", RUNS)
def test_the_record_has_all_of_them(command, files, name):
    code, out, _ = command(name, *files, *RUNS[name], "--json", "-")
    assert code == 0
    facts = json.loads(out)
    assert facts["validated"] is False
    assert [line.split(":")[0] for line in facts["data_doubts"]] == ["genrou 1"]
    assert facts["unplaced"] == ["TGOV1 1:2 (odd.dyr:7): bus 1 has no unit '2', but '1'"]
    assert facts["warnings"] == []


def test_a_sound_case_is_not_doubted(command):
    code, out, _ = command("info", RAW, DYR, "--strict")
    assert code == 0
    assert "warning" not in out


def test_an_unstable_start_is_said_and_refused_by_strict(command, tmp_path):
    dyr = tmp_path / "unstable.dyr"
    # A stabilizer with the sign of its gain turned round drives the machine.
    dyr.write_text(DYR.read_text().replace("2 2  5  0.1", "2 2  -50  0.1"))
    code, out, _ = command("info", RAW, dyr)
    assert code == 0
    assert "warning: the operating point is unstable: mode" in " ".join(out.split())
    code, _, err = command("info", RAW, dyr, "--strict")
    assert code == 2
    assert "the operating point is unstable" in " ".join(err.split())


def test_many_doubts_are_a_line_for_each_kind_and_never_a_screen():
    def doubts(kinds, records):
        return [
            Doubt(f"bus {k}", f"own.raw:{k}", (f"row {k % kinds}",), (f"text {k % kinds}",))
            for k in range(records)
        ]

    assert doubt_lines([]) == []
    assert doubt_lines(doubts(1, 1)) == ["bus 0 (own.raw:0): text 0"]
    few = doubt_lines(doubts(2, 400))
    assert few == [
        "bus 0 (own.raw:0): text 0; 199 more of this kind",
        "bus 1 (own.raw:1): text 1; 199 more of this kind",
        "400 records with unusual values: gridfold info --json - lists all of them",
    ]
    many = doubt_lines(doubts(50, 400))
    assert len(many) == 7
    assert many[-1].startswith("44 more kinds; 400 records with unusual values")
