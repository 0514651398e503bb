import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from study_stores import (
    REPLACED,
    UNITS,
    WICKED,
    failed,
    finish,
    new_store,
    small_study,
    stable,
    watched,
)

import gridfold as gf
from gridfold.io.event_records import event_record
from gridfold.io.study_store import StudyStore
from gridfold.report.event_words import event_places, event_words
from gridfold.report.study_file_text import study_file_text
from gridfold.report.study_record import packed, study_record
from gridfold.report.study_report import write_report


def record_of(store: StudyStore, **options: Any) -> dict[str, Any]:
    with store:
        return study_record(store, **options)


def values_of(item: dict[str, Any]) -> np.ndarray:
    steps = np.frombuffer(base64.b64decode(item["content"]), "<i2")
    return np.where(steps == -32768, np.nan, steps * item["factor"])


class Page(HTMLParser):
    """Elements of a page, and the texts of its scripts by id."""

    def __init__(self, text: str):
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: dict[str | None, str] = {}
        self._script: str | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._script = dict(attrs).get("id") if tag == "script" else None

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] == "script" and self._script:
            self.scripts[self._script] = self.scripts.get(self._script, "") + data


def page_of(store: StudyStore, path: Path) -> Page:
    with store:
        write_report(store, path)
    return Page(path.read_text(encoding="utf-8"))


def test_contingencies_are_ranked_unstable_first_then_by_separation(tmp_path):
    record = record_of(small_study(tmp_path))
    number = record["fields"].index("number")
    assert [row[number] for row in record["rows"]] == [4, 2, 5, 1, 3]
    assert record["counts"] == {"total": 5, "stable": 2, "unstable": 2, "failed": 1, "waiting": 0}
    assert record["finished"]


def test_accuracy_is_that_of_the_checked_contingencies(tmp_path):
    accuracy = record_of(small_study(tmp_path))["accuracy"]
    assert (accuracy["checked"], accuracy["compared"], accuracy["other_verdict"]) == (1, 1, [])
    assert accuracy["largest_rms_deg"] == accuracy["median_rms_deg"] == 1.25
    assert (accuracy["worst_name"], accuracy["worst_machine"]) == ("bus 1", "2:1")


def test_another_verdict_of_the_detailed_run_is_told(tmp_path):
    store = new_store(tmp_path, 1)
    result = stable(1, 20.0)
    store.add([result._replace(figures={**result.figures, "checked": "lost_synchronism"})])
    assert record_of(store)["accuracy"]["other_verdict"] == ["bus 1"]


def test_curves_keep_their_values_and_their_gaps(tmp_path):
    record = record_of(small_study(tmp_path))
    curves = record["curves"][1]
    assert curves["units"] == list(UNITS)
    assert set(curves["runs"]) == {"run", "detailed", "linear"}
    times = np.array(record["times"][curves["runs"]["run"]["times"]])
    angles = values_of(curves["runs"]["run"]).reshape(3, -1)
    np.testing.assert_allclose(angles[0], 30 * np.sin(4 * times), atol=0.006)
    assert np.isnan(angles[2, 20:]).all()
    assert not np.isnan(angles[:2]).any()
    np.testing.assert_allclose(values_of(curves["error"]), 1.5, atol=1e-4)
    assert curves["switches"] == [
        [0.0, "detailed", "fault on"],
        [0.1, "retained", "within the threshold"],
    ]
    assert len(record["times"]) == 1  # all runs have the same
    assert 3 not in record["curves"]


@pytest.mark.parametrize("largest", [0.0, 1.0, 180.0, 1e5])
def test_packed_samples_are_within_half_a_step(largest):
    values = np.linspace(-largest, largest, 101)
    item = packed(values)
    assert np.max(np.abs(values_of(item) - values)) <= 0.51 * item["factor"]
    assert item["factor"] <= max(0.01, largest / 31999)


def test_curves_are_those_of_the_first_of_the_ranking_as_far_as_there_is_room(tmp_path):
    record = record_of(small_study(tmp_path), room=800)
    assert set(record["curves"]) == {4, 2}  # 328 characters each, and as many of what was watched
    assert record["some_left_out"]


def test_what_was_watched_has_a_panel_and_a_factor_a_kind(tmp_path):
    found = record_of(small_study(tmp_path))
    assert "watched" not in found["curves"][1]
    record, curves = found["curves"][2]["watched"], watched()
    np.testing.assert_allclose(found["times"][record["times"]], curves["watched_times"], atol=1e-5)
    assert record["left_out"] == 4
    flow, voltage, interface = record["panels"]
    assert (flow["axis"], flow["labels"]) == ("Flow into the line (MW)", ["1-2"])
    assert (voltage["labels"], interface["labels"]) == (["7", "9"], [WICKED])
    values = curves["watched_values"]
    np.testing.assert_allclose(values_of(flow), values[0], atol=1000 / 32000)
    np.testing.assert_allclose(values_of(voltage), values[1:3].ravel(), atol=1 / 32000)


def test_clearing_times_of_the_paper_for_its_own_case_only(tmp_path):
    record = record_of(small_study(tmp_path / "npcc"))
    assert record["paper"]["times"] == {1: 0.13, 2: 0.13, 3: 0.39, 4: 0.12, 5: 0.09}
    assert record_of(new_store(tmp_path / "other", case="other"))["paper"] is None


