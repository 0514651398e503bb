"""The report of clearing times in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from clearing_maps import ROWS, WICKED, about
from pages_visited import NARROW, WIDE, Visit, check_quiet, overflow, until

from gridfold.report.clearing_record import clearing_record
from gridfold.report.clearing_report import write_clearing_report

#: Spots of places on the map that are drawn.
SPOTS = "#map .scatterlayer .trace path.point"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path: Path = tmp_path_factory.mktemp("clearing") / "map.html"
    write_clearing_report(clearing_record(about(places=8), ROWS), path)
    return path.as_uri()


@pytest.fixture(scope="module")
def visit(browser: Any, address: str) -> Iterator[Visit]:
    found = Visit(browser, address)
    yield found
    check_quiet(found, address)
    found.page.close()


@pytest.fixture
def page(visit: Visit) -> Any:
    visit.page.set_viewport_size({"width": WIDE, "height": 900})
    visit.page.fill("#filter", "")
    visit.page.click("#legend [data-group=all]")
    return visit.page


def places(page: Any) -> list[str]:
    return page.locator("#body tr th button").all_inner_texts()


def test_every_place_is_a_spot_a_row_and_named_as_it_is(page):
    assert len(places(page)) == len(ROWS)
    # The sixth bus is not examined, and has a spot too.
    assert page.locator(SPOTS).count() == len(ROWS) + 1
    assert page.locator("#body").inner_text().count(WICKED[:20]) == 1
    assert page.locator("img").count() == 0
    assert "7 of 8 places are known" in page.inner_text("#banners")


def test_figures_say_where_no_time_is_stable_where_all_are_and_what_failed(page):
    texts = dict(zip(places(page), page.locator("#body tr").all_inner_texts(), strict=True))
    assert "< 10" in texts["bus 5"]
    assert "≥ 2000" in texts["bus 3"]
    assert "failed" in texts["bus 4"]
    assert "250 \u2013 260" in texts["bus 1"]
    assert "26:1" in texts["bus 1"]


@pytest.mark.parametrize(
    ("text", "found"),
    [("line", 2), ("bus 1", 1), ("26:1", 5), ("singular", 1), ("345 kv", 7), ("area 2", 0)],
)
def test_the_filter_looks_into_places_machines_levels_and_reasons(page, text, found):
    page.fill("#filter", text)
    assert len(places(page)) == found
    assert f"{found} of 7 places" in page.inner_text("#caption")


def test_the_legend_shows_one_class_in_map_table_and_bars(page):
    page.click("#legend [data-group=never]")
    assert places(page) == ["bus 3"]
    assert page.is_hidden("#bars")
    page.click("#legend [data-group='0']")
    assert len(places(page)) == page.locator("#bars .bars .point").count() > 0


def test_headings_sort_with_the_places_without_a_limit_behind(page):
    page.click("#heads [data-field=cct_ms] button")
    assert places(page)[0] == "bus 5"
    page.click("#heads [data-field=cct_ms] button")
    assert places(page)[:2] == ["bus 4", "bus 3"]
    page.click("#heads [data-field=lost_ms] button")
    assert set(places(page)[-2:]) == {"bus 3", "bus 4"}
    page.evaluate("shown.sort = null; fill()")


def test_a_row_that_is_chosen_is_named_on_the_map(page):
    page.click("#body tr[data-rank='1']")
    until(page, "document.querySelectorAll('#map .annotation').length === 1")
    assert "line 1-2 at 2" in page.locator("#map .annotation").text_content()
    page.click("#body tr[data-rank='1']")
    until(page, "document.querySelectorAll('#map .annotation').length === 0")


def test_the_page_fits_a_telephone(page):
    page.set_viewport_size({"width": NARROW, "height": 800})
    page.wait_for_timeout(200)
    assert overflow(page) == 0
