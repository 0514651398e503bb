from __future__ import annotations

import json
import sys

import pytest

import gridfold as gf
from gridfold.cli import main
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.calibrate import (
    ANGLES_DEG,
    COLUMN_NORMS,
    ThresholdKind,
    calibrate,
)

T_END, LAGGED = 3.0, BoundaryCoupling.LAGGED
FAULTS = [gf.BusFault(22, duration=0.1), gf.BusFault(3, duration=0.39)]


@pytest.fixture(scope="module")
def parts(npcc):
    return gf.partition(npcc, range(1, 37))


def worst_error(parts, family, angle_deg, fault):
    """Largest RMS error of the study area, by the functions that users call one by one."""
    detailed = gf.simulate(parts.model, [fault], T_END)
    rule = gf.SwitchingRule(angle_deg)
    run = gf.simulate_adaptive(parts.model, family, rule, [fault], T_END).trajectory
    return gf.compare(detailed, run, parts.study_units).worst


@pytest.mark.parametrize("step", [0.1, 0.9])
@pytest.mark.filterwarnings("ignore::gridfold.StepWarning")
def test_runs_of_a_few_samples_are_not_compared(parts, step):
    with pytest.raises(gf.OptionError, match=r"samples; comparing angles takes 50 or more"):
        calibrate(parts, FAULTS, T_END, gf.ImplicitTrapezoidal(step))


def test_runs_that_the_memory_cannot_hold_together_are_refused(parts, monkeypatch):
    monkeypatch.setenv("GRIDFOLD_MEMORY_GIB", "0.01")
    calibrate_many = FAULTS * 50
    with pytest.raises(gf.OptionError, match="100 runs at once of 301 samples"):
        calibrate(parts, calibrate_many, T_END)


def test_the_angle_found_satisfies_and_one_degree_more_does_not(parts):
    kind = ThresholdKind.PARTITIONED
    family = gf.SmallModels(gf.reduce(parts))
    middle = worst_error(parts, family, 110.0, FAULTS[1]).rms_deg
    result = calibrate(parts, FAULTS, T_END, limit_deg=middle * 1.0001, what=[kind])
    found = result.thresholds[kind]
    errors = [worst_error(parts, family, found.value, fault) for fault in FAULTS]
    assert [e.rms_deg for e in found.errors] == pytest.approx([e.rms_deg for e in errors])
    assert [e.unit for e in found.errors] == [e.unit for e in errors]
    assert found.worst.rms_deg < result.limit_deg
    assert 110 <= found.value < 120
    above = worst_error(parts, family, found.value + 1, FAULTS[1])
    assert above.rms_deg >= result.limit_deg
    assert found.binding.contingency == (FAULTS[1],)
    assert found.binding.unit == above.unit
    assert found.binding.rms_deg == pytest.approx(above.rms_deg)


def test_the_column_norm_found_satisfies_and_the_next_shorter_list_of_machines_does_not(parts):
    kind = ThresholdKind.COLUMN_NORM
    enough = gf.reduce(parts, column_norm=1.1)
    limit = worst_error(parts, enough, 0.0, FAULTS[1]).rms_deg * 1.0001
    result = calibrate(parts, FAULTS, T_END, limit_deg=limit, what=[kind])
    found = result.thresholds[kind]
    assert 1.1 <= found.value < 10
    assert found.value in COLUMN_NORMS
    assert result.column_norm == found.value
    shorter = result.coupling.kept(found.value + 0.1)
    assert len(shorter) < len(result.kept)
    family = gf.reduce(parts, column_norm=found.value + 0.1)
    assert family.kept == shorter
    rejected = [worst_error(parts, family, 0.0, fault).rms_deg for fault in FAULTS]
    assert max(rejected) >= limit
    assert found.binding.rms_deg == pytest.approx(max(rejected))


def test_errors_are_those_of_the_coupling_asked_for(parts):
    kind = ThresholdKind.PARTITIONED
    result = calibrate(parts, FAULTS[1:], T_END, limit_deg=179.0, what=[kind], coupling=LAGGED)
    family = gf.reduce(parts, coupling=LAGGED)
    assert result.boundary is LAGGED
    expected = worst_error(parts, family, 180.0, FAULTS[1])
    assert result.thresholds[kind].worst.rms_deg == pytest.approx(expected.rms_deg)
    exact = worst_error(parts, gf.reduce(parts), 180.0, FAULTS[1])
    assert expected.rms_deg != pytest.approx(exact.rms_deg, rel=1e-6)


def test_thresholds_do_not_depend_on_the_number_of_threads(parts):
    kind = ThresholdKind.WHOLE
    limit = worst_error(parts, gf.whole_system(parts), 60.0, FAULTS[1]).rms_deg * 1.0001
    results = [
        calibrate(parts, FAULTS, T_END, limit_deg=limit, what=[kind], workers=workers)
        for workers in (1, 3)
    ]
    one, many = (result.thresholds[kind] for result in results)
    assert one.value == many.value
    assert one.errors == many.errors
    assert one.binding == many.binding
    # One contingency rejects a threshold: one run for each, but where another takes over.
    assert one.runs <= ANGLES_DEG.index(one.value) + 1 + 2 * len(FAULTS)


