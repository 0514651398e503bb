"""DYR files: forms of records, what is skipped, what is refused."""

import os
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gridfold as gf
from gridfold.grid.dynamic_records import DynamicRecord, SkippedRecord
from gridfold.io.dyr import read_dyr

OWN = Path(__file__).parent / "dyr"
ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))


def public(name):
    path = CASES / name
    if not path.is_file():
        pytest.skip(f"{path} is absent; GRIDFOLD_CASES names the folder of public cases")
    return read_dyr(path)


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "case.dyr"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def refused(path):
    with pytest.raises(gf.CaseFileError) as raised:
        read_dyr(path)
    assert str(path) in str(raised.value)
    return raised.value.faults


def test_records_of_a_plain_file():
    data = read_dyr(OWN / "plain.dyr")
    assert (data.file, data.skipped) == ("plain.dyr", ())
    assert [(str(record), record.line, len(record.values)) for record in data.records] == [
        ("GENROU 1:1", 2, 14),
        ("SEXS 1:1", 5, 6),
        ("TGOV1 1:1", 7, 7),
        ("IEEEST 1:1", 9, 19),
        ("GENCLS 2:1", 10, 2),
    ]
    assert data.records[0].values[:4] == (6.5, 0.05, 0.6, 0.06)
    assert data.records[0].key == gf.UnitKey(1, "1")


def test_separators_quotes_and_numbers_may_be_written_in_many_ways():
    data = read_dyr(OWN / "forms.dyr")
    assert data.skipped == (SkippedRecord(8, "4 'GENCLS' 1 2 0", is_comment=True),)
    assert data.records[1:] == (
        DynamicRecord("SEXS", 2, "DG", (-0.015, 5.0, 1.0, 5.0), 4),
        DynamicRecord("GENCLS", 3, "10", (4.0, 0.0), 8),
        DynamicRecord("IEELAL", 0, "*", (0.4,), 9),
        DynamicRecord("REPCA1", 5, "A/B", (0.0, "0", "X1", 1.0), 10),
    )


def test_a_slash_ends_a_record_and_the_rest_of_its_line_is_a_comment(written):
    first = read_dyr(OWN / "forms.dyr").records[0]
    assert first == DynamicRecord("GENROU", 1, "1", (6.5, 0.05, 0.6, 0.06), 2)
    assert read_dyr(written("1 'GENCLS' 1 4 0 / 2 'GENCLS' 1 4 0 /\n")).records == (
        DynamicRecord("GENCLS", 1, "1", (4.0, 0.0), 1),
    )


@pytest.mark.parametrize(
    "comment",
    [
        "2 'GENCLS' 1 4 0 /",
        "2 'GENCLS' 1 4 0",
        "2,'GENCLS','1',4,0 /",
        "2 GENCLS 1 4.0 0.0 /",
        '2 "GENCLS" "1 " .5 /',
        "2 'USRMDL' 1 4 0 /",
    ],
)
@pytest.mark.parametrize("between", ["", " ", " end of the first / "])
def test_a_record_in_the_comment_of_another_is_told(written, comment, between):
    data = read_dyr(written(f"\n1 'GENCLS' 1 4 0 /{between}{comment}\n"))
    assert [record.bus for record in data.records] == [1]
    text = comment.removesuffix("/").strip()
    assert data.skipped == (SkippedRecord(2, text, is_comment=True),)


@pytest.mark.parametrize(
    "comment", ["2 machines", "4 'A note' 1", "GENCLS 2 1 4", "2 units of 4 MVA", "", "3, 4, 5"]
)
def test_other_comments_are_not_told(written, comment):
    assert read_dyr(written(f"1 'GENCLS' 1 4 0 / {comment}\n/ 2 'GENCLS' 1 4 0 /")).skipped == ()


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_line_ends_byte_order_marks_and_other_encodings_do_not_matter(written, end):
    lines = [b"\xef\xbb\xbf1 'GENCLS' 1", b"4 0 / \xfc", b"2 'SEXS' 1", b"1 2 /", b"\x1a"]
    data = read_dyr(written(end.join(lines)))
    assert [(record.model, record.line) for record in data.records] == [("GENCLS", 1), ("SEXS", 3)]


def test_an_empty_file_has_no_records(written):
    assert read_dyr(written("")).records == read_dyr(written("/\n\n / x\n")).records == ()


