"""gridfold init, run, show and report, as a user types them."""

import hashlib
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time

import pandas as pd
import pytest

from gridfold.numerics.cuda_device import why_no_gpu
from gridfold.study import solve

SHORT = """schema = 1
name = "short"
[contingencies]
bus_faults = "1-4,26"
clearing_time = 0.05
[model]
kind = "detailed"
[run]
t_end = 1.0
"""


def plain(text):
    """Text without the line breaks of the terminal."""
    return " ".join(text.split())


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text(SHORT)
    return tmp_path


def test_init_writes_a_study_once(command, here):
    code, out, _ = command("init")
    assert code == 0
    assert "gridfold run study.toml" in out
    before = (here / "study.toml").read_text()
    code, _, err = command("init")
    assert (code, "exists already" in err) == (2, True)
    assert (here / "study.toml").read_text() == before


def test_the_schema_is_printed(command, here):
    code, out, _ = command("init", "--schema")
    assert (code, json.loads(out)["title"]) == (0, "gridfold study")
    assert list(here.iterdir()) == [here / "short.toml"]


def test_a_study_is_run_shown_and_exported(command, here):
    code, out, err = command("run", "short.toml")
    assert (code, err) == (0, ""), "quiet where nobody watches"
    assert "5 of 5 done" in out
    assert (here / "short.results" / "study.sqlite").is_file()
    code, out, _ = command("show", "short.results", "--sort", "lowest_voltage", "--limit", 2)
    assert code == 0
    assert "3 more rows" in out
    files = ("--csv", "a.csv", "--parquet", "a.parquet", "--where", "stable = 0")
    assert command("show", "short.results", *files)[0] == 0
    frame = pd.read_csv(here / "a.csv")
    assert frame["name"].tolist() == ["bus 26"]
    assert pd.read_parquet(here / "a.parquet")["critical_machine"].tolist() == ["26:1"]
    code, out, _ = command("show", "short.results", "--json", "-")
    record = json.loads(out)
    assert [row["name"] for row in record["results"]][-1] == "bus 26"
    assert record["study"]["run"]["t_end"] == 1.0


def test_a_line_of_json_for_each_contingency(command, here):
    assert command("run", "short.toml", "--log-json", "log.jsonl", "-j", 1)[0] == 0
    lines = [json.loads(line) for line in (here / "log.jsonl").read_text().splitlines()]
    assert lines[0]["stage"] == "preparing"
    assert lines[-1] == lines[-1] | {"stage": "done", "done": 5, "stable": 4, "unstable": 1}
    names = [line["contingency"]["name"] for line in lines if "contingency" in line]
    assert names == ["bus 1", "bus 2", "bus 3", "bus 4", "bus 26"]


def test_results_are_not_mixed_or_written_over(command, here):
    assert command("run", "short.toml")[0] == 0
    code, _, err = command("run", "short.toml")
    assert (code, "--resume" in err) == (2, True)
    assert command("run", "short.toml", "--resume")[0] == 0
    (here / "short.toml").write_text(SHORT.replace("1.0", "2.0"))
    code, _, err = command("run", "short.toml", "--resume")
    assert (code, "run.t_end was 1.0 and is 2.0" in plain(err)) == (2, True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SHORT.replace("bus_faults", "bus_fault"), "did you mean 'bus_faults'?"),
        (SHORT.replace("1-4,26", "1-4,999"), "there is no bus 999"),
        (SHORT + '[case]\nsource = "gone.raw"\n', "gone.raw"),
        (SHORT + '[case]\ndevices = ["gone.py"]\n', "gone.py"),
        (SHORT.replace('"detailed"', '"linear"') + '[study_area]\nareas = "77"\n', "77"),
        ("[[[", "not TOML"),
    ],
)
def test_a_broken_study_is_refused_before_anything_is_written(command, here, text, said):
    (here / "short.toml").write_text(text)
    code, _, err = command("run", "short.toml")
    assert (code, said in plain(err)) == (2, True), err
    assert not (here / "short.results").exists()


@pytest.mark.skipif(why_no_gpu() is None, reason="there is a GPU")
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--device", "cuda"), "; auto and cpu run on the CPU"),
        (("--precision", "single"), "precision single is for the device cuda, not cpu"),
        (("--precision", "single", "--device", "auto"), "for the device cuda, not auto"),
    ],
)
def test_a_gpu_that_is_not_there_is_told_before_the_work_begins(command, here, options, said):
    code, _, err = command("run", "short.toml", *options)
    assert (code, said in plain(err)) == (2, True), err
    assert not (here / "short.results").exists()


def test_a_case_that_has_vanished_is_named_and_the_results_stay(command, here):
    raw = here / "grid.raw"
    source = f'[case]\nsource = "{raw.name}"\n'
    (here / "short.toml").write_text(SHORT)
    assert command("run", "short.toml")[0] == 0
    (here / "short.toml").write_text(SHORT + source)
    code, _, err = command("run", "short.toml", "--out", "other")
    assert (code, "grid.raw" in err) == (2, True)
    assert command("show", "short.results")[0] == 0


