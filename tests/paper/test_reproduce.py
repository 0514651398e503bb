from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial

import pytest

import gridfold as gf
from gridfold.cli import main, reproduce
from gridfold.paper import published
from gridfold.paper.calibrated import calibrated_rows
from gridfold.paper.record import Reproduction, paper_means, system_facts
from gridfold.paper.runs import (
    OURS,
    PRINTED,
    Clearing,
    SmallRun,
    Thresholds,
    bus_row,
    bus_rows,
    fault_errors,
    prepare,
)
from gridfold.paper.tables import (
    ADAPTIVE,
    ADAPTIVE_PRINTED,
    DETAILED,
    means,
    table_2,
    table_3,
    table_4,
    verdicts,
)
from gridfold.report.reproduction import reproduction_tables
from gridfold.report.reproduction_figures import plot_map, plot_switches

ROW_KEYS = {
    "bus", "generator", "paper_generator", "cct_s", "margin_ms", "paper_cct_s", "rmse_deg",
    "rmse_deg_calibrated", "paper_rmse_deg",
}  # fmt: skip


@pytest.fixture(scope="module")
def study(npcc):
    return prepare(npcc)


@pytest.fixture(scope="module")
def rows(study):
    return bus_rows(study, (3, 23, 17))


def test_counts_are_those_of_the_paper(study):
    facts = system_facts(study)
    assert (facts.generators, facts.external_generators) == (48, 39)
    assert facts.external_states == 351
    assert (facts.nonlinear_functions, facts.nonlinear_functions_whole) == (156, 192)
    assert facts.linearized_functions == 136
    assert facts.kept_generator_buses == (42, 50, 51, 78, 134)
    assert facts.reference_generator_bus == 123


def test_order_at_the_papers_bound_is_near_the_papers(study):
    facts = system_facts(study)
    assert 145 <= facts.order <= 155
    assert 0 < facts.hankel_bound <= published.HANKEL_BOUND


def test_paper_numbers_agree_with_the_means_that_follow_from_its_table():
    assert len(published.TABLE_1) == 36
    assert paper_means() == pytest.approx((4.07, 1.23, 0.85), abs=0.006)


def test_rows_come_in_the_order_asked_for_with_stable_clearing_times(rows):
    assert [row.bus for row in rows] == [3, 23, 17]
    assert [row.cct for row in rows] == pytest.approx([0.39, 0.20, 0.03])
    for row in rows:
        assert row.errors.lost_synchronism == ()
        assert 0 <= row.margin_ms < 10


def test_adaptive_errors_are_below_the_linear_ones_after_large_disturbances(rows):
    for row in rows[:2]:
        linear, partitioned, whole = (row.errors.worst_deg(kind) for kind in PRINTED)
        assert linear > 10
        assert partitioned < 6
        assert whole < 7.5


def test_our_form_is_more_exact_than_the_printed_one_after_large_disturbances(rows):
    for row in rows[:2]:
        for ours, printed in zip(OURS, PRINTED, strict=True):
            assert row.errors.worst_deg(ours) < row.errors.worst_deg(printed)
        assert row.errors.worst_deg(SmallRun.RETAINED) < row.errors.worst_deg(SmallRun.LINEAR)


def test_runs_of_one_column_stand_beside_the_same_column_of_the_paper():
    columns = [kind.column for kind in OURS]
    assert columns == list(published.Errors._fields)
    assert [kind.column for kind in PRINTED] == columns
    assert SmallRun.LINEAR_LAGGED.column == "linear"


def test_a_row_is_the_worst_machine_of_a_comparison_made_by_hand(study, rows):
    events = [gf.BusFault(3, duration=0.39)]
    detailed = gf.simulate(study.model, events)
    other = study.run(SmallRun.ADAPTIVE_PARTITIONED, events).trajectory
    units = study.parts.study_units
    error = other.rotor_angle_deg(units) - detailed.rotor_angle_deg(units)
    rms = (error**2).mean(axis=0) ** 0.5
    assert rows[0].errors.worst_deg(SmallRun.ADAPTIVE_PARTITIONED) == pytest.approx(rms.max())
    assert rows[0].errors.worst_unit(SmallRun.ADAPTIVE_PARTITIONED) == units[rms.argmax()]


