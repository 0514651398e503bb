"""What the terminal tells of criteria."""

from study_stores import ASKED, WICKED, findings, judged_study, small_study

from gridfold.report.criteria_tables import close_by_checks, criteria_table, other_criteria
from gridfold.report.study_tables import study_counts, study_facts
from gridfold.study.judged import judged_figures


def test_a_study_tells_which_criteria_are_violated_how_often(tmp_path):
    with judged_study(tmp_path) as store:
        facts, counts = study_facts(store), study_counts(store)
    assert facts["Criteria"] == f"2 of 3 violate some: {WICKED} (2), damping at least 3 % (1)"
    assert facts["Criteria not judged"] == "in 1: damping at least 3 % (1)"
    assert facts["Other criteria in detail"] == "bus 1 (damping at least 3 %)"
    assert str(counts).endswith("1 failed, 2 violate criteria")
    assert counts.record()["violating"] == 2


def test_without_criteria_everything_is_as_ever(tmp_path):
    with small_study(tmp_path) as store:
        facts, counts = study_facts(store), study_counts(store)
    assert not any(name.startswith("Criteria") for name in facts)
    assert "violating" not in counts.record()
    assert "criteria" not in str(counts)


def test_margins_within_the_largest_error_of_checks_are_close(tmp_path):
    """Checks err by 0.002 in damping: a margin of 0.1 % is within, one of 2 % is not."""
    with judged_study(tmp_path) as store:
        frame = store.frame()
    assert close_by_checks(frame) == {3: str(ASKED[1])}
    assert list(other_criteria(frame)) == ["bus 1 (damping at least 3 %)"]


def test_an_estimated_error_of_angles_counts_twice_for_a_separation():
    import gridfold as gf

    apart = gf.Finding(
        gf.AngleSeparation(110.0), gf.Verdict.KEPT, 108.5, 110.0, 1.5, 1.5 / 110, "deg"
    )
    assert judged_figures([apart], error_deg=0.7)["close"] == ""
    assert judged_figures([apart], error_deg=0.8)["close"] == str(apart.criterion)
    assert judged_figures([apart])["close"] == ""
    assert judged_figures([]) == {}


def test_the_smallest_margin_is_that_of_the_worst_criterion():
    figures = judged_figures(findings(voltage=0.63, damping=3.6))
    assert figures["least_margin"] == (0.63 - 0.7) / 0.7
    assert (figures["violations"], figures["violated"]) == (1, WICKED)


def test_the_table_of_a_run_has_a_row_for_each_criterion():
    table = criteria_table(findings(0.65, None))
    cells = [list(map(str, column.cells)) for column in table.columns]
    assert cells[1] == ["kept", "not judged", "violated"]
    assert cells[2] == ["+0.68 s", "", "-0.05 p.u."]