@pytest.mark.parametrize("arguments", [("show",), ("report",), ("run", "short.toml", "--resume")])
def test_a_folder_without_a_study_is_named(command, here, arguments):
    where = ("--out", "nothing") if arguments[0] == "run" else ("nothing",)
    code, _, err = command(*arguments, *where)
    assert (code, "nothing holds no study" in err) == (2, True)


def test_what_makes_no_sense_is_refused_with_what_does(command, here):
    assert command("run", "short.toml")[0] == 0
    for option, value, said in (
        ("--sort", "angel", "there is no column 'angel'"),
        ("--columns", "angel", "there is no column 'angel'"),
        ("--where", "stble = 1", "no such column: stble"),
    ):
        code, _, err = command("show", "short.results", option, value)
        assert (code, said in plain(err)) == (2, True)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_leaves_a_study_that_goes_on(command, here, number):
    one_by_one = SHORT + 'batch = "off"\n'
    (here / "short.toml").write_text(one_by_one.replace("1-4,26", "1-60").replace("1.0", "9.0"))
    arguments = ["run", "short.toml", "--log-json", "log.jsonl"]
    with subprocess.Popen(
        [sys.executable, "-m", "gridfold", *arguments],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ,
    ) as process:
        log = here / "log.jsonl"
        while not (log.exists() and '"contingency"' in log.read_text()):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"go on with --resume" in err
    last = json.loads(log.read_text().splitlines()[-1])
    assert last["stage"] == "interrupted"
    assert 0 < last["done"] < 60
    code, out, _ = command("run", "short.toml", "--resume")
    assert (code, "60 of 60 done" in out) == (0, True)


OWN = """
from dataclasses import replace
from gridfold.dynamics.exciters.sexs import SEXS
OWN = replace(SEXS, model="own_sexs")
"""


@pytest.fixture
def own(here, monkeypatch):
    """A study with a device model of its own, of a user who has trusted nothing yet."""
    monkeypatch.setenv("XDG_STATE_HOME", str(here / "state"))
    (here / "own.py").write_text(OWN)
    text = SHORT.replace("1-4,26", "1") + '[case]\ndevices = ["own.py"]\n'
    (here / "own.toml").write_text(text)
    return here


def squeezed(text):
    """Text without any space: the terminal may break a long path anywhere."""
    return "".join(text.split())


def test_own_code_is_run_once_it_is_trusted_and_told_with_its_hash(command, own):
    digest = hashlib.sha256((own / "own.py").read_bytes()).hexdigest()
    code, _, err = command("run", "own.toml")
    assert code == 2
    assert f"{own / 'own.py'}sha256{digest}" in squeezed(err)
    assert "--trust-devices" in err
    assert not (own / "own.results").exists()
    code, _, err = command("run", "own.toml", "--trust-devices")
    assert code == 0
    assert f"{own / 'own.py'}sha256{digest}" in squeezed(err)
    assert f"rememberedin{own / 'state'}" in squeezed(err)
    code, _, err = command("run", "own.toml", "--out", "again")
    assert (code, "that you trusted before" in err) == (0, True)
    (own / "own.py").write_text(OWN + "# changed\n")
    code, _, err = command("run", "own.toml", "--out", "changed")
    assert (code, "--trust-devices" in err) == (2, True)


def test_trust_of_another_user_or_of_another_file_does_not_count(command, own, monkeypatch):
    assert command("run", "own.toml", "--trust-devices")[0] == 0
    (remembered,) = (own / "state").rglob("*.json")
    text = remembered.read_text()
    remembered.write_text(text.replace('"digest": "', '"digest": "0'))
    assert command("run", "own.toml", "--out", "a")[0] == 2
    remembered.write_text("{")
    assert command("run", "own.toml", "--out", "a")[0] == 2
    remembered.write_text(text)
    assert command("run", "own.toml", "--out", "a")[0] == 0
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert command("run", "own.toml", "--out", "b")[0] == 2


@pytest.mark.parametrize("home", ["/proc/nowhere", "own.py"])
def test_without_a_folder_for_it_trust_is_not_remembered(command, own, monkeypatch, home):
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", home)
    code, _, err = command("run", "own.toml", "--trust-devices")
    assert (code, "not remembered" in err) == (0, True)
    code, _, err = command("run", "own.toml", "--out", "again")
    assert (code, "--trust-devices" in err) == (2, True)


def test_own_code_that_ends_the_program_is_bad_input(command, own):
    (own / "own.py").write_text("import sys\nsys.exit(0)\n")
    code, _, err = command("run", "own.toml", "--trust-devices")
    assert (code, "own.py:2:thecodeofadevicemodelaskstoend" in squeezed(err)) == (2, True)


HOSTILE = "[/Town] fault \\u001b[31m $a$ \\u202e"


