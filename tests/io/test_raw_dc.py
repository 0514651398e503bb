"""Dc lines with two ends from the records of RAW files of all revisions."""

import pytest
from raw_texts import BUSES, LINES, LOADS, TRANSFORMERS, UNITS, raw_text, with_field

import gridfold as gf
from gridfold.grid.dc_lines import (
    DcControl,
    LineControl,
    ThyristorEnd,
    ThyristorLine,
    TransistorEnd,
    TransistorLine,
)
from gridfold.io.powerio_cases import read_network

TWO_TERMINAL = (
    "'NORD LINK',1,5.5,60.0,200.0,150.0,1.5,0.1,'I',0.0,20,1.0",
    "3,2,20.0,5.0,0.1,6.0,230.0,0.45,1.02,1.2,0.8,0.00625,0,0,0,'1',0.0",
    "5,4,22.0,15.0,0.2,5.0,115.0,0.45,1.01,1.2,0.8,0.00625,0,0,0,'1',0.0",
)
NAMED = ThyristorLine(
    "NORD LINK", LineControl.POWER, 60.0, 5.5, 200.0,
    ThyristorEnd(3, 2, 20.0, 5.0, 0.1, 6.0, 230.0, 0.45, 1.02),
    ThyristorEnd(5, 4, 22.0, 15.0, 0.2, 5.0, 115.0, 0.45, 1.01),
    compounding_ohm=1.5, switch_kv=150.0, margin=0.1,
)  # fmt: skip
VSC = (
    "'OST',1,0.7,1,1.0",
    "3,1,2,150.0,0.95,100.0,0.1,90.0,400.0,1200.0,0.1,100.0,-110.0,0,100.0",
    "5,2,1,40.0,0.99,90.0,0.15,80.0,350.0,1200.0,0.15,150.0,-140.0,4,100.0",
)
EAST = TransistorLine(
    "OST", True, 0.7,
    TransistorEnd(3, DcControl.VOLTAGE, 150.0, False, 0.95, 1.0, 0, 100.0, 0.1, 90.0, 100.0, -110.0),
    TransistorEnd(5, DcControl.POWER, 40.0, True, 1.0, 0.99, 4, 90.0, 0.15, 80.0, 150.0, -140.0),
)  # fmt: skip
#: The field of the node that stands in records of revision 35.
WITH_NODES = {
    "TWO-TERMINAL DC": [r.replace(",0,0,0,'1'", ",0,0,0,0,'1'") for r in TWO_TERMINAL],
    "VSC DC LINE": [VSC[0], *(r[: r.rindex(",")] + ",0" + r[r.rindex(",") :] for r in VSC[1:])],
}  # fmt: skip


def read(tmp_path, text, **options):
    path = tmp_path / "dc.raw"
    path.write_text(text)
    return read_network(path, **options)


def refused(tmp_path, text):
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, text)
    return str(raised.value)


def as_revision(revision):
    """The five buses with both lines."""
    records = {"TWO-TERMINAL DC": TWO_TERMINAL, "VSC DC LINE": VSC}
    if revision >= 34:
        ratings = ",''" + 12 * ",0"
        records["BRANCH"] = [
            line.replace(",0,0,0,0,0,0,0,1,1", f"{ratings},0,0,0,0,1,1") for line in LINES
        ]
        records["TRANSFORMER"] = [
            record.replace("0,0,0,0,0", 12 * "0," + "0,0")
            if record.startswith(("1.03", "0.98"))
            else record
            for record in TRANSFORMERS
        ]
    if revision >= 35:
        records |= WITH_NODES
        records["GENERATOR"] = [with_field(unit, 7, "0,0") for unit in UNITS]
    return raw_text(records, f"0,100.0,{revision},0,1,60.0")


@pytest.mark.parametrize("revision", [31, 32, 33, 34, 35])
def test_every_revision_gives_the_same_lines(tmp_path, revision):
    case = read(tmp_path, as_revision(revision))
    assert case.dc_lines == (NAMED, EAST)
    assert case.unsupported == ()
    assert {str(line): case.origins[str(line)] for line in case.dc_lines} == {
        'dc line "NORD LINK"': f"dc.raw:{_line_of(as_revision(revision), 'NORD')}",
        'VSC dc line "OST"': f"dc.raw:{_line_of(as_revision(revision), 'OST')}",
    }
    flow = gf.solve_power_flow(case)
    assert flow.dc_flows[0].power_mva[0].real == pytest.approx(60.0, abs=0.2)  # and 2 N R I^2
    assert flow.dc_flows[1].power_mva[1].real == pytest.approx(-40.0)


def _line_of(text, word):
    return next(k for k, line in enumerate(text.splitlines(), 1) if line.startswith(f"'{word}"))


