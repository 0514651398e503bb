"""Criteria of a study: columns, curves of what decided, refusals."""

import json

import numpy as np
import pytest

import gridfold as gf
from gridfold.io.study_store import StudyStore
from gridfold.study.study_file import json_schema, parse_study

STUDY = {
    "schema": 1,
    "contingencies": {"bus_faults": "3", "clearing_time": 0.1},
    "contingency": [
        {"name": "far", "events": [{"kind": "bus-fault", "bus": 78, "duration": 0.4}]},
        {"name": "long", "events": [{"kind": "bus-fault", "bus": 26, "duration": 0.5}]},
    ],
    "criteria": [
        {"preset": "voltage back to 0.9 within 1 s"},
        {"kind": "voltage-dip", "level": 0.95, "name": "dip"},
        {"kind": "angle-separation", "limit_deg": 110},
    ],
    "model": {"kind": "detailed"},
    "run": {"t_end": 2.0},
}


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "judged"
    gf.run_study(parse_study(STUDY), folder, count=1)
    with StudyStore.read(folder) as store:
        yield store


def test_columns_say_which_criteria_are_violated_and_by_how_much(judged):
    row = judged.frame().set_index("name").loc["bus 3"]
    model = gf.build_model(gf.load_case("npcc"))
    run = gf.simulate(model, [gf.BusFault(3, duration=0.1)], t_end=2.0)
    voltage = np.abs(run.bus_voltage(range(1, 37)))[run.times >= 0.1 - 1e-9]
    assert row["stable"]
    assert (row["violations"], row["violated"], row["not_judged"]) == (1, "dip", "")
    assert row["least_margin"] == pytest.approx((voltage.min() - 0.95) / 0.95, rel=1e-9)
    found = {item["name"]: item for item in json.loads(row["criteria"])}
    assert found["dip"]["margin"] == pytest.approx(voltage.min() - 0.95, rel=1e-9)
    spread = np.ptp(run.rotor_angle_deg(), axis=1).max()
    angles = found["angles within 110 degrees of each other"]
    assert angles["margin"] == pytest.approx(110 - spread, rel=1e-9)


def test_the_verdict_stays_that_of_the_angles(judged):
    frame = judged.frame().set_index("name")
    assert frame["status"].tolist() == ["completed", "lost synchronism", "lost synchronism"]
    assert frame["stable"].tolist() == [True, False, False]
    assert frame.loc["long", "not_judged"] == "voltage back to 0.9 within 1 s; dip"


def test_the_machine_that_decided_is_drawn_wherever_it_is(judged):
    row = judged.frame().set_index("name").loc["far"]
    curves = judged.curves(int(row["number"]))
    units = curves["units"].tolist()
    assert row["critical_machine"] == "82:1"
    assert "82:1" in curves["units_outside"]
    assert all(int(unit.partition(":")[0]) > 36 for unit in curves["units_outside"])
    last = curves["run_angles"][-1, units.index("82:1")]
    assert abs(last) > 180
    assert last == pytest.approx(row["largest_angle_deg"], abs=1e-3)


def test_the_curve_of_a_violated_criterion_shows_what_it_says(judged):
    row = judged.frame().set_index("name").loc["bus 3"]
    curves = judged.curves(int(row["number"]))
    found = next(item for item in json.loads(row["criteria"]) if item["name"] == "dip")
    values = curves["decided_values"][curves["decided_names"].tolist().index(found["signal"])]
    after = curves["decided_times"] >= 0.1 - 1e-6
    assert values[after].min() == pytest.approx(found["value"], abs=1e-6)
    limits = dict(zip(curves["limit_values"], curves["limit_names"], strict=True))
    assert limits[0.95] == "voltage_pu"


def test_an_unstable_run_has_no_nadir(judged):
    frame = judged.frame().set_index("name")
    assert frame["nadir_hz"].notna().tolist() == [True, False, False]
    assert frame["highest_hz"].notna().tolist() == [True, False, False]