def test_there_is_no_threshold_if_even_the_lowest_does_not_satisfy(parts):
    kind = ThresholdKind.WHOLE
    result = calibrate(parts, FAULTS[:1], 1.0, limit_deg=1e-9, what=[kind])
    found = result.thresholds[kind]
    assert found.value is None
    assert found.worst is None
    assert found.errors == ()
    assert found.binding.rms_deg > 1e-9
    assert found.runs == len(ANGLES_DEG)


def test_the_first_value_is_taken_if_it_satisfies_and_nothing_binds(parts):
    result = calibrate(parts, FAULTS, T_END, limit_deg=179.0)
    values = {kind: found.value for kind, found in result.thresholds.items()}
    assert values == {
        ThresholdKind.COLUMN_NORM: 10.0,
        ThresholdKind.PARTITIONED: 180.0,
        ThresholdKind.WHOLE: 180.0,
    }
    assert all(found.binding is None for found in result.thresholds.values())
    assert [str(unit) for unit in result.kept] == ["78:1"]


def test_contingencies_that_are_not_stable_are_left_out_and_listed(parts):
    lost = (gf.BusFault(23, duration=0.6),)
    tripping = [gf.BranchFault("3-4", duration=0.1), gf.LoadStep(7, time=1.0, active_mw=10.0)]
    kind = ThresholdKind.PARTITIONED
    result = calibrate(parts, [lost, tripping], T_END, limit_deg=179.0, what=[kind])
    assert [(item.contingency, item.status) for item in result.left_out] == [
        (lost, gf.Status.LOST_SYNCHRONISM)
    ]
    errors = result.thresholds[kind].errors
    assert [error.contingency for error in errors] == [tuple(tripping)]
    assert result.detailed_runs == 2
    with pytest.raises(gf.OptionError, match="none of the 1 contingencies is stable"):
        calibrate(parts, [lost], T_END)


def test_progress_ends_with_every_stage_complete(parts):
    steps = []
    kind = ThresholdKind.PARTITIONED
    calibrate(parts, FAULTS, T_END, limit_deg=179.0, what=[kind], on_progress=steps.append)
    last = {step.stage: step for step in steps}
    assert list(last) == ["detailed runs", kind.value]
    assert all(step.done == step.total > 0 for step in last.values())


@pytest.mark.parametrize(
    "options", [{"limit_deg": 0.0}, {"limit_deg": float("nan")}, {"column_norm": -1.0}, {"workers": 0}]
)  # fmt: skip
def test_options_that_make_no_sense_are_refused(parts, options):
    with pytest.raises(gf.OptionError):
        calibrate(parts, FAULTS, T_END, **options)


def run_command(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["gridfold", "calibrate", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0, capsys.readouterr()


def test_the_command_writes_thresholds_and_what_binds_them(monkeypatch, capsys):
    code, text = run_command(
        monkeypatch, capsys, "npcc", "--study-buses", "1-36", "--buses", "22",
        "--event", "bus-fault bus=3 duration=0.39", "--t-end", T_END, "--limit", 179, "--json", "-",
    )  # fmt: skip
    assert code == 0
    record = json.loads(text.out)
    assert text.err == ""
    assert set(record["thresholds"]) == {"column-norm", "partitioned", "whole"}
    norm = record["thresholds"]["column-norm"]
    assert (norm["value"], norm["siemens_at_20_kv"]) == (10.0, 2.5)
    buses = [error["events"][0]["bus"] for error in norm["errors"]]
    assert buses == [22, 3]
    assert record["left_out"] == []
    assert record["coupling"] == "exact"
    assert "outputs" not in record


def test_the_command_calibrates_with_coupling_reducer_and_norm_asked_for(monkeypatch, capsys):
    code, text = run_command(
        monkeypatch, capsys, "npcc", "--event", "bus-fault bus=22 duration=0.1", "--t-end", 1,
        "--limit", 179, "--threshold", "partitioned", "--coupling", "lagged", "--reducer", "modal",
        "--order", 80, "--column-norm-siemens", 0.75, "--json", "-",
    )  # fmt: skip
    assert code == 0
    record = json.loads(text.out)
    assert record["coupling"] == "lagged"
    assert record["reducer"] == {"name": "ModalTruncation", "order": 80}
    assert (record["column_norm"], record["kept"]) == (3.0, ["78:1"])


def test_the_command_tells_by_its_exit_code_that_there_is_no_threshold(monkeypatch, capsys):
    code, text = run_command(
        monkeypatch, capsys, "npcc", "--study-buses", "1-36", "--threshold", "whole",
        "--event", "bus-fault bus=22 duration=0.1", "--t-end", 1, "--limit", "1e-9",
    )  # fmt: skip
    assert code == 1
    assert "none" in text.out


@pytest.mark.parametrize("bad", [("--limit", "0"), ("--buses", "999"), ("--event", "nonsense")])
def test_bad_options_of_the_command_end_with_exit_code_2(monkeypatch, capsys, bad):
    code, text = run_command(monkeypatch, capsys, "npcc", "--t-end", 1, *bad)
    assert code == 2
    assert "error" in text.err
