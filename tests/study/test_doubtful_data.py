"""Studies of data that are hardly meant: said at the start and in the results, or refused."""

from pathlib import Path

import pytest

import gridfold as gf
from gridfold.io.study_store import StudyStore
from gridfold.report.study_record import _warnings
from gridfold.report.study_tables import study_facts
from gridfold.study import run_study
from gridfold.study.study_file import parse_study

OWN = Path(__file__).parents[1] / "io"


@pytest.fixture
def content(tmp_path):
    """A governor of no unit, and a stabilizer with the sign of its gain turned round."""
    dyr = tmp_path / "odd.dyr"
    text = (OWN / "dyr" / "plain.dyr").read_text()
    dyr.write_text(
        text.replace("1 'TGOV1'  1", "1 'TGOV1'  2")
        .replace("5.0000       0.0000", "50.000       0.0000")
        .replace("2 2  5  0.1", "2 2  -100  0.1")
    )
    return {
        "schema": 1,
        "case": {"source": str(OWN / "raw" / "revision_33.raw"), "dyr": str(dyr)},
        "contingencies": {"bus_faults": "3", "clearing_time": 0.05},
        "model": {"kind": "detailed"},
        "run": {"t_end": 0.1},
    }


def test_a_study_says_at_its_start_what_is_doubtful_and_keeps_it(content, tmp_path):
    told = []
    folder = tmp_path / "results"
    run_study(parse_study(content), folder, count=1, on_progress=told.append)
    warnings = [line for progress in told for line in progress.warnings]
    no_unit, unstable = warnings
    assert no_unit == "TGOV1 1:2 (odd.dyr:7): bus 1 has no unit '2', but '1'"
    assert unstable.startswith("the operating point is unstable: mode")
    assert [bool(progress.warnings) for progress in told].index(True) < len(told) - 1
    with StudyStore.read(folder) as store:
        settings, facts = store.identity["settings"], study_facts(store)
        page = _warnings(store.identity)
    assert settings["validated"] is False
    assert no_unit in facts["Not validated"]
    assert unstable in facts["Warnings (1)"]
    assert "inertia (H)" in facts["Unusual data (1)"]
    assert page["unsupported"] == [no_unit]
    assert page["others"][0] == unstable


def test_strict_in_the_study_file_refuses_all_of_them(content, tmp_path):
    content["case"]["strict"] = True
    with pytest.raises(gf.CaseError) as raised:
        run_study(parse_study(content), tmp_path / "results", count=1)
    assert len(raised.value.faults) == 3
    assert not (tmp_path / "results").exists()