def test_blank_fields_have_the_defaults_of_the_manual(tmp_path):
    short = ("'D',,5.5,60.0,200.0", "3,2,20,5,0,6,230", "5,2,22,15,0,5,115")
    (line,) = read(tmp_path, raw_text({"TWO-TERMINAL DC": short})).dc_lines
    assert line.control is LineControl.BLOCKED
    assert (line.rectifier.transformer_ratio, line.rectifier.tap) == (1.0, 1.0)
    assert (line.compounding_ohm, line.switch_kv, line.margin) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (("60.0,200.0", "x,200.0"), "line 32: SETVL of a dc line is no number: x"),
        (
            ("'NORD LINK',1", "'NORD LINK',3"),
            "line 32: MDC of a dc line is 3; its codes are 0, 1, 2",
        ),
        (("3,2,20.0", "3,2.5,20.0"), "line 33: NB of a dc line is no whole number: 2.5"),
        (
            ("3,2,20.0", "3,,20.0"),
            "line 33: NB of a two-terminal dc line is blank, and it has no default",
        ),
        (("5,2,1,40.0", "5,3,1,40.0"), "line 38: TYPE of a dc line is 3; its codes are 0, 1, 2"),
        (
            ("5,2,1,40.0", "5,1,1,40.0"),
            '"OST" (dc.raw:36): 2 of its converters hold the dc voltage',
        ),
        (("5,4,22.0", "9,4,22.0"), "dcline references unknown bus 9 (line 34)"),
        (("0.45,1.02", "0.45,0.0"), '"NORD LINK" (dc.raw:32): at bus 3 tap must be positive'),
        (("'OST'", "'NORD"), "line 36: a quote is not closed"),
    ],
)
def test_faults_name_line_and_field(tmp_path, change, fault):
    text = as_revision(33).replace(*change, 1)
    assert fault in refused(tmp_path, text)


def test_records_that_lack_lines_are_a_fault(tmp_path):
    message = refused(tmp_path, raw_text({"VSC DC LINE": VSC[:2]}))
    assert "a VSC dc line needs 3 lines, and 2 are there" in message


def test_series_capacitors_are_refused_and_may_be_left_out(tmp_path):
    with_capacitor = (TWO_TERMINAL[0], TWO_TERMINAL[1][:-3] + "2.5", TWO_TERMINAL[2])
    text = raw_text({"TWO-TERMINAL DC": with_capacitor})
    assert "capacitors between converters and transformers (line 33)" in refused(tmp_path, text)
    case = read(tmp_path, text, allow_unsupported=True)
    assert case.dc_lines == ()


def test_a_line_at_an_isolated_bus_is_left_out_with_it(tmp_path):
    buses = (*BUSES, "6,'ALONE',115.0,4,1,1,1,1.0,0.0")
    line = (*TWO_TERMINAL[:2], TWO_TERMINAL[2].replace("5,4,", "6,4,"))
    case = read(tmp_path, raw_text({"BUS": buses, "TWO-TERMINAL DC": line}))
    assert case.dc_lines == ()
    assert case.notices == ("isolated bus 6 left out, with 1 dc line",)


def island(units=()):
    """Buses 6 and 7 apart from the rest, fed by the inverter at 6."""
    buses = (*BUSES, "6,'FAR',115.0,2,1,1,1,1.0,0.0", "7,'FAR END',115.0,2,1,1,1,1.01,5.0")
    line = (*TWO_TERMINAL[:2], TWO_TERMINAL[2].replace("5,4,", "6,4,"))
    lines = (*LINES, "6,7,'1',0.0,0.1,0.0,0,0,0,0,0,0,0,1,1")
    loads = (*LOADS, "6,'1',1,1,1,80.0,10.0,0,0,0,0,1")
    return raw_text(
        {
            "BUS": buses,
            "TWO-TERMINAL DC": line,
            "BRANCH": lines,
            "LOAD": loads,
            "GENERATOR": (*UNITS, *units),
        }
    )


def test_in_an_island_on_a_dc_line_without_a_swing_unit_the_largest_balances(tmp_path):
    small = UNITS[1].replace("2,'1',130.0", "6,'1',10.0").replace("200.0,0.0", "30.0,0.0")
    large = UNITS[1].replace("2,'1',130.0", "7,'1',15.0").replace("200.0,0.0", "80.0,0.0")
    case = read(tmp_path, island((small, large)))
    assert case.unsupported == ()
    assert (
        "the island of bus 6 has no swing unit and stands on a dc line: generator 7:1, its largest, "
        "balances it" in case.notices
    )
    flow = gf.solve_power_flow(case)
    received = -flow.dc_flows[0].power_mva[1].real
    assert flow.unit_power[3].real * 100 == pytest.approx(80.0 - 10.0 - received, abs=1e-8)


def test_an_island_that_a_dc_line_alone_feeds_is_refused(tmp_path):
    message = refused(tmp_path, island())
    assert (
        "an island without a slack unit: buses 6, 7 left out, with 1 branch, 1 load, 1 dc line"
        in message
    )