def test_the_change_of_an_angle_is_not_the_angle(judged):
    row = judged.frame().set_index("name").loc["far"]
    model = gf.build_model(gf.load_case("npcc"))
    run = gf.simulate(model, [gf.BusFault(78, duration=0.4)], t_end=2.0)
    angle = run.rotor_angle_deg(["82:1"], gf.AngleReference.CENTRE_OF_INERTIA)[:, 0]
    assert row["largest_angle_deg"] == pytest.approx(angle[np.abs(angle).argmax()])
    assert row["largest_angle_change_deg"] == pytest.approx(angle[-1] - angle[0])


def test_a_machine_off_speed_has_its_speed_drawn(tmp_path):
    study = {
        **STUDY,
        "criteria": [],
        "contingencies": {"bus_faults": "none"},
        "contingency": STUDY["contingency"][1:],
        "run": {"t_end": 1.0, "speed_limit": 0.05},
    }
    gf.run_study(parse_study(study), tmp_path / "out", count=1)
    with StudyStore.read(tmp_path / "out") as store:
        row, curves = store.frame().iloc[0], store.curves(1)
    assert row["status"] == "off speed"
    assert row["violated"] is None or str(row["violated"]) == "<NA>"
    assert curves["decided_names"].tolist() == [f"speed_pu:{row['critical_machine']}"]
    assert abs(curves["decided_values"][0, -1] - 1) > 0.05
    assert curves["limit_values"] == pytest.approx([0.95, 1.05])


@pytest.mark.parametrize(
    ("criterion", "message"),
    [
        ({"kind": "voltage-dip"}, "voltage-dip needs level"),
        ({"kind": "damping", "percnt": 3}, "did you mean 'percent'"),
        ({"preset": "damping at least 4 %"}, "did you mean"),
        ({}, "kind or preset is missing"),
    ],
)
def test_wrong_criteria_are_told_with_their_line(tmp_path, criterion, message):
    file = tmp_path / "study.toml"
    body = "\n".join(f"{key} = {json.dumps(value)}" for key, value in criterion.items())
    file.write_text(
        f'schema = 1\n[[criteria]]\npreset = "damping at least 3 %"\n\n[[criteria]]\n{body}\n'
    )
    with pytest.raises(gf.CaseFileError) as caught:
        gf.load_study(file)
    assert f"{file}:5: criteria.1: " in str(caught.value)
    assert message in str(caught.value)


def test_criteria_that_do_not_fit_the_case_are_refused_before_anything_runs(tmp_path):
    study = STUDY | {"criteria": [{"kind": "voltage-dip", "level": 0.8, "buses": "999"}]}
    with pytest.raises(gf.OptionError, match="there is no bus 999"):
        gf.run_study(parse_study(study), tmp_path / "out", count=1)
    assert not (tmp_path / "out").exists()


def test_the_schema_knows_the_fields_of_criteria():
    item = json_schema()["properties"]["criteria"]["items"]
    assert "within" in item["properties"]
    assert not item["additionalProperties"]


def test_runs_side_by_side_are_judged_as_one_by_one(tmp_path):
    """Voltages need every state: runs that advance together keep them where criteria ask."""
    folders = {}
    for batch in ("auto", "off"):
        study = STUDY | {
            "contingencies": {"bus_faults": "1-6", "clearing_time": 0.05},
            "contingency": [],
            "run": {"t_end": 1.0, "batch": batch},
        }
        folders[batch] = tmp_path / batch
        gf.run_study(parse_study(study), folders[batch], count=1)
    found = {}
    for batch, folder in folders.items():
        with StudyStore.read(folder) as store:
            found[batch] = store.frame()
    columns = ["violated", "not_judged", "violations"]
    assert found["auto"][columns].equals(found["off"][columns])
    np.testing.assert_allclose(
        found["auto"]["least_margin"].astype(float),
        found["off"]["least_margin"].astype(float),
        atol=1e-9,
    )
