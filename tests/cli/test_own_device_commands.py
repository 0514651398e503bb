"""Device models of a user's own on the command line: check-device, and --devices of every command."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from pathlib import Path
from shutil import copytree

import numpy as np
import pandas as pd
import pytest
from own_exciters import PLAIN, RAW, line_of, own_dyr, own_file

import gridfold as gf

ROOT = Path(__file__).resolve().parents[2]


def squeezed(text):
    """Text without any space: the terminal may break a long path anywhere."""
    return "".join(text.split())


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A sound exciter, dynamic data that name it, a fault of one bus as a study."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    own_file(tmp_path)
    own_dyr(tmp_path, PLAIN, PLAIN)
    (tmp_path / "grid.raw").write_bytes(RAW.read_bytes())
    (tmp_path / "study.toml").write_text(
        'schema = 1\nname = "own"\n[case]\nsource = "grid.raw"\ndyr = "own.dyr"\n'
        '[study_area]\nareas = "1"\n[contingencies]\nbus_faults = "13"\nclearing_time = 0.05\n'
        '[model]\nkind = "detailed"\n[run]\nt_end = 0.2\n'
    )
    return tmp_path


def test_check_device_prints_what_it_found(command, files):
    code, out, _ = command(
        "check-device", "mine.py", "--record", "2 0.02 50 0.05 -20 20", "--set", "TA=0.1"
    )
    assert code == 0
    assert "MYAVR: M TR KA TA VMIN VMAX" in out
    assert squeezed("M 2, TR 0.02, KA 50, TA 0.1, VMIN -20, VMAX 20") in squeezed(out)
    assert "FAULT" not in out
    assert "Jacobian" in out


def test_check_device_has_a_record_for_programs_and_ends_with_2_at_a_fault(command, files):
    path = own_file(files, ("dx[X.measured, i] = lag(", "dx[4, i] = lag("), name="spoilt.py")
    code, out, _ = command("check-device", "spoilt.py", "--name", "mine", "--json", "-")
    assert code == 2
    (record,) = json.loads(out)
    (finding,) = record["findings"]
    assert (record["device"], record["passed"], finding["passed"]) == ("mine", False, False)
    assert finding["text"].startswith(f"{path}:{line_of(path, 'dx[4, i]')}: device mine")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("gone.py",), "gone.py: there is no such Python file"),
        (("mine.py", "--name", "yours"), "mine.py has no device model 'yours'; there are mine"),
        (("mine.py", "--set", "KB=1"), "mine has no parameter 'KB'"),
        (("mine.py", "--set", "KA"), "--set KA: write NAME=VALUE"),
        (("mine.py", "--set", "KA=nan"), "--set: 'nan' is not a number"),
        (("mine.py", "--record", "1 2 3 4 5 6 7"), "--record has 7 values; a record of mine has 6"),
        (("own.dyr",), "own.dyr:1: SyntaxError"),
    ],
)
def test_bad_input_of_check_device_is_told(command, files, arguments, words):
    code, _, err = command("check-device", *arguments)
    assert (code, squeezed(words) in squeezed(err)) == (2, True), err


@pytest.mark.parametrize(
    "arguments",
    [
        ("info",),
        ("simulate", "--fault-bus", "13", "--t-end", "0.2"),
        ("eigenvalues",),
        ("partition", "--study-areas", "1"),
        ("reduce", "--study-areas", "1", "--retain", "0", "--save", "small.npz"),
        ("cct", "--buses", "13", "--t-end", "0.5", "--longest", "0.2", "--resolution", "0.1"),
    ],
)
def test_every_command_that_loads_a_case_takes_own_devices(command, files, arguments):
    name, *rest = arguments
    code, out, err = command(name, "grid.raw", "own.dyr", *rest)
    assert code == (0 if name == "info" else 2)
    assert "MYAVR (exciter)" in out + err or "MYAVR (unknown)" in out + err
    code, out, err = command(name, "grid.raw", "own.dyr", "--devices", "mine.py", *rest)
    assert code == 0, err
    assert squeezed(
        f"device mine ({files / 'mine.py'}) is a model of your own: 2 units"
    ) in squeezed(out)


def test_what_an_own_file_prints_is_not_part_of_json(command, files):
    own_file(files, ("PARAMETERS = (", "print('here')\nPARAMETERS = ("))
    code, out, err = command("info", "grid.raw", "own.dyr", "--devices", "mine.py", "--json", "-")
    assert (code, "here" in err) == (0, True)
    assert {item["model"]: item["own"] for item in json.loads(out)["device_models"]}["MYAVR"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = (", "mine.py:1: SyntaxError"),
        ("import nowhere", "mine.py:1: ModuleNotFoundError"),
        ("1 / 0", "mine.py:1: ZeroDivisionError"),
        (
            "import sys; sys.exit(0)",
            "mine.py:1: the code of a device model asks to end the program",
        ),
        ("x = 1", "mine.py: it defines no device model"),
    ],
)
def test_a_file_that_gives_no_devices_is_bad_input(command, files, text, words):
    (files / "mine.py").write_text(text)
    code, _, err = command("simulate", "grid.raw", "own.dyr", "--devices", "mine.py")
    assert (code, squeezed(words) in squeezed(err)) == (2, True), err


def test_a_study_takes_own_devices_that_are_named_beside_it(command, files):
    assert command("run", "study.toml")[0] == 2
    code, _, err = command("run", "study.toml", "--devices", "mine.py")
    assert code == 0, err
    code, _, err = command("run", "study.toml", "--resume")
    assert (code, "case.devices was ['mine.py'] and is []" in " ".join(err.split())) == (2, True)
    assert command("run", "study.toml", "--resume", "--devices", "mine.py")[0] == 0
    own_file(files, ("PARAMETERS = (", "# changed\nPARAMETERS = ("))
    code, _, err = command("run", "study.toml", "--resume", "--devices", "mine.py")
    assert (code, "mine.py: was sha256" in " ".join(err.split())) == (2, True)


def test_a_file_that_is_named_is_trusted_and_no_other(command, files):
    own_file(files, ('model="mine"', 'model="more"'), ('"MYAVR"', '"OTHER"'), name="more.py")
    study = files / "study.toml"
    study.write_text(
        study.read_text().replace("[study_area]", 'devices = ["more.py"]\n[study_area]')
    )
    code, _, err = command("run", "study.toml", "--devices", "mine.py")
    assert code == 2
    assert squeezed(str(files / "more.py")) in squeezed(err)
    assert squeezed(str(files / "mine.py")) not in squeezed(err)
    assert command("run", "study.toml", "--devices", "mine.py", "--trust-devices")[0] == 0


def test_init_names_own_devices_in_the_study(command, files):
    (files / "sub").mkdir()
    assert command("init", "sub/new.toml", "--devices", "mine.py")[0] == 0
    study = tomllib.loads((files / "sub" / "new.toml").read_text())
    assert study["case"]["devices"] == ["../mine.py"]


@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
def test_the_guide_goes_from_files_to_a_picture(command, tmp_path, monkeypatch):
    """Its commands and its Python run as printed, in a copy of the example."""
    text = (ROOT / "docs" / "howto" / "own-device.md").read_text(encoding="utf-8")
    copytree(ROOT / "examples" / "own_exciter_dyr", tmp_path / "example")
    monkeypatch.chdir(tmp_path / "example")
    blocks = re.findall(r"```bash\n(.*?)```", text, re.DOTALL)
    commands = [shlex.split(line)[1:] for block in blocks for line in block.splitlines()]
    assert [words[0] for words in commands] == ["check-device", "info", "simulate"]
    for words in commands:
        code, _, err = command(*words)
        assert code == 0, err
    assert (tmp_path / "example" / "run.png").stat().st_size > 20_000
    table = pd.read_csv("run.csv", comment="#")
    (python,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict = {}
    exec(python, names)
    assert names["run"].status is gf.Status.COMPLETED
    again = pd.read_csv("run.csv", comment="#")
    assert list(table.columns) == list(again.columns)
    assert {"field_voltage:12:1", "field_voltage:22:1"} <= set(table.columns)
    np.testing.assert_allclose(table.to_numpy(), again.to_numpy(), rtol=1e-6, atol=1e-9)
    for text in ("12 'PIAVR'", "22 'USRMDL' 1 'PIAVR'"):
        assert text in (tmp_path / "example" / "two_areas.dyr").read_text()


def test_the_slip_that_the_guide_shows_is_what_is_said(command, tmp_path):
    text = (ROOT / "docs" / "howto" / "own-device.md").read_text(encoding="utf-8")
    shown = re.search(r"pi_exciter\.py:\d+: device pi_exciter, derivative kernel: .*", text)
    source = (ROOT / "examples" / "own_exciter_dyr" / "pi_exciter.py").read_text(encoding="utf-8")
    before = "dx[X.integral, i] = "
    assert before in source
    (tmp_path / "pi_exciter.py").write_text(source.replace(before, "dx[3, i] = "))
    code, out, _ = command("check-device", tmp_path / "pi_exciter.py", "--json", "-")
    (finding,) = json.loads(out)[0]["findings"]
    assert (code, finding["text"]) == (2, f"{tmp_path}/{shown[0]}")


def test_a_file_whose_models_no_unit_has_is_told(command, files):
    code, _, err = command("info", "npcc", "--devices", "mine.py", "--json", "-")
    assert (code, "note: no unit of the case has mine (--devices)" in err) == (0, True)
