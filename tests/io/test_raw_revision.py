"""The revision of a RAW file: stated, told by the fields of its records, or asked for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from raw_texts import BUSES, LINES, LOADS, TRANSFORMERS, UNITS, raw_text

import gridfold as gf
from gridfold.io.powerio_cases import read_network

OWN = Path(__file__).parent / "raw"
#: The same five buses with shunts between type and area, as up to revision 30.
OLD_BUSES = (
    "1,'GEN-A',18.0,3,0.0,0.0,2,3,1.02,0.0,1",
    "2,'GEN-B',20.0,2,0.0,0.0,2,3,1.01,0.0,1",
    "3,'NORTH',230.0,1,0.0,30.0,2,3,1.0,0.0,1",
    "4,'TOWN',230.0,1,0.0,0.0,2,3,1.0,0.0,1",
    "5,'SOUTH',115.0,1,0.0,0.0,2,3,1.0,0.0,1",
)
#: Without the metered end, and with the length and the owner that follow.
OLD_LINES = tuple(line[: line.rindex(",")] + ",12.5,1,1.0" for line in LINES)
OLD_ORDER = (
    "BUS", "LOAD", "GENERATOR", "BRANCH", "TRANSFORMER", "AREA", "TWO-TERMINAL DC", "VSC DC LINE",
    "SWITCHED SHUNT", "IMPEDANCE CORRECTION", "MULTI-TERMINAL DC", "MULTI-SECTION LINE", "ZONE",
    "INTER-AREA TRANSFER", "OWNER", "FACTS DEVICE",
)  # fmt: skip
SWITCHED = "4,1,0,1,1.05,0.95,0,100.0,'',25.0,2,25.0"
OLD_SWITCHED = "4,1,1.05,0.95,0,100.0,'',25.0,2,25.0"
#: Loads, shunts and the voltage stand in the record of the bus, its name after them.
OLDEST_BUSES = (
    "1,3,0.0,0.0,0.0,0.0,1,1.02,0.0,'bus-1',18.0,1",
    "2,2,0.0,0.0,0.0,0.0,1,1.01,0.0,'bus-2',20.0,1",
    "3,1,90.0,30.0,0.0,0.0,1,1.0,0.0,'bus-3',230.0,1",
)
NO_REVISION = ("0,100.0", "0,100.0 / PSS/E-30 RAW", "0,100.0,,0,1,60.0", "0 100.0 / NONE", ",")
READABLE = "gridfold reads revisions 29 to 35"


def read(tmp_path, text, **options):
    path = tmp_path / "revision.raw"
    path.write_text(text)
    return read_network(path, **options)


def refused(tmp_path, text, **options):
    with pytest.raises(gf.CaseFileError) as raised:
        read(tmp_path, text, **options)
    return str(raised.value)


@pytest.mark.parametrize("header", NO_REVISION)
def test_without_a_revision_the_fields_of_bus_records_tell_it(header, tmp_path):
    plain = read(tmp_path, raw_text())
    found = read(tmp_path, raw_text(header=header))
    assert found == replace(plain, base_mva=found.base_mva)
    assert found.notices[0] == (
        "the header gives no revision; the records have the fields of revisions 31 to 33, read as 33"
    )


def old_text(header, buses=OLD_BUSES, **changes):
    """The five buses as revision 30 has them: no fixed shunts, switched shunts before the tables."""
    records = {"BUS": buses, "LOAD": LOADS, "GENERATOR": UNITS}
    records |= {"BRANCH": OLD_LINES, "TRANSFORMER": TRANSFORMERS} | changes
    lines = [header, "FIVE BUSES", "OF THE TESTS"]
    for section in OLD_ORDER:
        lines += [*records.get(section, ()), "0 /"]
    return "\n".join([*lines, ""])


@pytest.mark.parametrize("header", [*NO_REVISION, "0,100.0,30", "0,100.0,29"])
def test_revision_30_gives_the_same_case_as_33_with_the_shunts_of_its_buses(header, tmp_path):
    shunts = {"FIXED SHUNT": ("3,'1',1,0.0,30.0",), "SWITCHED SHUNT": (SWITCHED,)}
    plain = read(tmp_path, raw_text(shunts))
    found = read(tmp_path, old_text(header, **{"SWITCHED SHUNT": (OLD_SWITCHED,)}))
    areas = tuple(replace(bus, area=2, zone=3) for bus in plain.buses)
    loads = found.loads  # they name areas of their own, now that those of the buses are others
    assert tuple(replace(load, area=0, zone=0) for load in loads) == plain.loads
    assert found == replace(plain, buses=areas, loads=loads, base_mva=found.base_mva)
    assert found.shunts == (gf.Shunt(3, "1", 0.0, 30.0), gf.Shunt(4, "S1", 0.0, 25.0))
    assert found.origins["shunt 3:1"] == "revision.raw:6"
    told = "the records have the fields of revision 30 or older, read as 30"
    unknown = header in NO_REVISION and "PSS" not in header
    assert (told in found.notices[0]) == unknown


def test_shunts_of_a_bus_record_reach_the_power_flow(tmp_path):
    """30 Mvar at 1 p.u. raise the voltage by about Q x: as the same shunt in a section of its own."""
    flow = gf.solve_power_flow(read(tmp_path, old_text("0,100.0")))
    same = gf.solve_power_flow(read(tmp_path, raw_text({"FIXED SHUNT": ("3,'1',1,0.0,30.0",)})))
    without = gf.solve_power_flow(read(tmp_path, raw_text()))
    np.testing.assert_allclose(flow.voltage, same.voltage, atol=1e-12)
    assert abs(flow.voltage[2]) > abs(without.voltage[2]) + 0.003


@pytest.mark.parametrize(
    "buses",
    [
        tuple(bus.replace("0.0,0.0,2", "0,0,2") for bus in OLD_BUSES),
        tuple(bus[: bus.rindex(",")] for bus in OLD_BUSES),
        tuple(",".join(bus.split(",")[:9]) for bus in OLD_BUSES),
    ],
)
def test_neighbours_of_the_old_layout_are_recognized_too(buses, tmp_path):
    assert read(tmp_path, old_text("0,100.0", buses)).buses[2].voltage_pu == 1.0
    for header in ("0,100.0,33,0,1,60.0", "0,100.0,32"):
        assert "the fields of revision 30 or older" in refused(
            tmp_path, raw_text({"BUS": buses}, header)
        )


@pytest.mark.parametrize("header", ["0,100.0", "0,100.0,33,0,1,60.0", "0,100.0,32", "0,100.0,30"])
def test_the_layout_of_23_is_refused_in_a_sentence(header, tmp_path):
    for buses in (OLDEST_BUSES, tuple(bus.replace(",", " ") for bus in OLDEST_BUSES)):
        message = refused(tmp_path, raw_text({"BUS": buses}, header))
        assert "the fields of revision 23 or older" in message


def test_a_comment_that_names_an_older_revision_is_believed(tmp_path):
    message = refused(tmp_path, old_text("0,100.0 / PSS/E-26.1 RAW"))
    assert "gives no revision, its comment names 26, and the bus records" in message
    assert READABLE in message


@pytest.mark.parametrize("revision", ["23", "26", "28", "30.3", "36", "2019", "x", "-33", "0"])
def test_a_revision_that_is_not_read_is_refused_in_a_sentence(revision, tmp_path):
    message = refused(tmp_path, raw_text({"BUS": OLDEST_BUSES}, f"0,100.0,{revision},0,1,60.0"))
    assert f"line 1: the header gives the revision {revision!r}; {READABLE}" in message
    assert "bus-1" not in message


def test_a_header_of_30_over_records_of_33_is_refused(tmp_path):
    message = refused(tmp_path, raw_text(header="0,100.0,30"))
    assert "gives revision 30, but the records have the fields of revisions 31 to 33" in message


def test_a_station_of_all_sections_is_the_same_in_revisions_30_and_35():
    """Dc lines, correction tables, shunts, a coupler, names with quotes, comments, substations."""
    old, new = (read_network(OWN / f"station_{revision}.raw") for revision in (30, 35))
    assert (old.buses, old.loads, old.shunts) == (new.buses, new.loads, new.shunts)
    assert (old.generators, old.dc_lines) == (new.generators, new.dc_lines)
    assert set(old.flow_controls) == set(new.flow_controls)
    by_name = [{str(b): b for b in case.branches} for case in (old, new)]
    assert by_name[0].keys() == by_name[1].keys()
    for name, branch in by_name[0].items():
        other = by_name[1][name]
        assert other == replace(branch, reactance=other.reactance)
        assert other.reactance == pytest.approx(branch.reactance, rel=1e-15)
    assert [bus.name for bus in new.buses[1:3]] == ["O'NEIL", "NORTH"]
    coupled = "without impedance, so that their buses are one node: 3-6:K"
    assert old.notices == ("BASFRQ of the header is blank: 60 Hz", coupled)
    assert new.notices == (
        "substations with their nodes are not read (5 lines): buses are as in the BUS section",
        coupled,
    )
    voltages = [gf.solve_power_flow(case).voltage for case in (old, new)]
    np.testing.assert_allclose(*voltages, atol=1e-10)


@pytest.mark.parametrize("revision", [32, 33, 34, 35])
def test_files_of_other_revisions_without_it_are_read_as_with_it(revision, tmp_path):
    path = OWN / f"revision_{revision}.raw"
    text = path.read_text()
    bare = text.replace(f"100.00, {revision},", "100.00,,", 1)
    assert bare != text
    found = read(tmp_path, bare)
    assert replace(found, name=path.stem) == read_network(path)
    assert f"read as {max(revision, 33)}" in found.notices[0]


def test_records_with_names_contradict_a_header_of_33_and_the_reverse(tmp_path):
    named = tuple(line.replace(",0.04,0", ",0.04,'L',0") for line in LINES)
    message = refused(tmp_path, raw_text({"BRANCH": named}))
    assert "the header gives revision 33, but the records have the fields of" in message
    assert "--raw-revision 33 (raw_revision=33)" in message
    message = refused(tmp_path, raw_text({}, "0,100.0,34,0,1,60.0"))
    assert "gives revision 34, but the records have the fields of revisions 31 to 33" in message


def test_where_nothing_tells_the_revision_is_asked_for(tmp_path):
    short = tuple(",".join(bus.split(",")[:4]) for bus in BUSES)
    for buses in (short, (BUSES[0], *OLD_BUSES[1:])):
        text = raw_text({"BUS": buses}, "0,100.0")
        message = refused(tmp_path, text)
        assert "the header gives no revision, and the records have no fields" in message
        assert "--raw-revision 33 (raw_revision=33), or another one from 29 to 35" in message
    text = raw_text({"BUS": short}, "0,100.0")
    assert [bus.voltage_pu for bus in read(tmp_path, text, raw_revision=33).buses] == [1.0] * 5


def test_the_revision_that_is_asked_for_goes_before_that_of_the_header(tmp_path):
    plain = read(tmp_path, raw_text())
    for stated in ("", "30", "23", "35", "x"):
        text = raw_text({}, f"0,100.0,{stated},0,1,60.0")
        assert read(tmp_path, text, raw_revision=33) == plain
    assert gf.load_case(tmp_path / "revision.raw", raw_revision=33) == plain
    old = read(tmp_path, raw_text({"BUS": OLD_BUSES}), raw_revision=33)
    assert old.notices == (
        "read as revision 33, but the records have the fields of revision 30 or older",
    )


@pytest.mark.parametrize("revision", [28, 36, 0, -1])
def test_revisions_that_are_not_read_cannot_be_asked_for(revision, tmp_path):
    with pytest.raises(gf.OptionError, match="raw_revision must be one of 29 to 35"):
        read(tmp_path, raw_text(), raw_revision=revision)


@pytest.mark.parametrize("source", ["npcc", OWN / "plain.m"])
def test_a_revision_is_for_raw_files_alone(source):
    with pytest.raises(gf.OptionError, match="raw_revision is for RAW files"):
        gf.load_case(source, raw_revision=33)


def test_voltages_of_the_stated_revision_are_those_of_the_file(tmp_path):
    """A zone of 3 is no voltage: read by the wrong layout every bus was at 3 p.u."""
    voltage = [bus.voltage_pu for bus in read(tmp_path, raw_text(header="0,100.0")).buses]
    np.testing.assert_array_equal(voltage, [1.02, 1.01, 1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    "titles", [(), ("ONE TITLE",), ("ONE TITLE, 3", "'TWO', 2"), ("1,2,3", "4,'5',6,7")]
)
def test_a_record_in_the_place_of_a_title_is_told(titles, tmp_path):
    lost = 2 - len(titles)
    text = raw_text({}, titles=titles)
    if not lost:
        assert read(tmp_path, text).notices == ()
        return
    message = refused(tmp_path, text)
    assert message.count("it is taken for a title") == lost
    assert "line 3 reads as a record but stands where one of the two lines of title" in message
    spare = ("6,'SPARE',18.0,1,1,1,1,1.0,0.0", "7,'SPARE',18.0,1,1,1,1,1.0,0.0")[:lost]
    case = read(tmp_path, raw_text({"BUS": (*spare, *BUSES)}, titles=titles))
    assert len(case.buses) == 5
    assert sum("it is taken for a title" in notice for notice in case.notices) == lost


def test_a_section_named_where_a_title_belongs_is_no_title(tmp_path):
    text = raw_text({"TRANSFORMER": TRANSFORMERS, "GENERATOR": UNITS}, titles=("ONE TITLE",))
    head, rest = text.split("\n1,", 1)
    found = read(tmp_path, f"{head}\n0 / BEGIN BUS DATA\n1,{rest}")
    assert len(found.buses) == 5
    assert found.notices == ()
