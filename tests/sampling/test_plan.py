"""The plan: every key is read, every fault is named with its line and key."""

import json
from importlib import resources

import jsonschema
import pytest

from gridfold import CaseFileError, OutputError
from gridfold.sampling.plan import SamplePlan, load_plan, plan_schema, write_plan

TEMPLATE = resources.files("gridfold.sampling").joinpath("plan.toml").read_text("utf-8")
LEAST = 'samples = 4\nseed = 1\n[faults]\nbus_faults = "3"\n'


def faults(tmp_path, text):
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(CaseFileError) as caught:
        load_plan(path)
    return "\n".join(caught.value.faults).replace(str(tmp_path), "")


def test_the_template_is_a_plan_that_its_schema_knows(tmp_path):
    path = tmp_path / "plan.toml"
    write_plan(path)
    plan = load_plan(path)
    assert plan.names == ("load_west", "load_2")
    jsonschema.validate(plan.content(), plan_schema())
    with pytest.raises(OutputError, match="exists already"):
        write_plan(path)


def test_every_key_stands_in_the_template():
    shared = {"case", "contingency"}  # as in study files, where a test holds them
    for name, field in SamplePlan.model_fields.items():
        sections = (field.annotation, *getattr(field.annotation, "__args__", ()))
        keys = next((s.model_fields for s in sections if hasattr(s, "model_fields")), {})
        assert f"{field.alias or name}" in TEMPLATE
        if name not in shared:
            assert [key for key in keys if f"{key} = " not in TEMPLATE] == []


def test_commented_keys_show_their_defaults():
    plan = SamplePlan.model_validate({"samples": 1, "seed": 0, "faults": {"bus_faults": "1"}})
    for key, value in (
        ("filling", plan.filling.value),
        ("chunk", plan.chunk),
        ("units", plan.balance.units),
        ("machine_trips", plan.faults.machine_trips),
        ("trajectories", plan.outputs.trajectories.value),
        ("monitor", list(plan.outputs.monitor)),
    ):
        assert f"# {key} = {json.dumps(value)}" in TEMPLATE


def test_all_faults_are_told_at_once_with_line_and_key(tmp_path):
    text = (
        "samples = 0\nseed = 1\n"
        '[[load]]\nwhere = "area:1"\nfactor = { uniform = [0.9, 1.1] }\n'
        '[[load]]\nwhere = "area:"\nfacto = 1.0\n'
        '[faults]\nbus_fault = "3"\n'
        "clearing_time = { uniform = [0.2, 0.1] }\n"
        '[run]\nt_end = "long"\n'
    )
    found = faults(tmp_path, text)
    assert "/plan.toml:1: samples: " in found
    assert "/plan.toml:7: load.1.where: " in found
    assert "/plan.toml:8: unknown key 'load.1.facto'; did you mean 'factor'?" in found
    assert "/plan.toml:10: unknown key 'faults.bus_fault'; did you mean 'bus_faults'?" in found
    assert "/plan.toml:11: faults.clearing_time.uniform: the first number must be below" in found
    assert "/plan.toml:13: run.t_end: " in found


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("seed = 1\n", "samples is missing"),
        ("samples = 4\n", "seed is missing"),
        ("samples = 4\nseed = -1\n", "seed: "),
        ("samples = 4\nseed = true\nfilling = 'halton'\n", "filling: "),
        (LEAST + "[[load]]\n", "/plan.toml:5: load.0: give factor or change_mw, one of the two"),
        (LEAST + "[[load]]\nfactor = 1\nchange_mw = 3\n", "give factor or change_mw"),
        (LEAST + "[[load]]\nfactor = true\n", "load.0.factor: "),
        (LEAST + '[[load]]\nfactor = "1.1"\n', "load.0.factor: "),
        (LEAST + "[[load]]\nfactor = -0.5\n", "factor must not be negative"),
        (
            LEAST + "[[load]]\nfactor = { normal = [1, 0.2] }\n",
            "factor must not be negative; cut a normal distribution with within",
        ),
        (LEAST + "[[load]]\nfactor = { unifrom = [1, 2] }\n", "did you mean 'uniform'?"),
        (LEAST + "[[generation]]\nfactor = { uniform = [1] }\n", "generation.0.factor.uniform"),
        (LEAST + '[[parameter]]\nparameter = "inertia"\n', "give factor or value"),
        (LEAST + "[[parameter]]\nfactor = 1\n", "parameter.0.parameter is missing"),
        (LEAST + '[[load]]\nname = "stable"\nfactor = 1\n', "columns of every data set are called"),
        (LEAST + '[[load]]\nname = "2x"\nfactor = 1\n', "load.0.name: "),
        (
            LEAST + '[[load]]\nname = "a"\nfactor = 1\n[[load]]\nname = "a"\nfactor = 1\n',
            "several things that are drawn have one name: a",
        ),
        (LEAST + "clearing_time = 0\n", "clearing_time must be positive"),
        (LEAST + "clearing_time = { uniform = [0.1, 17] }\n", "run.t_end must lie after"),
        (LEAST + "[clearing_times]\nwanted = true\nlongest = 20\n", "clearing_times.longest must"),
        (LEAST + '[outputs]\nmonitor = "every 0"\n', "outputs.monitor"),
        (LEAST + "[study_area]\n", "unknown key 'study_area'"),
    ],
)
def test_a_fault_is_named(tmp_path, text, fault):
    assert fault in faults(tmp_path, text)
