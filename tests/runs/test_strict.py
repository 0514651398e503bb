"""Warnings as errors, from Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import gridfold as gf
from gridfold.runs.basis import basis_of
from gridfold.runs.strict import refuse_doubtful_case, refuse_doubtful_start
from gridfold.runs.unstable_start import with_start_checked

OWN = Path(__file__).parents[1] / "io"
RAW, DYR = OWN / "raw" / "revision_33.raw", OWN / "dyr" / "plain.dyr"


@pytest.fixture
def files(tmp_path):
    """The own case with changes to its texts."""

    def write(raw=("", ""), dyr=("", "")):
        paths = []
        for source, (old, new) in ((RAW, raw), (DYR, dyr)):
            text = source.read_text()
            assert old in text
            paths.append(tmp_path / source.name)
            paths[-1].write_text(text.replace(old, new, 1))
        return paths

    return write


def test_a_sound_case_passes(files):
    case = gf.load_case(*files(), strict=True)
    assert case.unplaced == ()
    refuse_doubtful_start(case, basis_of(with_start_checked(gf.build_model(case))))


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (
            {"raw": ("0.97000,   0.000", "0.09700,   0.000")},
            "branch 1-3:1 (revision_33.raw:17): turns",
        ),
        ({"raw": (", 60.00", ", 600.0")}, "the case: base frequency is 600 Hz, usually 50 or 60"),
        ({"raw": ("    70.000,    20.000", "   700.000,    20.000")}, "above PT 95 MW"),
        (
            {"dyr": ("5.0000       0.0000", "50.000       0.0000")},
            "genrou 1:1 (plain.dyr:2): inertia (H) is 50 s",
        ),
        ({"dyr": ("1 'TGOV1'  1", "1 'TGOV1'  2")}, "bus 1 has no unit '2', but '1'"),
    ],
)
def test_what_is_a_warning_else_is_refused_with_file_and_line(files, change, fault):
    paths = files(**change)
    gf.load_case(*paths)
    with pytest.raises(gf.CaseError) as raised:
        gf.load_case(*paths, strict=True)
    assert any(fault in line for line in raised.value.faults)


def test_all_of_them_are_listed_at_once(files):
    paths = files(raw=(", 60.00", ", 600.0"), dyr=("5.0000       0.0000", "50.000       0.0000"))
    with pytest.raises(gf.CaseError, match="where warnings are errors: 2 faults"):
        gf.load_case(*paths, strict=True)


def test_records_that_name_no_unit_leave_a_result_without_validation(files):
    case = gf.load_case(*files(dyr=("1 'TGOV1'  1", "1 'TGOV1'  2")))
    basis = basis_of(gf.build_model(case))
    assert not basis.validated
    assert basis.record()["unplaced"] == list(case.unplaced)
    assert basis.reasons == ("1 record of dynamic data at units that are not there",)


def test_unusual_data_are_in_the_record_and_do_not_touch_validation(files):
    case = gf.load_case(*files(dyr=("5.0000       0.0000", "50.000       0.0000")))
    basis = basis_of(gf.build_model(case))
    assert basis.validated
    (line,) = basis.record()["data_doubts"]
    assert line.startswith("genrou 1:1 (plain.dyr:2): inertia (H) is 50 s")


def test_an_unstable_start_is_refused(npcc):
    told = replace(npcc, warnings=("the operating point is unstable",), doubts=())
    with pytest.raises(gf.CaseError, match="the operating point is unstable"):
        refuse_doubtful_start(told.case, basis_of(told))


def test_a_built_in_case_can_be_refused(npcc):
    with pytest.raises(gf.CaseError, match=r"two_axis 78:1 .*inertia"):
        refuse_doubtful_case(npcc.case)
