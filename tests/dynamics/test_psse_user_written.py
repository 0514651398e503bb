"""Records of PSS/E's own models under the names that they had as user-written ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from converter_cases import PLANT, RECORDS, TURBINE
from raw_texts import raw_text

import gridfold as gf
from gridfold.dynamics.registry import DEVICES

MACHINE = "1 'GENROU' 1 8.0 0.03 0.4 0.05 6.5 2.0 1.8 1.7 0.3 0.55 0.25 0.2 0.05 0.3 /"


def plain(model: str) -> str:
    values = " ".join(map(str, RECORDS[model]))
    return f"2 '{model.upper()}' 1 {values} /"


def user_written(model: str, name: str = "") -> str:
    """With the numbers of ICONs, CONs, states and variables behind the name."""
    device, values = DEVICES[model], " ".join(map(str, RECORDS[model]))
    icons, cons = device.psse_icons, len(RECORDS[model]) - device.psse_icons
    name = name or model[:-1].upper() + "U1"
    return f"2 'USRMDL' 1 '{name}' 101 1 {icons} {cons} 9 9 {values} /"


def read(folder: Path, models: tuple[str, ...], record: Callable[[str], str]) -> gf.Case:
    raw, dyr = folder / "case.raw", folder / "case.dyr"
    raw.write_text(raw_text(), encoding="utf-8")
    dyr.write_text("\n".join([MACHINE, *map(record, models)]) + "\n", encoding="utf-8")
    return gf.load_case(raw, dyr)


@pytest.mark.parametrize("models", [PLANT, TURBINE])
def test_user_written_records_of_converters_are_those_of_the_models(models, tmp_path):
    case = read(tmp_path, models, user_written)
    assert case.devices == read(tmp_path, models, plain).devices
    assert {record.model for record in case.devices} == {"genrou", *models}
    assert case.replacements == ()


@pytest.mark.parametrize("name", ["REPCTA1", "REPCTAU1"])
def test_the_control_of_a_plant_of_wind_turbines_has_a_name_of_its_own(name, tmp_path):
    def record(model: str) -> str:
        if model != "repca1":
            return plain(model)
        return (
            user_written(model, name)
            if name.endswith("U1")
            else plain(model).replace("REPCA1", name)
        )

    case = read(tmp_path, TURBINE, record)
    assert case.devices == read(tmp_path, TURBINE, plain).devices


def test_numbers_that_are_not_those_of_the_model_are_a_fault_with_its_line(tmp_path):
    with pytest.raises(gf.CaseError, match=r"case.dyr:3\): it announces 0 ICONs and 2 CONs"):
        read(tmp_path, PLANT, lambda m: user_written(m).replace(" 5 25 9", " 0 2 9"))


def test_other_user_written_models_are_nobody_s(tmp_path):
    with pytest.raises(gf.CaseError, match="user-written"):
        read(tmp_path, PLANT, lambda m: user_written(m, m.upper()) if m == "reecb1" else plain(m))
