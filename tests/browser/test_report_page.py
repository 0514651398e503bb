"""The report of a study in a real browser."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pages_visited import NARROW, WIDE, Visit, check_quiet, overflow, until
from study_stores import (
    REPLACED,
    WICKED,
    failed,
    finish,
    judged_study,
    large_study,
    legend_study,
    new_store,
    small_study,
)

from gridfold.report.study_report import write_report

#: Contingencies of a large study, and seconds of computing in which its page is there.
LARGE, OPENED = 5000, 2.0
#: Points of curves that are drawn; the legend has others.
LINES = "#curves .scatterlayer .trace path.js-line"


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Addresses of reports by kind of study."""
    folder = tmp_path_factory.mktemp("reports")
    stores = {
        "small": small_study(folder / "small"),
        "empty": new_store(folder / "empty", case="other", **REPLACED),
        "failed": new_store(folder / "failed", 1),
        "judged": judged_study(folder / "judged"),
        "legends": legend_study(folder / "legends"),
        "large": large_study(folder / "large", LARGE),
    }
    stores["failed"].add([failed(1)])
    finish(stores["failed"])
    for name, store in stores.items():
        with store:
            write_report(store, folder / f"{name}.html")
    return {name: (folder / f"{name}.html").as_uri() for name in stores}


@pytest.fixture(scope="module")
def judged(browser: Any, pages: dict[str, str]) -> Iterator[Any]:
    """The report of a study with criteria whose unstable machine lies outside the study area."""
    visit = Visit(browser, pages["judged"])
    yield visit.page
    check_quiet(visit, pages["judged"])
    visit.page.close()


@pytest.fixture(scope="module")
def small_visit(browser: Any, pages: dict[str, str]) -> Iterator[Visit]:
    """The report of a small study. It is opened once: a browser takes a second for plotly.js."""
    visit = Visit(browser, pages["small"])
    yield visit
    visit.page.close()


@pytest.fixture
def small(small_visit: Visit) -> Any:
    """Its page, as if it had just been opened."""
    page = small_visit.page
    page.set_viewport_size({"width": WIDE, "height": 800})
    page.click("#chips [data-verdict=all]")
    page.fill("#filter", "")
    page.evaluate("shown.sort = null; wanted.linear = false; fill(); choose(rows[0].number)")
    until(page, "shown.chosen === rows[0].number")
    return page


def choose(page: Any, number: int) -> None:
    page.click(f"#body tr[data-number='{number}'] a")
    until(page, f"shown.chosen === {number}")


def numbers(page: Any) -> list[int]:
    return [int(row) for row in page.locator("#body tr td:first-child").all_inner_texts()]


def test_page_is_drawn_without_a_complaint_or_a_request(small_visit, pages):
    page = small_visit.page
    assert page.inner_text("h1") == "two <areas>"
    assert page.locator(".js-plotly-plot .main-svg").count() >= 3
    assert page.locator(".banner").count() == 0
    check_quiet(small_visit, pages["small"])


def test_study_without_results_has_a_page(browser, pages):
    visit = Visit(browser, pages["empty"])
    words = visit.page.inner_text("#banners")
    assert "Not validated" in words
    assert "GENTRA" in words
    assert "Not finished: 0 of 4" in words
    assert "No contingency has a result yet" in visit.page.inner_text("#caption")
    assert visit.page.locator("#map .main-svg").count() > 0
    assert visit.page.is_hidden("#selected")
    assert visit.page.is_hidden("#clearing-section")
    check_quiet(visit, pages["empty"])
    visit.page.close()


def test_study_of_failures_has_a_page(browser, pages):
    visit = Visit(browser, pages["failed"])
    assert "All contingencies failed" in visit.page.inner_text("#banners")
    assert visit.page.inner_text("#selected-reason") == "The model does not start."
    assert visit.page.is_hidden("#curves-figure")
    check_quiet(visit, pages["failed"])
    visit.page.close()


def test_verdicts_and_evidence_are_told(small):
    tiles = small.locator("#verdicts li").all_inner_texts()
    assert [int(tile.split()[0]) for tile in tiles] == [2, 2, 1]
    assert "largest 1.25° (bus 1, machine 2:1), median 1.25°" in small.inner_text("#evidence")


