"""The report of clearing times: every place is in it, each once, and no text is markup."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from clearing_maps import ROWS, WICKED, about, bus_row

import gridfold as gf
from gridfold.io.clearing_store import ClearingStore
from gridfold.report.clearing_plot import draw_clearing_times
from gridfold.report.clearing_record import clearing_record
from gridfold.report.clearing_report import write_clearing_report, write_report_of_folder


def shown(record):
    return [dict(zip(record["fields"], row, strict=True)) for row in record["rows"]]


def test_every_place_is_in_the_record_the_shortest_first_then_never_then_failed():
    record = clearing_record(about(), ROWS)
    assert [row["place"] for row in shown(record)] == [
        "bus 5", "line 1-2 at 2", "bus 2", "line 1-2 at 1", "bus 1", "bus 3", "bus 4",
    ]  # fmt: skip
    assert [row["cct_ms"] for row in shown(record)] == [0, 20, 30, 120, 250, 2000, None]
    assert record["counts"] == {"total": 7, "waiting": 0, "never": 1, "failed": 1}


def test_every_time_is_within_the_limits_of_its_class_and_classes_grow_lighter():
    times = np.random.default_rng(1).gamma(2.0, 0.15, 200).round(2)
    rows = [bus_row(1, float(seconds)) for seconds in times]
    record = clearing_record(about(rows), rows)
    classes = record["classes"]
    for row in shown(record):
        own = classes[row["group"]]
        assert own["above"] is None or row["cct_ms"] > own["above"]
        assert own["up_to"] is None or row["cct_ms"] <= own["up_to"]
    assert sum(item["count"] for item in classes) == 200
    assert len(classes) >= 5
    luminance = [_luminance(item["color"]) for item in classes]
    assert luminance == sorted(luminance)
    assert np.diff(luminance).min() > 0.02


def _luminance(color: str) -> float:
    """Relative luminance of a colour (WCAG 2.1)."""
    parts = np.array([int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("times", [[], [None], [0.1], [0.1, 0.1], [0.0, 0.0, 0.0]])
def test_few_or_equal_times_have_a_class_that_holds_them(times):
    rows = [bus_row(1, seconds, reason=None if seconds is not None else "no") for seconds in times]
    record = clearing_record(about(rows), rows)
    draw_clearing_times(record)
    assert len(record["rows"]) == len(times)
    assert all(row["group"] in (0, "failed") for row in shown(record))


def test_a_fault_at_the_end_of_a_line_is_drawn_on_the_line_nearer_to_that_end():
    places = {row["place"]: (row["x"], row["y"]) for row in shown(clearing_record(about(), ROWS))}
    assert places["bus 1"] == (1.0, 50.5)
    near, far = places["line 1-2 at 1"], places["line 1-2 at 2"]
    assert 1 < near[0] < 1.5 < far[0] < 2
    assert near[1] == pytest.approx(50.5 - 0.5 * (near[0] - 1))


def test_the_map_shows_the_part_with_places_first_if_it_is_a_part():
    few = clearing_record(about(buses=40), ROWS)["view"]
    assert few["x"][0] < 1 < 5 < few["x"][1] < 10
    assert clearing_record(about(), ROWS)["view"] is None


def test_no_name_or_reason_ends_the_page_or_is_markup(tmp_path):
    path = tmp_path / "map.html"
    write_clearing_report(clearing_record(about(case=f"c{WICKED}"), ROWS), path)
    text = path.read_text(encoding="utf-8")
    assert "<img src=x" not in text
    assert "\u202e" not in text
    found = re.search(
        r'<script type="application/json" id="record">(.*?)</script>', text, re.DOTALL
    )
    record = json.loads(found[1])
    assert shown(record)[2]["name"] == WICKED.replace("\u202e", "\\u202e")


def test_a_folder_has_a_page_while_the_work_goes_on(tmp_path):
    with ClearingStore.create(tmp_path / "map", about(faults=[])) as store:
        store.add({"number": 0, **ROWS[0]})
        write_report_of_folder(store.folder, tmp_path / "map.html")
        record = clearing_record(store.identity, store.rows())
    assert record["counts"]["waiting"] == len(ROWS) - 1
    with pytest.raises(gf.OptionError, match="no clearing times"):
        write_report_of_folder(tmp_path, tmp_path / "other.html")


def test_a_picture_has_a_spot_for_every_place():
    figure = draw_clearing_times(clearing_record(about(), ROWS))
    spots = figure.axes[0].collections[1:]
    assert sum(len(item.get_offsets()) for item in spots) == len(ROWS)
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "stable up to 2000 ms: 1" in labels
    assert "failed: 1" in labels
    assert sum(int(label.rpartition(": ")[2]) for label in labels) == len(ROWS)
    bars = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert len(bars) == 5
