"""gridfold sample, as a user types it."""

import json

import pandas as pd
import pytest

PLAN = """samples = 6
seed = 1
chunk = 3
[[load]]
name = "load"
factor = { uniform = [0.98, 1.02] }
[faults]
bus_faults = "3,4"
clearing_time = 0.05
[run]
t_end = 0.5
step = 0.01
method = "rk4"
[check]
samples = 0
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path


def test_samples_are_made_told_and_resumed(command, here):
    code, out, err = command("sample", "plan.toml", "--workers", "threads", "-j", "1")
    assert (code, err) == (0, ""), "quiet where nobody watches"
    assert "6 of 6 in plan.samples" in out
    assert "6 stable, 0 unstable, 0 infeasible, 0 failed" in out
    frame = pd.read_parquet(here / "plan.samples" / "samples")
    assert frame["load"].between(0.98, 1.02).all()
    code, _, err = command("sample", "plan.toml")
    assert (code, "holds samples already" in err) == (2, True)
    code, out, _ = command("sample", "plan.toml", "--resume", "--workers", "threads", "-j", "1")
    assert (code, "6 of 6" in out) == (0, True)


def test_init_writes_a_plan_once(command, here):
    code, out, _ = command("init", "--samples", "new.toml")
    assert (code, "Next: gridfold sample new.toml" in out) == (0, True)
    code, _, err = command("init", "--samples", "new.toml")
    assert (code, "exists already" in err) == (2, True)
    code, _, err = command("init", "--samples", "other.toml", "--devices", "x.py")
    assert (code, "a plan names them in [case]" in err) == (2, True)
    assert not (here / "other.toml").exists()


def test_the_schema_of_plans_is_printed(command, here):
    code, out, _ = command("init", "--samples", "--schema")
    assert (code, json.loads(out)["title"]) == (0, "gridfold sample plan")


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (("seed = 1", "sed = 1"), "plan.toml:2: unknown key 'sed'; did you mean 'seed'?"),
        (('name = "load"', 'where = "area:99"'), "load 1, where: "),
        (('"3,4"', '"9999"'), "bus_faults"),
    ],
)
def test_bad_plans_end_with_a_word_and_leave_nothing(command, here, change, fault):
    (here / "plan.toml").write_text(PLAN.replace(*change))
    code, _, err = command("sample", "plan.toml", "--workers", "threads", "-j", "1")
    assert (code, fault in " ".join(err.split())) == (2, True)
    assert not (here / "plan.samples").exists()