def test_table_sorts_by_mouse_and_keyboard(small):
    assert numbers(small) == [4, 2, 5, 1, 3]
    small.click("th[data-field=number] button")
    assert numbers(small) == [1, 2, 3, 4, 5]
    assert small.get_attribute("th[data-field=number]", "aria-sort") == "ascending"
    small.focus("th[data-field=largest_separation_deg] button")
    small.keyboard.press("Enter")
    assert numbers(small) == [4, 2, 5, 1, 3]
    small.keyboard.press("Space")
    assert numbers(small) == [1, 5, 2, 4, 3]  # without a figure: last, either way
    assert small.get_attribute("th[data-field=number]", "aria-sort") is None
    fields = small.eval_on_selector_all("#heads th", "heads => heads.map(h => h.dataset.field)")
    assert "damping_ratio" not in fields  # nowhere given


def test_table_is_filtered(small):
    assert small.is_hidden("#criteria-chips")
    small.click("#chips [data-verdict=unstable]")
    assert numbers(small) == [4, 2]
    small.click("#chips [data-verdict=all]")
    small.fill("#filter", "does not start")
    assert numbers(small) == [3]
    assert "1 of 5" in small.inner_text("#caption")


def test_a_chosen_contingency_shows_its_curves(small):
    assert "not in the sample" in small.inner_text("#curves-note")
    small.click("#body tr[data-number='1'] td:nth-child(3)")  # anywhere in the row
    until(small, "shown.chosen === 1")
    assert small.url.endswith("#1")
    assert "bus 1" in small.inner_text("#selected-title")
    assert small.locator(LINES).count() == 7  # three machines, two runs, the error
    small.check("#overlays [data-run=linear]")
    assert small.locator(LINES).count() == 10
    assert "0.13 s" in small.inner_text("#figures")  # what the paper has
    assert small.locator("#switches li").count() == 2
    choose(small, 3)
    assert small.is_hidden("#curves-figure")


def test_arrow_keys_go_through_the_table(small):
    choose(small, 2)
    small.focus("#body tr[data-number='2'] a")
    small.keyboard.press("ArrowDown")
    until(small, "location.hash === '#5' && shown.chosen === 5")
    assert small.locator("#body a[aria-current=true]").all_inner_texts() == ["bus 5"]


def test_names_are_texts(small):
    assert WICKED in small.inner_text("#selected-title")
    assert small.locator("#body tr[data-number='4'] a").inner_text() == f"bus 4 {WICKED}"
    legend = small.text_content("#curves .legend")
    assert WICKED in legend.replace("\u2060", "")
    assert small.locator("a[href*='127.0.0.1']").count() == 0
    links = "[...document.querySelectorAll('svg a')].length"
    assert small.evaluate(links) == 0


def test_clearing_times_stand_beside_those_of_the_paper(small):
    assert small.locator("#clearing .bars .point").count() == 2
    assert small.locator("#clearing .scatterlayer .point").count() == 2
    assert "at most 0.11 s apart" in small.inner_text("#clearing-words")


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_page_does_not_overflow(small, width):
    small.set_viewport_size({"width": width, "height": 800})
    choose(small, 1)
    until(
        small, "document.querySelector('#curves .main-svg').clientWidth <= at('curves').clientWidth"
    )
    assert overflow(small) == 0


def test_print_has_no_controls_and_all_that_is_folded(small, small_visit, tmp_path: Path):
    path = tmp_path / "report.pdf"
    small.pdf(path=str(path), format="A4")
    assert path.read_bytes().startswith(b"%PDF")
    small.emulate_media(media="print")
    small.evaluate("beforePrint()")
    assert small.is_visible("#study-file")  # unfolded
    assert small.is_hidden("#chips")
    assert small.is_hidden("#filter")
    assert small.is_visible("#table")
    small.emulate_media(media="screen")
    small.evaluate("afterPrint()")
    assert small.is_hidden("#study-file")
    assert small.is_visible("#chips")
    assert small_visit.complaints == []


def test_what_was_watched_is_drawn_where_something_was(small):
    choose(small, 1)
    assert not small.is_visible("#watched-figure")
    choose(small, 2)
    assert small.is_visible("#watched-figure")
    caption = small.inner_text("#watched-caption")
    assert caption.startswith(
        "Watched: Flow into the line (MW), Bus voltage (p.u.), Interface (MW)."
    )
    assert "4 curves that move less are left out" in caption
    assert small.locator("#watched .scatterlayer .trace").count() == 4
    assert "wicked" in small.text_content("#watched .legend3")
    assert not small.locator("#watched b, #watched a[href*='127']").count()
    small.set_viewport_size({"width": NARROW, "height": 800})
    assert overflow(small) <= 0


