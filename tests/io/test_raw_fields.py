"""Fields of lines in PSS/E's free format."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from raw_texts import LINES, TRANSFORMERS, raw_text

import gridfold as gf
from gridfold.io.raw_fields import INNER_QUOTE, Field, plain_number, split_fields


def texts(line):
    return [field.text for field in split_fields(line)]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("1,2,3", ["1", "2", "3"]),
        ("1 2\t3", ["1", "2", "3"]),
        ("  1 , 2 ,3  ", ["1", "2", "3"]),
        ("1 2, 3", ["1", "2", "3"]),
        (",0.05,100", ["", "0.05", "100"]),
        (" , ,30.0", ["", "", "30.0"]),
        ("1,,3", ["1", "", "3"]),
        ("1, ,3,", ["1", "", "3"]),
        ("", []),
        ("/ all of it is a comment", []),
        ("1,2 / 3,4", ["1", "2"]),
        ("1,2/3", ["1", "2"]),
    ],
)
def test_blanks_and_at_most_one_comma_separate_and_a_slash_ends(line, expected):
    assert texts(line) == expected


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("'SOUTH, OLD  '", "SOUTH, OLD  "),
        ("'A/B'", "A/B"),
        ("'O'NEIL ~1'", "O'NEIL ~1"),
        ("'O''NEIL'", "O'NEIL"),
        ("'ST. JOHN'S'", "ST. JOHN'S"),
        ("'ROCK 'N' ROLL'", "ROCK 'N' ROLL"),
        ("'O'         '", "O'         "),
        ("'D'ARCY, N'", "D'ARCY, N"),
        ("''TIS'", "'TIS"),
        ("''", ""),
        ('"O\'NEIL"', "O'NEIL"),
        ("'12\" MAIN'", '12" MAIN'),
        ("O'NEIL", "O'NEIL"),
    ],
)
@pytest.mark.parametrize("after", [",230.0,1", " , 230.0, 1", " 230.0,1", "/", ""])
def test_a_quote_ends_a_name_where_a_separator_follows(written, name, after):
    found = texts(f"4,{written}{after}")
    assert found[1] == name
    assert found[2:] in (["230.0", "1"], [])


def test_names_between_blanks_alone_end_at_the_quote_before_a_blank():
    assert texts("4 'O'NEIL' 'X ' 230.0 1") == ["4", "O'NEIL", "X ", "230.0", "1"]


@pytest.mark.parametrize("line", ["4,'TOWN,230.0", "4,\"TOWN',230.0", "4 '"])
def test_a_quote_that_is_not_closed_is_an_error(line):
    with pytest.raises(ValueError, match="a quote is not closed"):
        split_fields(line)


def test_a_field_is_blank_with_and_without_quotes():
    assert [field.blank for field in split_fields(",'',' ',0,'0'")] == [True] * 3 + [False] * 2


def test_quotes_within_are_replaced_in_what_is_handed_on():
    assert Field("O'NEIL", quoted=True).written == f"'O{INNER_QUOTE}NEIL'"


@pytest.mark.parametrize(
    ("text", "value"),
    [("1.8D2", 180.0), (".5d-1", 0.05), ("1.D0", 1.0), ("-2.5D+01", -25.0), ("3D1", 30.0)],
)
def test_exponents_d_are_read_as_fortran_does(text, value):
    assert float(plain_number(text)) == value


@pytest.mark.parametrize("text", ["D2", "1.8DD2", "1.8D", "TOWN", "1.8E2", "1D2X"])
def test_anything_else_stays_as_it_is(text):
    assert plain_number(text) == text


@given(st.lists(st.floats(allow_nan=False).map(repr) | st.just(""), min_size=1))
def test_fields_of_commas_are_those_of_a_split_at_commas(values):
    found = texts(",".join(values))
    assert found == (values if values[-1] else values[:-1])


@pytest.mark.parametrize(
    ("section", "signed"),
    [
        ("BRANCH", ("3,-4,'1',0.01,0.08,0.04", *LINES[1:])),
        ("BRANCH", ("-3,4,'1',0.01,0.08,0.04", *LINES[1:])),
        ("TRANSFORMER", ("1,-3,0,'1',1,1,1,0.0,0.0,2,'XF1-3',1", *TRANSFORMERS[1:])),
        ("TRANSFORMER", ("-1,3,0,'1',1,1,1,0.0,0.0,2,'XF1-3',1", *TRANSFORMERS[1:])),
    ],
)
def test_a_minus_before_a_bus_number_is_the_metered_end(section, signed, tmp_path):
    plain, other = tmp_path / "plain.raw", tmp_path / "signed.raw"
    plain.write_text(raw_text(), encoding="utf-8")
    other.write_text(raw_text({section: signed}), encoding="utf-8")
    branches = [gf.load_case(path).branches for path in (plain, other)]
    assert branches[0] == branches[1]
