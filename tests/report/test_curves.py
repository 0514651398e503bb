"""Pictures of curves: what is drawn, and titles that fit."""

import numpy as np
import pytest

import gridfold as gf
from gridfold.report.curves import RunCurves, axis_text, draw_both, draw_curves
from gridfold.report.style import new_figure, put_title

TIMES = np.linspace(0.0, 1.0, 11)


def curves(**values):
    return RunCurves("a run", TIMES, values, [(0.1, 0.2)], [0.5])


def title_of(text, width=6.0):
    figure = new_figure(width, 3)
    put_title(figure, text)
    return figure


@pytest.mark.parametrize("letter", ["W", "i", "$x_", "ab "])
@pytest.mark.parametrize("width", [4.0, 11.0])
def test_a_title_never_runs_off_the_picture(letter, width):
    figure = title_of(f"short\n{letter * 400}", width)
    (shown,) = figure.texts
    box = shown.get_window_extent(figure.canvas.get_renderer())
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width
    assert shown.get_text().count("\n") <= 5


def test_a_title_that_fits_stays_and_one_that_is_too_long_says_so():
    assert (
        title_of("npcc: completed\n1 s: fault").texts[0].get_text() == "npcc: completed\n1 s: fault"
    )
    assert title_of("word " * 500).texts[0].get_text().endswith("...")


def test_each_kind_of_quantity_has_a_panel_with_its_unit(npcc):
    run = gf.simulate(npcc, [gf.BusFault(3, 0.1, 0.1)], 0.3, gf.RungeKutta4(0.01))
    figure = run.plot("voltage 1-4, flow 3-2, field_voltage 21-36")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == [
        "Bus voltage (p.u.)",
        "Flow into the line (MW)",
        "Flow into the line (Mvar)",
        "Field voltage\n(p.u., angles in rad)",
    ]
    assert figure.axes[-1].get_xlabel() == "Time (s)"
    np.testing.assert_array_equal(
        figure.axes[1].lines[0].get_ydata(), run.frame("flow 3-2")["p_mw:3-2"]
    )


def test_of_many_curves_those_that_move_most_are_told_apart():
    moving = {f"voltage_pu:{k}": 1 + 0.01 * k * TIMES for k in range(9)}
    (axes,) = draw_curves(curves(**moving)).axes
    legend = axes.get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["3", "4", "5", "6", "7", "8"]
    assert legend.get_title().get_text() == "6 of 9,\nmoving most"


def test_differences_are_the_second_run_less_the_first():
    first, second = curves(**{"speed_pu:1:1": TIMES}), curves(**{"speed_pu:1:1": TIMES**2})
    _, below = draw_both(first, second, ("one", "two")).axes
    np.testing.assert_array_equal(below.lines[0].get_ydata(), TIMES**2 - TIMES)


def test_too_many_kinds_for_a_picture_are_refused():
    many = {f"signal_{k}:1:1": TIMES for k in range(25)}
    with pytest.raises(gf.OptionError, match="room for 24 kinds of quantities, not for 25"):
        draw_curves(curves(**many))


def test_curves_without_a_value_are_drawn_as_nothing():
    draw_curves(curves(**{"frequency_hz:1": np.full(11, np.nan), "frequency_hz:2": TIMES}))
    both = curves(**{"a:1": np.full(11, np.nan)})
    draw_both(both, both, ("x", "y"))


def test_axes_of_sums_and_signals_are_told_in_words():
    assert axis_text("area_interchange_mw") == "Interchange of the\narea (MW)"
    assert axis_text("mechanical_power").startswith("Mechanical power")


def test_every_curve_is_in_the_legend_whatever_its_column_is_called():
    names = ("current", "_hidden", "interface_mw:_WEST")
    drawn = curves(**dict.fromkeys(names, TIMES))
    legends = [axes.get_legend() for axes in draw_curves(drawn).axes]
    told = [text.get_text().strip() for legend in legends for text in legend.get_texts()]
    assert told == ["current", "_hidden", "_WEST"]
    both = draw_both(drawn, drawn, ("one", "two"))
    told = [
        text.get_text().strip() for axes in both.axes[::2] for text in axes.get_legend().get_texts()
    ]
    assert told == ["current", "_hidden", "_WEST"]