def test_names_are_text_in_every_table_and_error(command, here):
    (here / "short.toml").write_text(
        SHORT.replace("1-4,26", "1").replace('"short"', f'"{HOSTILE}"')
        + f'[[contingency]]\nname = "{HOSTILE}"\n'
        + 'events = [{kind="bus-fault", bus=2, duration=0.05}]\n'
    )
    for arguments in (
        ("run", "short.toml"),
        ("show", "short.results"),
        ("report", "short.results"),
    ):
        code, out, err = command(*arguments)
        assert code == 0
        assert "\x1b" not in out + err
        assert "\u202e" not in out + err
        assert arguments[0] == "report" or out.count("[/Town] fault") == 2
    page = (here / "short.results" / "report.html").read_text(encoding="utf-8")
    assert r"[/Town] fault \\x1b[31m $a$ \\u202e" in page
    assert "\u202e" not in page
    code, _, err = command("show", "short.results", "--sort", "[/x]\x1b[31m")
    assert (code, "there is no column '[/x]\\x1b[31m'" in plain(err)) == (2, True)


def test_formulas_in_a_csv_file_are_told_and_defused(command, here):
    section = '[[contingency]]\nname = "=1+1"\nevents = [{kind="bus-fault", bus=2}]\n'
    (here / "short.toml").write_text(SHORT.replace("1-4,26", "1") + section)
    assert command("run", "short.toml")[0] == 0
    _, _, err = command("show", "short.results", "--csv", "a.csv")
    assert "1 text as formulas; --csv-safe" in plain(err)
    assert pd.read_csv(here / "a.csv")["name"].tolist() == ["bus 1", "=1+1"]
    _, _, err = command("show", "short.results", "--csv", "a.csv", "--csv-safe")
    assert "begin with ' now" in plain(err)
    assert pd.read_csv(here / "a.csv")["name"].tolist() == ["bus 1", "'=1+1"]
    code, _, err = command("show", "short.results", "--csv-safe")
    assert (code, "give --csv" in plain(err)) == (2, True)


def test_failed_rows_have_an_exit_code_are_counted_and_tried_again(command, here, monkeypatch):
    (here / "short.toml").write_text(SHORT + 'batch = "off"\n')
    original = solve.simulate

    def simulate(model, events, *rest):
        if events[0].bus in (1, 3):
            raise MemoryError("[/no] room")
        return original(model, events, *rest)

    monkeypatch.setattr(solve, "simulate", simulate)
    code, out, err = command("run", "short.toml")
    assert code == 4
    assert "'bus 1' failed: MemoryError: [/no] room" in plain(err)
    assert "2 of 5 failed; --retry-failed tries them again" in plain(err)
    assert "5 shown of 5 rows; 5 contingencies: 2 stable, 1 not, 2 failed" in plain(out)
    code, out, _ = command("show", "short.results", "--where", "stable = 1", "--limit", 1)
    assert code == 0
    assert "1 shown of 2 rows (1 more rows); 5 contingencies: 2 stable, 1 not, 2 failed" in plain(
        out
    )
    _, out, _ = command("show", "short.results", "--where", "stable = 1", "--json", "-")
    counts = {"total": 5, "stable": 2, "unstable": 1, "failed": 2, "waiting": 0}
    assert json.loads(out)["counts"] == counts
    assert command("run", "short.toml", "--resume")[0] == 4, "it is not forgotten"
    monkeypatch.undo()
    monkeypatch.chdir(here)
    code, out, _ = command("run", "short.toml", "--retry-failed")
    assert (code, "4 stable, 1 not, 0 failed" in plain(out)) == (0, True)


def test_a_time_limit_makes_slow_contingencies_fail(command, here):
    (here / "short.toml").write_text(SHORT.replace("1-4,26", "1") + "step = 1e-5\n")
    code, _, err = command("run", "short.toml", "--time-limit", 0.05)
    assert (code, "not done within the time limit of 0.05 s" in plain(err)) == (4, True)
    code, _, err = command("run", "short.toml", "--time-limit", 0, "--out", "b")
    assert (code, "positive number of seconds" in plain(err)) == (2, True)


def test_a_damaged_study_is_checked_repaired_and_gone_on_with(command, here):
    assert command("run", "short.toml")[0] == 0
    assert command("check", "short.results")[0] == 0
    with sqlite3.connect(here / "short.results" / "study.sqlite") as connection:
        connection.execute("UPDATE result SET largest_separation_deg = 1.0 WHERE number = 2")
    connection.close()
    code, out, err = command("show", "short.results")
    assert (code, "bus 2 " in out, "4 shown of 4 rows" in plain(out)) == (0, False, True)
    assert "result of contingency 2: it is not what was written" in plain(err)
    assert command("run", "short.toml", "--resume")[0] == 2
    code, out, _ = command("check", "short.results")
    assert (code, "4 results of 5 contingencies" in plain(out)) == (1, True)
    code, out, _ = command("check", "short.results", "--repair", "--json", "-")
    assert (code, json.loads(out)["repaired"]["kept"]) == (0, 4)
    code, out, _ = command("run", "short.toml", "--resume")
    assert (code, "5 of 5 done" in out) == (0, True)
    assert command("check", "short.results")[0] == 0