def test_the_machine_that_decided_is_drawn_and_its_limit_with_it(judged):
    """The page opens on the unstable one; its machine is no machine of the study area."""
    reason = judged.inner_text("#selected-reason")
    assert reason.startswith("Machine 9:1 lost synchronism at 0.5 s.")
    assert "185.0° from the centre of inertia" in reason
    assert "the limit is 180°" in reason
    assert "It lies outside the study area." in reason
    assert "9:1 critical outside" in judged.text_content("#curves .legend")
    drawn = "at('curves').data.find(trace => trace.name.startsWith('9:1')).y.at(-1)"
    assert judged.evaluate(drawn) == pytest.approx(185.0, abs=0.1)
    lines = "at('curves').layout.shapes.filter(item => item.type === 'line').map(item => item.y0)"
    assert judged.evaluate(lines) == [-180, 180]
    assert "outside it that decided (9:1)" in judged.inner_text("#curves-caption")


def test_names_of_quantities_say_what_they_are(judged):
    choose(judged, 2)
    terms = judged.locator("#figures dt").all_inner_texts()
    assert "Its largest angle from the centre of inertia" in terms
    assert "Largest separation of two rotor angles" in terms
    assert not any("swing" in term.lower() for term in terms)
    assert not any("frequency" in term.lower() for term in terms)  # an unstable run has no nadir


def test_criteria_have_their_tile_column_and_sentence(judged):
    tiles = judged.locator("#verdicts li").all_inner_texts()
    assert tiles[3].split() == ["2", "◆violate", "criteria", "of", "4"]
    cells = judged.locator("#body td.violating").all_inner_texts()
    assert [cell.replace("\n", "") for cell in cells] == ["◆3", "◆2, 3"]
    choose(judged, 3)
    reason = judged.inner_text("#selected-reason")
    assert "Synchronism is kept" in reason
    assert "The run violates 2 of 3 criteria: damping at least 3 %" in reason
    assert "violates criteria" in judged.inner_text("#selected-title")
    marks = judged.locator("#criteria-body td.verdict-word").all_inner_texts()
    assert [mark[1:].strip() for mark in marks] == ["kept", "violated", "violated"]
    assert "lowest voltage 0.65 p.u. at bus 5; a note" in judged.inner_text("#criteria-body")
    assert judged.locator("#criteria b").count() == 0  # names are texts


def test_a_margin_within_the_error_of_checked_runs_is_told(judged):
    """Damping of 2.9 % is 0.1 % off its limit; the runs that were checked err by up to 0.2 %."""
    choose(judged, 3)
    assert "could turn: damping at least 3 %" in judged.inner_text("#selected-reason")


def test_another_criterion_of_the_detailed_run_is_told(judged):
    words = judged.inner_text("#banners")
    assert "The detailed model violates other criteria" in words
    assert "bus 1 (damping at least 3 %)" in words


def test_contingencies_are_filtered_by_a_criterion(judged):
    assert numbers(judged) == [2, 3, 1, 4]  # unstable, violating, by separation, failed
    judged.click("#chips [data-verdict=violating]")
    assert numbers(judged) == [2, 3]
    judged.click("#criteria-chips [data-verdict='2']")
    assert numbers(judged) == [3]
    judged.click("#chips [data-verdict=all]")
    judged.click("th[data-field=violations] button")
    assert numbers(judged)[:2] == [3, 2]
    judged.evaluate("shown.sort = null; fill()")


def test_what_decided_is_drawn_with_what_it_is_held_against(judged):
    choose(judged, 2)
    caption = judged.inner_text("#decided-caption")
    assert caption.startswith("What decided: Bus voltage (p.u.), Speed (p.u.).")
    lines = (
        "at('decided').layout.shapes.filter(item => item.type === 'line').map(s => [s.yref, s.y0])"
    )
    assert judged.evaluate(lines) == [["y", 0.9], ["y2", 1.12]]
    choose(judged, 1)
    assert judged.is_hidden("#decided-figure")


def test_the_timeline_tells_what_happened_in_order(judged):
    choose(judged, 1)
    lines = judged.locator("#timeline li").all_inner_texts()
    times = [float(line.split(" s")[0]) for line in lines]
    assert times == sorted(times)
    assert lines[0].endswith("fault")
    assert lines[-1].endswith("end of the run")
    choose(judged, 3)
    assert any("violated: damping" in line or "violated" in line for line in
               judged.locator("#timeline li").all_inner_texts())  # fmt: skip


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_criteria_do_not_make_the_page_overflow(judged, width):
    judged.set_viewport_size({"width": width, "height": 800})
    choose(judged, 2)
    until(
        judged,
        "document.querySelector('#curves .main-svg').clientWidth <= at('curves').clientWidth",
    )
    assert overflow(judged) == 0
    judged.set_viewport_size({"width": WIDE, "height": 800})