def test_replaced_models_are_listed(tmp_path):
    told = record_of(new_store(tmp_path, **REPLACED))["warnings"]
    assert not told["validated"]
    assert told["replacements"] == [
        "GENTRA: replaced by a classical machine, 2 records from 3:1, 25.0% of generation"
    ]


def test_map_has_the_machines_that_are_kept(tmp_path):
    found = record_of(new_store(tmp_path))["map"]
    assert found["kept"] == [3]
    assert not found["geographic"]
    assert len(found["buses"]) == 5


@pytest.mark.parametrize("kind", ["empty", "failed", "unfinished", "detailed"])
def test_any_study_has_a_page(tmp_path, kind):
    store = new_store(tmp_path, 3)
    if kind == "detailed":
        for name in ("column_norm", "angle_deg", "kept", "order", "bound"):
            settings = store.identity["settings"]
            settings.pop(name)
            store.tell("settings", settings | {"model": "detailed"})
    if kind == "failed":
        store.add([failed(number) for number in (1, 2, 3)])
        finish(store)
    if kind in ("unfinished", "detailed"):
        store.add([stable(2, 20.0)])
    record = json.loads(page_of(store, tmp_path / "report.html").scripts["record"])
    counts = record["counts"]
    assert counts["total"] == 3
    assert counts["waiting"] == {"empty": 3, "failed": 0, "unfinished": 2, "detailed": 2}[kind]
    assert record["finished"] == (kind == "failed")


def test_page_loads_nothing(tmp_path):
    path = tmp_path / "report.html"
    page = page_of(small_study(tmp_path / "study"), path)
    assert not [
        item for tag, item in page.elements if tag in ("script", "img", "iframe") and "src" in item
    ]
    links = [item["href"] for tag, item in page.elements if tag in ("link", "a")]
    assert all(link.startswith(("#", "data:")) for link in links)
    styles = re.search(r"<style>(.*?)</style>", path.read_text(encoding="utf-8"), re.DOTALL)
    assert styles is not None
    assert "url(" not in styles[1]
    assert "@import" not in styles[1]
    policy = next(item for tag, item in page.elements if "http-equiv" in item)
    assert "default-src 'none'" in policy["content"]


def test_names_cannot_become_elements(tmp_path):
    page = page_of(small_study(tmp_path), tmp_path / "report.html")
    assert not [tag for tag, _ in page.elements if tag in ("b", "areas")]
    assert sum(tag == "script" for tag, _ in page.elements) == 3
    record = json.loads(page.scripts["record"])
    assert record["rows"][0][record["fields"].index("name")] == f"bus 4 {WICKED}"


def test_study_file_is_told_as_toml():
    import tomllib

    content = {
        "name": 'a "name"',
        "case": {"dyr": None, "loads": "z", "devices": []},
        "contingency": [{"name": "x", "events": [{"kind": "bus-fault", "bus": 1}]}],
    }
    told = tomllib.loads(study_file_text(content))
    content["case"].pop("dyr")
    assert told == content


def test_every_kind_of_event_has_words_of_its_own():
    events = [
        gf.BranchFault("3-2", 1.0, 0.1, far_duration=0.4), gf.BranchOpenEnd("3-2", 3, 1.0),
        gf.LoadShed(0.1, areas="1", buses="7", time=1.0), gf.ShuntTrip(7, "S1", 1.0),
        gf.ShuntClose(7, time=2.0), gf.ShuntStep(7, 50.0, time=1.0),
        gf.SetParameter(7, "voltage_reference", 1.02, time=1.0),
        gf.SetParameter(7, "inertia", change=-0.5, time=1.0), gf.Redispatch(-50.0, zones="3"),
    ]  # fmt: skip
    records = [event_record(event) for event in events]
    assert [event_words(record) for record in records] == [
        "three-phase fault on branch 3-2 at bus 3 from 1 s for 0.1 s, cleared by tripping the branch; "
        "its second end opens after 0.4 s",
        "branch 3-2 opens at bus 3 alone at 1 s",
        "10 % of the load in buses 7 and areas 1 is shed at 1 s",
        "shunt 7:S1 trips at 1 s",
        "shunt 7:1 is closed at 2 s",
        "a shunt of 50 Mvar and 0 MW is added at bus 7 at 1 s",
        "voltage_reference of unit 7:1 is set to 1.02 at 1 s",
        "inertia of unit 7:1 changes by -0.5 at 1 s",
        "units in zones 3 give -50 MW from the start",
    ]
    assert event_places(records[:2]) == {"buses": [3], "branches": [[3, 2, 0.0], [3, 2, None]]}


def test_events_in_words_and_places():
    events = [
        {
            "kind": "branch-fault",
            "branch": "3-2:1",
            "start": 0.0,
            "duration": 0.1,
            "fraction": 1.0,
            "resistance": 0.0,
            "reactance": 0.0,
            "trip": True,
        },
        {"kind": "machine-trip", "bus": 7, "id": "1", "time": 1.0},
    ]
    assert [event_words(event) for event in events] == [
        "three-phase fault on branch 3-2:1 at bus 2 from 0 s for 0.1 s, cleared by tripping the branch",
        "machine 7:1 trips at 1 s",
    ]
    assert event_places(events) == {"buses": [7], "branches": [[3, 2, 1.0]]}