def test_user_written_models_and_what_is_no_device_record_are_collected_not_read():
    data = read_dyr(OWN / "skipped.dyr")
    assert [str(record) for record in data.records] == ["GENCLS 1:1"]
    assert data.skipped == (
        SkippedRecord(2, "Line 'Toggle' Line_8 2.0", model="TOGGLE"),
        SkippedRecord(3, "'A line' 'VSCHVDCP0' 5 'control' 1 2", model="VSCHVDCP0"),
        SkippedRecord(
            5,
            "101 'USRMDL' 1 'GENTPJU1' 1 1 0 16 6 1 1.0 2.0",
            gf.UnitKey(101, "1"),
            user_written=DynamicRecord("GENTPJU1", 101, "1", (1.0, 2.0), 5, (0, 16)),
        ),
        SkippedRecord(
            8,
            "1 'usrmdl' '1' 'MYAVR' 4 0 0 2 1 1 5.0 6.0",
            gf.UnitKey(1, "1"),
            user_written=DynamicRecord("MYAVR", 1, "1", (5.0, 6.0), 8, (0, 2)),
        ),
        SkippedRecord(9, "0 'USRMSC' 'WATCH' 512 0", gf.UnitKey(0, "WATCH")),
    )


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("1 'GENCLS' 1 4,,0 /", "line 1: record '1 GENCLS 1': value 2 is empty"),
        ("1 'GENCLS' 1 4, , 0 /", "value 2 is empty"),
        ("1 'GENCLS' 1 4,\n,0 /", "value 2 is empty"),
        ("1 'GENCLS' 1 4, 0,, /", "value 3 is empty"),
        ("1 'GENCLS',,4 /", "the id is empty"),
        ("1 'GENCLS' '  ' 4 /", "the id is empty"),
        ("1,,'GENCLS' 1 4 /", "the model name is empty"),
        ("1 '' 1 4 /", "the model name is empty"),
        (", 1 'GENCLS' 1 4 /", "the bus number is empty"),
        (", /", "it holds commas alone"),
        ("1 'GENCLS' /", "the id is missing"),
        ("1 /", "the model name is missing"),
        ("1 2 3 /", "a model name is expected, not '2'"),
        ("1.5 'GENCLS' 1 /", "'1.5' is not a bus number"),
        ("-1 'GENCLS' 1 /", "'-1' is not a bus number"),
        ("9999999999 'GENCLS' 1 /", "is not a bus number"),
        ("1 'GENCLS' 1 4 1e999 /", "value 2 is beyond the range of numbers: 1e999"),
        ("1 'GENCLS' 1 4", "line 1: record '1 GENCLS 1' is not ended by /"),
        ("1 'GENCLS 1 4 /", "line 1: a quote is not closed: 'GENCLS 1 4 /"),
        ("1 \"GENCLS' 1 4 /", "line 1: a quote is not closed"),
    ],
)
def test_malformed_records_are_refused_with_line_and_record(written, text, fault):
    assert any(fault in line for line in refused(written(text)))


def test_a_record_that_is_not_ended_does_not_swallow_the_next(written):
    text = "\n1 'GENCLS' 1 4 0\n\n2 'GENCLS' 1 4 0 /\nLine 'Toggle' 5\n3 'SEXS' 1 /\n"
    assert refused(written(text)) == [
        "line 2: record '1 GENCLS 1' is not ended by / before the record of line 4",
        "line 5: record 'Line Toggle 5' is not ended by / before the record of line 6",
    ]


def test_all_faults_of_a_file_are_reported(written):
    assert len(refused(written("1 'A' 1 ,, 3 /\n2 'B' /\n3 'C' 1 1e999 /\n"))) == 3


def test_files_that_cannot_be_read_are_refused(tmp_path):
    assert "cannot be read" in refused(tmp_path / "absent.dyr")[0]
    assert "cannot be read" in refused(tmp_path)[0]


PIECES = st.sampled_from(
    [
        *"0123456789.,/'\"+-eDd*@! \t\n\r\x00\x0b",
        "1 'GENCLS' 1 ",
        "'USRMDL' ",
        "@!",
        "1e99",
        "²",
        "é",
    ]
)


@settings(max_examples=300, deadline=None)
@given(content=st.lists(PIECES, max_size=40).map("".join).map(str.encode) | st.binary(max_size=80))
def test_every_input_ends_in_records_or_in_an_error_of_the_file(content, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "fuzz.dyr"
    path.write_bytes(content)
    try:
        data = read_dyr(path)
    except gf.CaseFileError:
        return
    assert all(record.model and record.id and record.line > 0 for record in data.records)


NAMES = st.text("ABCXYZ019", min_size=1, max_size=8).filter(lambda t: not t[0].isdigit())
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
BLANKS = st.sampled_from([" ", ",", " ,\n", "\t", "\n", " , "])


@settings(max_examples=100, deadline=None)
@given(
    records=st.lists(
        st.tuples(NAMES.map("X{}".format), st.integers(0, 999999), st.lists(NUMBERS, max_size=9))
    ),
    blank=BLANKS,
)
def test_what_is_written_is_read_back(records, blank, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "round.dyr"
    rows = [blank.join([str(bus), f"'{m}'", "'1 '", *map(repr, v)]) for m, bus, v in records]
    path.write_text("".join(f"{row} / end\n" for row in rows))
    found = [(r.model, r.bus, list(r.values)) for r in read_dyr(path).records]
    assert found == records


@pytest.mark.parametrize(
    ("name", "records", "skipped"),
    [
        ("kundur/kundur_full.dyr", {"GENROU": 4, "EXDC2": 4, "TGOV1": 4}, 1),
        (
            "npcc/npcc_curent.dyr",
            {"GENROU": 27, "GENCLS": 21, "IEEEX1": 24, "TGOV1": 29},
            0,
        ),
        ("ieee39/IEEE39.dyr", {"GENROU": 11, "IEEET1": 11, "IEEEG1": 11, "IEELAL": 1}, 3),
    ],
)
def test_counts_of_public_files(name, records, skipped):
    data = public(name)
    assert Counter(record.model for record in data.records) == records
    assert len(data.skipped) == skipped


def test_trailing_commas_and_empty_records_of_the_western_system():
    data = public("wecc240/240busWECC_2018_PSS.dyr")
    counts = Counter((record.model, len(record.values)) for record in data.records)
    assert counts == {
        ("GENROU", 14): 109,
        ("SEXS", 6): 109,
        ("GAST", 9): 47,
        ("TGOV1", 7): 37,
        ("REGCA1", 15): 37,
        ("REECB1", 30): 37,
        ("REPCA1", 34): 37,
        ("HYGOV", 12): 25,
        ("IEEEST", 19): 10,
    }
    assert data.skipped == ()
