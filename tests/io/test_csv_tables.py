from dataclasses import dataclass
from enum import Enum

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.io.tables import parse_cell, read_records, read_table, read_text, read_toml, suggest


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Item:
    number: int
    weight: float = 2.5
    name: str = "none"
    colour: Colour = Colour.RED
    sold: bool = False
    height: float | None = None


KINDS = {
    "number": int,
    "weight": float,
    "name": str,
    "colour": Colour,
    "sold": bool,
    "height": float | None,
}


def table_of(tmp_path, text):
    path = tmp_path / "items.csv"
    path.write_text(text, encoding="utf-8")
    return read_table(path)


def items(tmp_path, text):
    table = table_of(tmp_path, text)
    records = read_records(table, Item, KINDS)
    assert table.faults == []
    return records


def faults(tmp_path, text):
    table = table_of(tmp_path, text)
    records = read_records(table, Item, KINDS)
    return [fault.replace(f"{tmp_path}/", "") for fault in table.faults], records


def test_rows_become_records_with_their_lines(tmp_path):
    text = 'number,name,weight,colour,sold,height\n1,"a, b",1e3,blue,Yes,3\n2,c,-1,red,false,\n'
    assert items(tmp_path, text) == [
        (2, Item(1, 1000.0, "a, b", Colour.BLUE, True, 3.0)),
        (3, Item(2, -1.0, "c", Colour.RED, False, None)),
    ]


def test_comments_and_blank_lines_are_skipped_but_counted(tmp_path):
    text = "# items\n\nnumber,name\n# the first\n1,a\n , \n2,b\n"
    assert items(tmp_path, text) == [(5, Item(1, name="a")), (7, Item(2, name="b"))]


def test_an_empty_cell_stands_for_the_default(tmp_path):
    assert items(tmp_path, "number,weight,colour,sold\n1,,,\n") == [(2, Item(1))]


def test_a_byte_order_mark_is_no_part_of_the_first_column(tmp_path):
    assert items(tmp_path, "\ufeffnumber\n1\n") == [(2, Item(1))]


def test_spaces_around_cells_are_ignored(tmp_path):
    assert items(tmp_path, " number , name\n 1 ,  a b \n") == [(2, Item(1, name="a b"))]


def test_every_faulty_cell_is_reported(tmp_path):
    text = "number,weight,colour,sold\nx,heavy,green,maybe\n,1,red,no\n3,1,red,no\n"
    found, records = faults(tmp_path, text)
    assert found == [
        "items.csv:2: number: 'x' is not a whole number",
        "items.csv:2: weight: 'heavy' is not a number",
        "items.csv:2: colour: 'green' is not one of red, blue",
        "items.csv:2: sold: 'maybe' is neither true nor false",
        "items.csv:3: number is empty",
    ]
    assert records == [(4, Item(3, weight=1.0))]


def test_faults_of_the_header_name_its_line(tmp_path):
    found, records = faults(tmp_path, "# items\nnumbr,weigth,zzz\n1,2,3\n")
    assert found == [
        "items.csv:2: unknown column 'numbr'; did you mean 'number'?",
        "items.csv:2: unknown column 'weigth'; did you mean 'weight'?",
        "items.csv:2: unknown column 'zzz'; known: number, weight, name, colour, sold, height",
        "items.csv:2: column 'number' is missing",
    ]
    assert records == []


def test_rows_of_the_wrong_length_are_reported_with_their_lines(tmp_path):
    found, _ = faults(tmp_path, "number,name\n1\n2,b\n3,c,d\n")
    assert found == ["items.csv:2: 1 cells, but 2 columns", "items.csv:4: 3 cells, but 2 columns"]


def test_a_column_given_twice_is_a_fault(tmp_path):
    found, _ = faults(tmp_path, "number,name,name\n")
    assert found == ["items.csv:1: column 'name' is given twice"]


def test_a_file_of_comments_alone_has_no_header(tmp_path):
    found, _ = faults(tmp_path, "# nothing\n")
    assert found == ["items.csv:1: there is no header line"]


@pytest.mark.parametrize("text", ["1", "true", "TRUE", "yes"])
def test_words_for_true(text):
    assert parse_cell(text, bool) is True


@pytest.mark.parametrize("text", ["0", "false", "No"])
def test_words_for_false(text):
    assert parse_cell(text, bool) is False


@settings(max_examples=60, deadline=None)
@given(st.floats(allow_nan=False), st.integers(-(10**12), 10**12))
def test_numbers_survive_as_text(number, whole):
    assert parse_cell(repr(number), float) == number
    assert parse_cell(repr(number), float | None) == number
    assert parse_cell(str(whole), int) == whole


def test_the_nearest_name_is_suggested():
    assert suggest("fractoin", ["fraction", "duration"]) == "did you mean 'fraction'?"
    assert suggest("qqq", ["fraction", "duration"]) == "known: fraction, duration"


def test_a_file_that_is_missing_or_a_folder_is_named(tmp_path):
    for path in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(gf.CaseFileError, match="cannot be read") as error:
            read_text(path)
        assert str(path) in str(error.value)


def test_toml_nested_too_deeply_is_refused(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text("a = " + "[" * 20000, encoding="utf-8")
    with pytest.raises(gf.CaseFileError, match="not TOML"):
        read_toml(path)