def test_thousands_of_rows_open_quickly_and_scroll(browser, pages):
    visit = Visit(browser, pages["large"], metered=True)
    page = visit.page
    few = Visit(browser, pages["failed"], metered=True)
    # The drawing program alone takes its time, whatever it draws.
    assert visit.seconds < max(OPENED, few.seconds + 0.5)
    few.page.close()
    assert page.inner_text("#caption").startswith(f"{LARGE} of {LARGE} contingencies")
    drawn = page.locator("#body tr[data-number]")
    assert 10 < drawn.count() < 60
    rows = numbers_of(page)
    height = page.evaluate("at('body').getBoundingClientRect().height / rowHeight()")
    assert height == pytest.approx(LARGE, abs=0.5)  # the scroll bar is that of all rows
    page.evaluate("at('scroll').scrollTop = 2500 * rowHeight()")
    until(page, "shown.first > 2400")
    later = numbers_of(page)
    assert not set(rows) & set(later)
    assert 10 < drawn.count() < 60
    page.evaluate("at('scroll').scrollTop = at('scroll').scrollHeight")
    until(page, f"shown.last === {LARGE}")
    assert numbers_of(page)[-1] == int(page.evaluate("rows.at(-1).number"))
    check_quiet(visit, pages["large"])
    page.close()


def test_arrow_keys_and_addresses_reach_rows_that_are_not_there_yet(browser, pages):
    visit = Visit(browser, pages["large"] + "#1")  # the last of the ranking but for the stable ones
    page = visit.page
    until(page, "shown.chosen === 1")
    assert page.locator("#body tr.chosen").count() == 1
    place = page.evaluate("shown.found.findIndex(row => row.number === 1)")
    page.focus("#body tr[data-number='1'] a")
    for _ in range(20):
        page.keyboard.press("ArrowUp")
    number = page.evaluate(f"shown.found[{place} - 20].number")
    until(page, f"shown.chosen === {number}")
    assert page.evaluate("document.activeElement.closest('tr').dataset.number") == str(number)
    page.fill("#filter", "1007-2007")
    assert numbers_of(page) == [7]
    assert page.locator("#body tr[data-number='7'] a").inner_text().startswith("line 1007-2007:1")
    page.close()


def test_in_print_every_row_is_there(browser, pages):
    visit = Visit(browser, pages["large"])
    page = visit.page
    page.fill("#filter", "10")
    page.emulate_media(media="print")
    page.evaluate("beforePrint()")
    assert page.locator("#body tr").count() == page.evaluate("shown.found.length")
    assert page.is_visible("#timeline")
    page.emulate_media(media="screen")
    page.evaluate("afterPrint()")
    assert page.locator("#body tr[data-number]").count() < 100
    page.close()


def numbers_of(page: Any) -> list[int]:
    """Numbers of the rows that are in the page."""
    script = "rows => rows.map(row => Number(row.dataset.number))"
    return page.eval_on_selector_all("#body tr[data-number]", script)


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_legends_lie_neither_on_buttons_nor_on_curves(browser, pages, width):
    page = browser.new_page(viewport={"width": width, "height": 800})
    page.goto(pages["legends"])
    until(page, "document.querySelectorAll('#watched .legend2').length === 1")
    for plot in ("#curves", "#watched", "#spread-lowest_voltage"):
        legends = boxes(page, f"{plot} [class^=legend] > rect.bg")
        others = boxes(page, f"{plot} .modebar-group") + boxes(page, f"{plot} .gridlayer")
        assert legends, plot
        assert len(others) > 1, plot
        assert not [pair for pair in itertools.product(legends, others) if overlap(*pair)], plot
    choose(page, 2)
    assert page.text_content("#watched .legend") == "1007"  # of one curve too it says what it is
    page.close()


def boxes(page: Any, selector: str) -> list[dict[str, float]]:
    found = (item.bounding_box() for item in page.locator(selector).all())
    return [box for box in found if box and box["width"] and box["height"]]


def overlap(one: dict[str, float], two: dict[str, float]) -> bool:
    """Whether boxes have more than a pixel in common."""
    across, down = (
        min(one[at] + one[size], two[at] + two[size]) - max(one[at], two[at])
        for at, size in (("x", "width"), ("y", "height"))
    )
    return across > 1 and down > 1


def test_every_model_in_use_has_a_bar_below_the_curves(small):
    choose(small, 1)
    names = small.locator("#curves .y2tick text").all_text_contents()
    assert [name.strip() for name in names] == ["retained", "detailed"]
