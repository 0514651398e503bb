"""The command as a user runs it."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from bad_input_samples import CASE_FOLDERS, DEVICE_FOLDERS, EVENTS, EventSample, FolderSample

import gridfold as gf


def test_simulate_keeps_its_contract_for_scripts(command, tmp_path, npcc):
    csv, facts = tmp_path / "out.csv", tmp_path / "out.json"
    code, _, _ = command(
        "simulate", "npcc", "--fault-bus", 3, "--fault-start", 0, "--fault-duration", 0.2,
        "--t-end", 16, "--step", 0.01, "--csv", csv, "--json", facts,
    )  # fmt: skip
    assert code == 0
    frame = pd.read_csv(csv)
    assert frame.columns[0] == "time"
    assert {"angle_deg:23:2", "speed_pu:78:1", "voltage_pu:140"} <= set(frame.columns)
    expected = gf.simulate(npcc, [gf.BusFault(3, duration=0.2)], 16.0)
    np.testing.assert_allclose(frame["time"], expected.times, atol=1e-9)
    np.testing.assert_allclose(
        frame["angle_deg:23:2"], expected.rotor_angle_deg(["23:2"])[:, 0], rtol=1e-8
    )
    record = json.loads(facts.read_text())
    assert record["status"] == "completed"
    assert record["steps"] == 1600
    assert (record["states"], record["machines"], record["buses"]) == (432, 48, 140)
    assert record["setup_seconds"] > 0
    assert record["simulation_seconds"] > 0


def test_exit_code_tells_loss_of_synchronism(command, tmp_path):
    code, out, _ = command(
        "simulate", "npcc", "--fault-bus", 3, "--fault-duration", 0.6, "--csv", tmp_path / "a.csv"
    )
    assert code == 3
    assert "lost synchronism" in out
    assert (tmp_path / "a.csv").exists()


def test_exit_code_tells_states_that_are_not_finite(command):
    code, out, _ = command(
        "simulate", "npcc", "--fault-bus", 36, "--fault-duration", 0.6, "--step", 0.1,
        "--method", "rk4", "--no-watch", "--json", "-"
    )  # fmt: skip
    assert code == 1
    assert json.loads(out)["status"] == "not finite"


def test_the_method_is_chosen_and_told(command, tmp_path):
    facts, csv = tmp_path / "a.json", tmp_path / "a.csv"
    begin = ("simulate", "npcc", "--t-end", 0.2, "--json", facts, "--csv", csv)
    code, out, _ = command(*begin)
    assert code == 0
    record = json.loads(facts.read_text())
    assert record["method"] == record["stepper"]["name"] == "rk4"
    assert "is stable at 0.01 s" in record["method_reason"]
    assert "".join(record["method_reason"].split()) in "".join(out.split())
    assert json.loads((tmp_path / "a.csv.meta.json").read_text())["method"] == "rk4"
    code, _, _ = command(*begin, "--step", 0.2)
    record = json.loads(facts.read_text())
    assert record["method"] == record["stepper"]["name"] == "trapezoidal"
    assert "rk4 at 0.2 s would be unstable" in record["method_reason"]
    command(*begin, "--method", "trapezoidal")
    assert json.loads(facts.read_text())["method"] == "trapezoidal"


def test_an_explicit_method_that_would_be_unstable_is_refused(command, tmp_path):
    csv = tmp_path / "a.csv"
    code, out, err = command("simulate", "npcc", "--method", "rk4", "--step", 0.2, "--csv", csv)
    assert (code, out) == (2, "")
    assert err.startswith("gridfold: error:")
    for text in ("rk4 at 0.2 s would be unstable", "two_axis 26:1", "0.15 s", "trapezoidal"):
        assert text in " ".join(err.split())
    assert not csv.exists()


def test_clearing_times_say_by_which_method_they_were_found(command):
    _, out, _ = command(
        "cct", "npcc", "--buses", 3, "--step", 0.16, "--longest", 0.5, "--t-end", 2, "--json", "-"
    )
    row = json.loads(out)
    assert row["method"] == "trapezoidal"
    assert "needs at most 0.15 s" in row["method_reason"]


def test_json_on_standard_output_is_all_there_is(command):
    code, out, err = command("info", "npcc", "--json", "-")
    assert code == 0
    assert json.loads(out)["states"] == 432
    assert err == ""


def test_events_come_from_options_and_files_alike(command, tmp_path):
    file = tmp_path / "events.toml"
    file.write_text('[[event]]\nkind = "branch-fault"\nbranch = "3-2"\nduration = 0.1\n')
    _, from_file, _ = command("simulate", "npcc", "--events", file, "--t-end", 1, "--json", "-")
    text = "branch-fault branch=3-2 duration=0.1"
    _, from_text, _ = command("simulate", "npcc", "--event", text, "--t-end", 1, "--json", "-")
    assert json.loads(from_file)["events"] == json.loads(from_text)["events"]
    assert json.loads(from_file)["swings"] == json.loads(from_text)["swings"]


def test_all_result_files_are_written(command, tmp_path):
    names = ["a.csv", "a.parquet", "a.npz", "a.png", "a.svg", "a.json"]
    options = [f"--{kind}" for kind in ("csv", "parquet", "npz", "plot", "plot", "json")]
    files = [tmp_path / name for name in names]
    pairs = [item for pair in zip(options, files, strict=True) for item in pair]
    code, _, _ = command(
        "simulate", "npcc", "--fault-bus", 3, "--t-end", 0.5, "--method", "abm4",
        "--network", "sparse", "--monitor", "speed, field_voltage, active_power", *pairs,
    )  # fmt: skip
    assert code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*names, "a.csv.meta.json"])
    assert "active_power:23:1" in pd.read_parquet(tmp_path / "a.parquet").columns
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "a.svg").read_text()


def test_cct_writes_buses_and_times_and_once_what_holds_for_all_of_them(command):
    code, out, _ = command("cct", "npcc", "--buses", "3,5-6", "--json", "-")
    assert code == 0
    facts = json.loads(out)
    assert facts["data_doubts"]
    assert out.count(json.dumps(facts["data_doubts"][0])) == 1
    assert [(row["bus"], row["cct_s"]) for row in facts["clearing_times"]] == [
        (3, 0.39),
        (5, 0.09),
        (6, 0.08),
    ]


def test_cct_of_lines_has_a_row_for_each_end(command):
    options = (
        "--lines",
        "3-2",
        "--t-end",
        1,
        "--longest",
        0.1,
        "--resolution",
        0.05,
        "--model",
        "detailed",
    )
    code, out, _ = command("cct", "npcc", *options, "--json", "-")
    assert code == 0
    rows = json.loads(out)["clearing_times"]
    assert [(row["bus"], row["branch"], row["fraction"]) for row in rows] == [
        (None, "3-2", 0.0),
        (None, "3-2", 1.0),
    ]
    assert all(row["cct_s"] >= 0.05 for row in rows)
    _, out, _ = command("cct", "npcc", *options)
    assert out.index("line 3-2 at 3") < out.index("line 3-2 at 2")


def test_eigenvalues_are_printed_drawn_and_exported(command, tmp_path):
    code, out, _ = command("eigenvalues", "npcc", "--count", 3, "--plot", tmp_path / "m.png")
    assert code == 0
    assert "Rightmost eigenvalue apart from the common angle: -0.24" in out
    assert (tmp_path / "m.png").exists()
    _, out, _ = command("eigenvalues", "npcc", "--json", "-")
    modes = json.loads(out)["modes"]
    assert sum(mode["common_angle"] for mode in modes) == 1


def test_demo_prints_what_happened_and_draws_it(command, tmp_path):
    code, out, _ = command("demo", "--out", tmp_path / "demo")
    assert code == 0
    assert "fault at bus 3 cleared" in out
    assert "0.39 s for this fault" in out
    assert {p.name for p in (tmp_path / "demo").iterdir()} == {
        "bus3.csv",
        "bus3.csv.meta.json",
        "bus3.png",
    }


def test_a_repeated_event_text_is_bad_input_without_a_traceback(command):
    code, out, err = command("simulate", "npcc", "--event", "bus-fault bus=3 bus=4")
    assert (code, out) == (2, "")
    assert err.startswith("gridfold: error:")


@pytest.mark.parametrize("sample", EVENTS, ids=lambda sample: sample.id)
def test_a_bad_event_ends_with_exit_code_2_a_message_and_no_file(
    command, tmp_path, sample: EventSample
):
    events = [item for text in sample.texts for item in ("--event", text)]
    target = tmp_path / "out.csv"
    code, out, err = command(
        "simulate", "npcc", "--t-end", sample.t_end, *events, "--csv", target, "--json", "-"
    )
    assert (code, out) == (2, "")
    assert err.startswith("gridfold: error:")
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("sample", CASE_FOLDERS + DEVICE_FOLDERS, ids=lambda sample: sample.id)
def test_a_bad_case_ends_with_exit_code_2_and_a_message(command, tmp_path, sample: FolderSample):
    code, out, err = command("simulate", sample.write(tmp_path / "case"), "--t-end", 0.1)
    assert (code, out) == (2, "")
    assert err.startswith("gridfold: error:")
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "no-such-case"),
        ("simulate", "npcc", "--fault-duration", "0.1"),
        ("simulate", "npcc", "--trip-bus"),
        ("simulate", "npcc", "--fault-bus", "three"),
        ("simulate", "npcc", "--step", "0"),
        ("simulate", "npcc", "--step", "nan"),
        ("simulate", "npcc", "--t-end", "-1"),
        ("simulate", "npcc", "--angle-limit", "0"),
        ("simulate", "npcc", "--method", "euler"),
        ("simulate", "npcc", "--plot", "run.pdf"),
        ("simulate", "npcc", "--events", "no-such-file.toml"),
        ("simulate", "npcc", "--t-end", "0.1", "--signals", "nonsense", "--csv", "x.csv"),
        ("cct", "npcc", "--resume"),
        ("cct", "npcc", "--plot", "map.pdf"),
        ("cct", "npcc", "--csv-safe"),
        ("cct", "npcc", "--buses", "1-x"),
        ("cct", "npcc", "--buses", "9-3"),
        ("cct", "npcc", "--buses", "999"),
        ("cct", "npcc", "--lines", "1-36"),
        ("cct", "npcc", "--buses", "none"),
        ("cct", "npcc", "--buses", "3", "--longest", "20"),
        ("eigenvalues", "npcc", "--count", "0"),
        ("info",),
        ("frobnicate",),
    ],
)
def test_bad_options_end_with_exit_code_2_and_leave_nothing(
    command, tmp_path, monkeypatch, arguments
):
    monkeypatch.chdir(tmp_path)
    code, _, err = command(*arguments)
    assert code == 2
    assert err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_a_result_that_cannot_be_written_is_an_error_with_its_path(command, tmp_path):
    (tmp_path / "file").write_text("")
    target = tmp_path / "file" / "out.csv"
    code, _, err = command("simulate", "npcc", "--t-end", 0.1, "--csv", target)
    assert code == 2
    assert str(target) in err.replace("\n", "")


def test_installed_command_and_help_work_in_a_process_of_their_own():
    command = [sys.executable, "-c", "from gridfold.cli import main; main()"]
    shown = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True)
    for name in ("demo", "info", "simulate", "plot", "compare", "eigenvalues", "cct"):
        assert name in shown.stdout
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.strip() == f"gridfold {gf.__version__}"


def test_a_step_that_is_coarse_or_longer_than_the_fault_is_told_among_the_events(command, tmp_path):
    arguments = ("npcc", "--fault-bus", 3, "--step", 0.15, "--t-end", 2)
    code, out, err = command("simulate", *arguments, "--json", tmp_path / "run.json")
    notices = json.loads((tmp_path / "run.json").read_text())["notices"]
    assert (code, err) == (0, "")
    assert ["is coarse" in notices[0]["text"], notices[0]["time"]] == [True, 0.0]
    assert "longer than the shortest fault of 0.1 s" in notices[1]["text"]
    assert "coarse" in out


def test_the_step_of_a_run_may_follow_from_its_error(command):
    code, out, _ = command("simulate", "npcc", "--fault-bus", 3, "--t-end", 2, "--step", "auto")
    assert code == 0
    assert "degree from half the step" in " ".join(out.split())


@pytest.mark.parametrize("step", ["auto", "short"])
def test_a_step_that_is_no_number_is_bad_input(command, step):
    code, _, err = command("cct", "npcc", "--buses", 3, "--step", step)
    assert code == 2
    assert f"not '{step}'" in " ".join(err.split())


@pytest.mark.parametrize("step", ["1e300", "1e-9", "2"])
def test_a_step_that_makes_no_sense_is_bad_input(command, step):
    code, _, err = command("simulate", "npcc", "--fault-bus", 3, "--step", step)
    assert code == 2
    assert "time step must lie between 1e-06 and 1 s" in " ".join(err.split())


def test_an_island_that_runs_away_ends_with_a_code_and_its_figures(command, tmp_path):
    event = "branch-trip branch=20-26 time=0.1"
    code, out, _ = command(
        "simulate", "npcc", "--event", event, "--t-end", 3, "--json", tmp_path / "run.json"
    )
    record = json.loads((tmp_path / "run.json").read_text())
    assert (code, record["status"], record["stable"]) == (3, "off speed", False)
    assert (record["islands"], record["lost_load_mw"]) == (2, 0.0)
    assert record["islanded_mw"] == pytest.approx(800.0)
    assert record["frequency"]["highest_hz"] > 67.0
    assert "Islands" in out
    code, _, _ = command(
        "simulate",
        "npcc",
        "--event",
        event,
        "--t-end",
        3,
        "--speed-limit",
        1,
        "--model",
        "detailed",
    )
    assert code == 0


def test_a_backend_of_a_notebook_costs_neither_picture_nor_file(command, tmp_path, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    arguments = ("simulate", "npcc", "--fault-bus", 3, "--t-end", 0.2)
    files = ("--json", tmp_path / "a.json", "--plot", tmp_path / "a.png")
    assert command(*arguments, *files)[0] == 0
    assert os.environ["MPLBACKEND"] == "agg"
    assert (tmp_path / "a.png").stat().st_size > 0


def test_what_is_cheap_is_written_before_a_picture_fails(command, tmp_path, monkeypatch):
    def fail(*arguments):
        raise gf.OutputError("a.png: cannot be written")

    monkeypatch.setattr("gridfold.cli.run.plot_trajectory", fail)
    monkeypatch.setattr("gridfold.cli.analysis.plot_eigenvalues", fail)
    files = ("--json", tmp_path / "a.json", "--plot", tmp_path / "a.png")
    for arguments in (
        ("simulate", "npcc", "--fault-bus", 3, "--t-end", 0.2, "--csv", tmp_path / "a.csv"),
        ("eigenvalues", "npcc"),
    ):
        code, out, err = command(*arguments, *files)
        assert (code, "cannot be written" in " ".join(err.split())) == (2, True)
        assert json.loads((tmp_path / "a.json").read_text())["case"] == "npcc"
        assert out
        (tmp_path / "a.json").unlink()
    assert (tmp_path / "a.csv").exists()


def test_a_detailed_run_with_tables_is_written_while_it_runs(command, tmp_path, monkeypatch):
    monkeypatch.setattr("gridfold.cli.run.summarize", None)  # needs the whole run
    few = "speed_pu:78:1,voltage_pu:3"
    code, out, _ = command(
        "simulate", "npcc", "--t-end", 0.2, "--csv", tmp_path / "a.csv", "--columns", few
    )
    assert code == 0
    assert "Lowest voltage" in out
    assert (tmp_path / "a.csv").read_text().splitlines()[0] == f"time,{few}"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--t-end", "1e9"), "would take 2.91 TiB of memory"),
        (("--t-end", "nan"), "positive number of seconds, not nan"),
        (("--t-end", "1e400"), "positive number of seconds, not inf"),
        (("--csv", ""), "cannot be written"),
        (("--npz", "/dev/null"), "it is a pipe or a device"),
        (("--monitor", "voltage 999"), "--monitor: voltage: there is no bus 999"),
        (("--monitor", "101-103"), "has no quantity before it"),
        (("--comtrade", "a.dat"), "a record in COMTRADE ends in .cfg"),
        (("--csv", "a.csv", "--columns", "speed:x"), "there is no column 'speed:x'"),
        (("--csv", "a.csv", "--columns", "time", "--signals", "x"), "not both"),
        (("--monitor", "voltage", "--signals", "x"), "give --monitor or --signals, not both"),
    ],
)
def test_what_cannot_be_done_is_refused_before_the_run(
    command, tmp_path, monkeypatch, options, said
):
    monkeypatch.chdir(tmp_path)
    code, _, err = command("simulate", "npcc", *options)
    assert code == 2
    assert said in " ".join(err.split())
    assert not list(tmp_path.iterdir())


def test_events_and_relays_act_in_a_run_of_the_command(command, tmp_path, npcc):
    """The same instants as from Python, in the notices of the JSON."""
    relays = tmp_path / "relays.toml"
    relays.write_text(
        """
        [[relays]]
        kind = "distance"
        branch = "2-33"
        bus = 2
        [[relays]]
        kind = "under-frequency-shedding"
        areas = "1"
        measured_at = 3
        stages = [{ pickup = 59.97, delay = 0.2, share = 0.1 }]
        """
    )
    facts = tmp_path / "facts.json"
    events = ["redispatch areas=1 active_mw=-50", "load-step bus=3 time=0.5 active_mw=900"]
    code, _, _ = command(
        "simulate", "npcc", "--model", "detailed", "--t-end", 4, "--relays", relays,
        "--event", events[0], "--event", events[1], "--json", facts,
    )  # fmt: skip
    assert code == 0
    record = json.loads(facts.read_text())
    given = [gf.Redispatch(-50.0, areas="1"), gf.LoadStep(3, 0.5, 900.0), *gf.load_relays(relays)]
    run = gf.simulate(npcc, given, 4.0)
    assert record["notices"] == [notice._asdict() for notice in run.notices]
    assert record["notices"][-1]["text"].startswith(
        "under-frequency shedding stage 1 (59.97 Hz): 10 %"
    )
    assert [event["kind"] for event in record["events"]] == [
        "redispatch", "load-step", "distance", "under-frequency-shedding",
    ]  # fmt: skip


def test_a_line_trip_is_told_to_be_a_branch_trip(command):
    code, _, err = command("simulate", "npcc", "--event", "line-trip branch=3-2")
    assert code == 2
    assert "unknown kind 'line-trip'; did you mean 'branch-trip'?" in " ".join(err.split())


def test_a_run_is_held_against_criteria(command, tmp_path):
    """A run that is completed and violates one ends with exit code 5; others are told beside it."""
    file = tmp_path / "criteria.toml"
    file.write_text('[[criteria]]\nkind = "voltage-dip"\nlevel = 0.99\nbuses = "all"\n')
    begin = ("simulate", "npcc", "--fault-bus", 3, "--t-end", 2, "--criteria", file)
    code, out, _ = command(*begin, "--criterion", "frequency from 59 to 61 Hz")
    assert code == 5
    assert all(word in out for word in ("violated", "kept", "frequency"))
    code, out, _ = command(*begin, "--json", "-")
    found = json.loads(out)["criteria"]
    assert [item["verdict"] for item in found] == ["violated"]
    code, _, _ = command(*begin[:6], "--criterion", "frequency from 59 to 61 Hz", "--json", "-")
    assert code == 0
    code, _, err = command(*begin[:6], "--criterion", "frequency from 49 to 51 Hz")
    assert code == 2
    assert "does not hold the 60 Hz" in " ".join(err.split())


def test_the_frequency_of_a_run_that_ended_early_is_said_to_be_that_until_then(command):
    _, out, _ = command("simulate", "npcc", "--fault-bus", 26, "--fault-duration", 0.5)
    words = " ".join(out.split())
    assert "until the run ended at 0.11 s" in words
    assert "Largest changes of rotor angles since the start" in words