def test_a_fault_cleared_too_late_is_marked_and_left_out_of_means(study, rows):
    late = fault_errors(study, [gf.BusFault(23, duration=0.4)], 0.4)
    assert late.lost_synchronism == (DETAILED,)
    lost = replace(rows[1], errors=late)
    both = means([rows[0], lost], SmallRun.LINEAR)
    assert both == means([rows[0]], SmallRun.LINEAR)
    record = Reproduction(system_facts(study), Clearing.OWN, table1=(lost,)).record()
    assert record["table1"][0]["lost_synchronism"] == [DETAILED]
    assert record["table1"][0]["rmse_deg"]["linear"] is None


def test_papers_clearing_time_is_used_where_it_is_asked_for(study):
    row = bus_row(study, 25, Clearing.PAPER)
    assert row.errors.clearing == published.TABLE_1[25].cct
    assert row.margin_ms < 0
    assert row.errors.lost_synchronism == (DETAILED,)
    with pytest.raises(gf.OptionError, match="no clearing time for bus 40"):
        bus_row(study, 40, Clearing.PAPER)


def test_state_errors_are_those_of_the_worst_machine_at_bus_23(rows):
    second = table_2(rows[0].errors)
    assert [row.published.symbol for row in second][:3] == ["δ", "Pm", "Pgv"]
    assert {row.unit.bus for row in second} == {23}
    worst = rows[0].errors.worst_deg(SmallRun.LINEAR)
    assert second[0].errors[SmallRun.LINEAR] == pytest.approx(worst)
    for kind in SmallRun:
        assert 0 < second[0].errors[kind] <= rows[0].errors.worst_deg(kind) * (1 + 1e-12)
    for row in second:
        linear = row.errors[SmallRun.LINEAR]
        for kind in ADAPTIVE:
            assert row.reduction_percent(kind) == pytest.approx(
                100 * (1 - row.errors[kind] / linear)
            )
            assert row.reduction_percent(kind) > 0
        for kind in ADAPTIVE_PRINTED:
            assert row.errors[kind] < 0.4 * row.errors[SmallRun.LINEAR_PRINTED]


@pytest.mark.parametrize("kinds", [OURS, PRINTED])
def test_times_of_all_models_are_measured_in_one_run(study, kinds):
    third = table_3(study, Clearing.PAPER, repetitions=1, kinds=kinds)
    assert (third["large"].bus, third["small"].bus) == (3, 17)
    for column in third.values():
        assert list(column.ratios) == [DETAILED, *(kind.value for kind in OURS)]
        assert column.ratios[DETAILED] == 1
        assert min(column.seconds.values()) > 0


def test_new_operating_conditions_stay_below_six_degrees(study):
    fourth = table_4(study)
    assert len(fourth) == 4
    for row in fourth:
        assert row.errors.lost_synchronism == ()
        for kind in ADAPTIVE:
            assert row.errors.worst_deg(kind) < 6


def test_verdicts_follow_the_data(rows):
    found = {item.claim: item for item in verdicts(rows)}
    largest = next(item for claim, item in found.items() if "largest disturbance" in claim)
    size = {row.bus: row.errors.largest_deviation_deg for row in rows}
    assert largest.holds is (max(size, key=size.get) == 3)
    worst = [item for claim, item in found.items() if "worst after the bus-3 fault" in claim]
    assert len(worst) == len(PRINTED)
    swapped = [replace(row, bus={3: 17, 17: 3}.get(row.bus, row.bus)) for row in rows]
    turned = [item for item in verdicts(swapped) if "largest disturbance" in item.claim]
    assert not turned[0].holds


