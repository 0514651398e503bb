"""What values show of themselves: short, and no markup of the data."""

from __future__ import annotations

import inspect
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from study_stores import small_study

import gridfold as gf
from gridfold.cards import Card, first_few
from gridfold.dynamics.registry import DEVICES


@pytest.fixture(scope="session")
def values(npcc, npcc_parts, npcc_linear):
    run = gf.simulate(npcc, [gf.BusFault(3, duration=0.1)], t_end=0.5)
    return {
        "case": npcc.case,
        "flow": npcc.power_flow,
        "model": npcc,
        "run": run,
        "parts": npcc_parts,
        "area": npcc_linear,
        "ladder": gf.Ladder((npcc_linear,)),
        "small": gf.SmallModels(npcc_linear),
        "modes": gf.small_signal(npcc),
        "comparison": gf.compare(run, run),
        "device": DEVICES["two_axis"],
        "devices": DEVICES,
        "study": gf.Study(name="a study"),
        "time": gf.ClearingTime(
            gf.BusFault(3, duration=0.39), 0.39, True, 8, 0.4, gf.UnitKey(26, "1")
        ),
        "finding": gf.judge(run, [gf.VoltageDip(0.7)])[0],
    }


def test_every_value_is_one_short_line(values):
    for name, value in values.items():
        assert len(repr(value)) < 250, name
        assert "\n" not in repr(value), name


def test_the_line_has_the_figures_that_the_value_has(values):
    assert repr(values["case"]) == (
        "<Case npcc: buses 140, branches 233, generators 57, loads 83, devices 201, base 100 MVA>"
    )
    assert "machines 48, states 432" in repr(values["model"])
    assert "status completed, until 0.5 s of 0.5 s" in repr(values["run"])
    assert "36 buses, 9 machines" in repr(values["parts"])
    ratio, hertz = values["modes"].damping_ratio, values["modes"].frequency_hz
    swings = values["modes"].eigenvalues.imag > 0
    least = ratio[swings].argmin()
    told = f"least damped {100 * ratio[swings][least]:.1f} % at {hertz[swings][least]:.2f} Hz"
    assert told in repr(values["modes"])
    told = "<ClearingTime bus 3: seconds 0.39, runs 8, lost at 0.4 s, first machine 26:1>"
    assert repr(values["time"]) == told
    failed = replace(values["time"], reason="no power flow")
    assert repr(failed) == "<ClearingTime bus 3: not found no power flow>"
    assert repr(values["finding"]).startswith("<Finding voltage never below 0.7 after the fault: ")
    assert repr(values["devices"]) == f"<{len(DEVICES)} device models>"


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.seen.add(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_cards_are_tables_in_which_names_are_no_markup(values):
    wicked = replace(values["case"], name="<script>alert(1)</script>")
    for value in (*values.values(), wicked):
        if not isinstance(value, Card):
            continue
        tags = _Tags()
        tags.feed(value._repr_html_())
        assert tags.open == []
        assert tags.seen <= {"table", "caption", "b", "tr", "th", "td"}
    assert "&lt;script&gt;" in wicked._repr_html_()


def test_public_values_with_a_model_or_a_case_in_them_are_cards():
    for name in gf.__all__:
        kind = getattr(gf, name)
        held = " ".join(str(hint) for hint in getattr(kind, "__annotations__", {}).values())
        if inspect.isclass(kind) and any(word in held for word in ("Case", "Model", "NDArray")):
            assert issubclass(kind, Card) or name in ("LoadModel", "Study", "CaseEditor"), name


def test_signatures_can_be_read():
    assert len(str(inspect.signature(gf.build_model))) < 400


def test_a_store_is_shown_after_it_was_closed(tmp_path):
    with small_study(tmp_path / "a.results") as store:
        pass
    assert "a.results" in repr(store)


def test_long_lists_are_cut_and_counted():
    assert first_few([]) == "none"
    assert first_few(range(6)) == "0, 1, 2, 3, 4, 5"
    assert first_few(range(9)) == "0, 1, 2, 3, 4, 5 and 3 more"
