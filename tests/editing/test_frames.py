from __future__ import annotations

from dataclasses import replace

import pytest
from plants import EXCITER, two_plants

import gridfold as gf


@pytest.fixture(scope="module")
def plants():
    return two_plants()


@pytest.mark.parametrize("table", ["buses", "branches", "generators", "loads", "shunts"])
def test_a_table_has_a_row_for_each_record_with_all_of_its_values(plants, table):
    frame, records = plants.frame(table), getattr(plants, table)
    assert len(frame) == len(records)
    of_bus = ("area", "zone", "owner") if table == "loads" else ()
    for name, value in vars(records[-1]).items():
        held = frame[name].iloc[-1] == getattr(value, "value", value)
        assert held or value is None or name in of_bus, name


def test_records_have_the_names_and_areas_of_their_buses(plants):
    loads = plants.frame("loads").set_index(["bus", "id"])
    assert tuple(loads.loc[(104, "2"), ["bus_name", "area", "zone"]]) == ("PORT", 2, 2)
    branches = plants.frame("BRANCHES")
    assert list(branches.columns[:5]) == ["from_bus", "to_bus", "circuit", "from_name", "to_name"]
    assert tuple(branches.loc[1, ["from_name", "to_name"]]) == ("SOUTH", "PORT")


def test_units_of_columns_are_told(plants):
    units = plants.frame("generators").attrs["units"]
    assert (units["active_mw"], units["base_mva"], units["voltage_pu"]) == ("MW", "MVA", "p.u.")
    assert plants.frame("buses").attrs["units"]["base_kv"] == "kV"
    assert plants.frame("branches").attrs["units"]["reactance"] == "p.u."
    assert plants.frame("GENROU").attrs["units"]["inertia"] == "s"


def test_units_of_a_model_stand_below_each_other(plants):
    frame = plants.edit().set("GENROU 102:2 H=3").case().frame("genrou").set_index(["bus", "id"])
    assert list(frame["inertia"]) == [6.5, 6.5, 3.0]


def test_all_devices_are_a_row_for_each_parameter(plants):
    frame = plants.frame("devices")
    assert len(frame) == sum(len(device.parameters) for device in plants.devices)
    gain = frame[(frame["model"] == "SEXS") & (frame["symbol"] == "K")].iloc[0]
    assert gain["value"] == EXCITER["regulator_gain"]
    assert (gain["bus"], gain["id"], gain["bus_name"]) == (101, "1", "NORTH")
    assert set(frame.loc[frame["symbol"] == "T'd0", "unit"]) == {"s"}


def test_a_device_without_parameters_has_a_row(plants):
    loads = (gf.DeviceRecord("negative_load", 101, "1"),)
    frame = replace(plants, devices=loads).frame("devices")
    assert list(frame["model"]) == ["NEGATIVE_LOAD"]
    assert frame["value"].isna().all()


def test_an_empty_table_is_a_frame_without_rows(plants):
    assert len(replace(plants, shunts=()).frame("shunts")) == 0


def test_a_table_that_is_not_there_is_told_with_the_nearest(plants):
    with pytest.raises(gf.OptionError, match="no table 'genertors'; did you mean 'generators'"):
        plants.frame("genertors")
    with pytest.raises(gf.OptionError, match=r"no table .IEEEG1.; known: buses, .*, SEXS"):
        plants.frame("IEEEG1")
