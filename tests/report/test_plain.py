"""Data on terminals and in pictures: what is printed is what is there."""

import io
from pathlib import Path

import gridfold
from gridfold.report.plain import (
    PlainConsole,
    PlainTable,
    as_lines,
    picture_text,
    visible,
    visible_lines,
)
from gridfold.report.style import new_figure, save_figure

HOSTILE = {
    "[/Town] fault": "[/Town] fault",
    "[345] line [bold]a[/bold]": "[345] line [bold]a[/bold]",
    ":warning: :bus:": ":warning: :bus:",
    "[link=http://x]y[/link]": "[link=http://x]y[/link]",
    "a\x1b[31mred\x1b]0;title\x07": "a\\x1b[31mred\\x1b]0;title\\x07",
    "bus\u202e4 sub": "bus\\u202e4 sub",
    "a\nb\r\tc": "a\\nb\\r\\tc",
    "\x9b31m\u2066\u200b\ufeff": "\\x9b31m\\u2066\\u200b\\ufeff",
    "\ud800 half": "\\ud800 half",
    "\U000e0041tag\u2028": "\\U000e0041tag\\u2028",
    "Łódź 変電所 \\[x]": "Łódź 変電所 \\[x]",
}


def printed(*objects: object) -> str:
    stream = io.StringIO()
    console = PlainConsole(file=stream, width=200, force_terminal=True, color_system=None)
    console.print(*objects)
    return stream.getvalue()


def test_control_characters_are_shown_and_all_else_stays() -> None:
    for text, shown in HOSTILE.items():
        assert visible(text) == shown
        assert visible(shown) == shown


def test_tables_and_lines_print_names_as_they_are() -> None:
    for text, shown in HOSTILE.items():
        table = PlainTable(title=text)
        table.add_column(text.replace("\n", ""))
        table.add_row(text)
        table.note(text.replace("\n", ""))
        assert shown in printed(table), text
        assert printed(text.replace("\n", " ")).count("\n") == 1
        assert "\x1b" not in printed(text)


def test_lines_of_a_cell_cannot_be_forged() -> None:
    table = PlainTable(show_header=False, box=None)
    table.add_row(as_lines(["one\ntwo", "three"]))
    assert [line.strip() for line in printed(table).splitlines()] == ["one\\ntwo", "three"]
    assert visible_lines("one\ntwo\x1b") == "one\ntwo\\x1b"


def test_a_dollar_in_a_picture_is_a_dollar(tmp_path: Path) -> None:
    texts = ("$\\frac{$", "a $b$ c", "$", r"$\\$", "<&>\x00")
    for k, text in enumerate(texts):
        figure = new_figure(3, 2)
        figure.subplots().set_title(picture_text(text))
        save_figure(figure, tmp_path / f"{k}.svg")
        assert (tmp_path / f"{k}.svg").stat().st_size > 0


def test_nothing_but_the_plain_table_and_console_is_used() -> None:
    root = Path(gridfold.__file__).parent
    for file in [*root.glob("cli/*.py"), *root.glob("report/*.py")]:
        if file.name != "plain.py":
            text = file.read_text(encoding="utf-8")
            assert "rich.table" not in text, file
            assert "rich.console" not in text, file
            assert "rich.markup" not in text, file
            assert text.count("TextColumn(") == text.count("markup=False"), file