def test_other_thresholds_give_other_errors_and_other_kept_machines(study, rows):
    tight = study.with_thresholds(Thresholds(2.0, 30.0, 3.0))
    assert [unit.bus for unit in tight.external.kept] == [78]
    row = calibrated_rows(tight, rows[1:2])[0]
    assert row.errors is rows[1].errors
    assert set(row.calibrated.comparisons) == set(ADAPTIVE_PRINTED)
    kind = SmallRun.ADAPTIVE_WHOLE_PRINTED
    assert row.calibrated.worst_deg(kind) != pytest.approx(row.errors.worst_deg(kind))
    assert system_facts(tight).linearized_functions == 152


def test_a_version_without_a_threshold_is_left_out_and_cannot_be_run(study, rows):
    half = study.with_thresholds(Thresholds(1.0, 67.0, None))
    row = calibrated_rows(half, rows[2:])[0]
    partitioned, whole = ADAPTIVE_PRINTED
    expected = row.errors.worst_deg(partitioned)
    assert row.calibrated.worst_deg(partitioned) == pytest.approx(expected)
    assert row.calibrated.worst_deg(whole) is None
    for kind in (whole, SmallRun.ADAPTIVE_WHOLE):
        with pytest.raises(gf.OptionError, match="no angle threshold"):
            half.run(kind, [])


def test_record_keeps_its_contract_and_is_json(study, rows):
    result = Reproduction(
        system_facts(study), Clearing.OWN, table1=tuple(rows), table2=tuple(table_2(rows[0].errors))
    )
    record = json.loads(json.dumps(result.record(), allow_nan=False))
    assert set(record) >= {
        "system", "system_calibrated", "table1", "table2", "table3", "table3_printed", "table4",
        "verdicts",
    }  # fmt: skip
    assert set(record["table1"][0]) >= ROW_KEYS
    assert record["table1"][0]["generator"].startswith("23:")
    assert record["table1"][0]["rmse_deg"].keys() == {kind.value for kind in SmallRun}
    assert set(record["table1"][0]["rmse_deg_calibrated"]) == {kind.value for kind in ADAPTIVE}
    assert set(record["table2"][0]) >= {
        "state", "unit", "linear", "adaptive_partitioned", "adaptive_whole", "paper"
    }  # fmt: skip
    assert len(record["table2"]) == 9
    assert len(reproduction_tables(result)) == 4


def test_switches_and_the_map_are_drawn(study, tmp_path):
    run = study.run(SmallRun.ADAPTIVE_WHOLE, [gf.BusFault(17, duration=0.03)])
    plot_switches(study, [(SmallRun.ADAPTIVE_WHOLE, run)], tmp_path / "switches.png")
    plot_map(study, tmp_path / "map.png")
    for name in ("switches", "map"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_draws_the_figure_asked_for_and_no_other(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "argv", ["gridfold", "reproduce", "fig4", "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    assert [path.name for path in tmp_path.iterdir()] == ["fig4.png"]


def test_times_of_our_form_and_of_the_printed_one_are_told_beside_the_papers(
    study, monkeypatch, capsys
):
    monkeypatch.setattr(reproduce, "prepare", lambda model: study)
    monkeypatch.setattr(reproduce, "table_3", partial(table_3, repetitions=1))
    arguments = ["gridfold", "reproduce", "table3", "--clearing", "paper", "--json", "-"]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as end:
        main()
    record = json.loads(capsys.readouterr().out)
    assert not end.value.code
    columns = [DETAILED, *(kind.value for kind in OURS)]
    for name in ("table3", "table3_printed"):
        assert set(record[name]) == {"large", "small"}
        for column, bus in (("large", 3), ("small", 17)):
            found = record[name][column]
            assert (found["bus"], found["clearing_s"]) == (bus, published.TABLE_1[bus].cct)
            assert list(found["seconds"]) == list(found["ratios"]) == columns
            assert set(found["paper"]["ratios"]) == set(columns)
    assert record["table3"] != record["table3_printed"]
    assert record["table1"] is record["table4"] is None
