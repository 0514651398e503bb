"""The study file: every key is read, every fault is named with its line."""

import json
import time

import jsonschema
import pytest

from gridfold import CaseFileError, OutputError
from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.equivalents.choice import ModelSettings, ReductionSettings, RetainSettings
from gridfold.equivalents.model_kind import ModelKind, Outputs, ReducerKind, Weights
from gridfold.study.study_file import (
    Study,
    json_schema,
    load_study,
    parse_study,
    template,
    write_template,
)

LEAST = 'schema = 1\n[contingencies]\nbus_faults = "1-3"\n'


def written(tmp_path, text):
    path = tmp_path / "study.toml"
    path.write_text(text)
    return path


def faults(tmp_path, text):
    with pytest.raises(CaseFileError) as caught:
        load_study(written(tmp_path, text))
    return "\n".join(caught.value.faults)


def test_the_template_is_a_study_with_the_documented_defaults(tmp_path):
    path = tmp_path / "study.toml"
    write_template(path)
    study = load_study(path)
    assert study.model.kind is ModelKind.AUTO
    assert study.case.source == "npcc"
    with pytest.raises(OutputError, match="exists already"):
        write_template(path)
    assert path.read_text() == template()


def test_every_key_stands_in_the_template_with_its_default(tmp_path):
    """Uncommenting each line gives a file whose values are the defaults, but for the examples."""
    known = {
        f"{name}.{key}"
        for name, section in Study.model_fields.items()
        if hasattr(section.annotation, "model_fields")
        for key, field in section.annotation.model_fields.items()
        if not (field.json_schema_extra or {}).get("deprecated")
    }
    section, told = "", set()
    for line in template().splitlines():
        plain = line.removeprefix("# ")
        if plain.startswith("[") and not plain.startswith("[["):
            section = plain[1 : plain.index("]")]
        elif "=" in plain and not plain.startswith((" ", "{", "]")):
            told.add(f"{section}.{plain.split('=')[0].strip()}")
    assert known <= told


def test_the_defaults_are_those_of_the_template(tmp_path):
    study = load_study(written(tmp_path, LEAST))
    from_template = load_study(written(tmp_path, template()))
    assert study.run == from_template.run
    assert study.model == from_template.model
    assert study.check == from_template.check
    assert study.outputs == from_template.outputs


def test_an_unknown_key_names_its_line_and_the_nearest_known_one(tmp_path):
    text = faults(tmp_path, LEAST + "clearing_tme = 0.1\n[modle]\nkind = 'linear'\n")
    assert "study.toml:4: unknown key 'contingencies.clearing_tme'; did you mean 'clea" in text
    assert "study.toml:5: unknown key 'modle'; did you mean 'model'?" in text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 2\n", "schema"),
        (LEAST + "[run]\nt_end = -1\n", "study.toml:5: run.t_end: input should be greater than 0"),
        (LEAST + "[run]\nt_end = nan\n", "run.t_end"),
        (LEAST + "[model]\nkind = 'fast'\n", "study.toml:5: model.kind"),
        (LEAST + "[model]\nreducer = 'modal'\n", "model: the modal reducer needs an order"),
        (
            LEAST + "[model]\nreducer = 'modal'\norder = 9\nslow_modes = 0.1\n",
            "model: slow modes have no effect on the modal reducer",
        ),
        (
            LEAST + "[model]\nreducer = 'modal'\norder = 9\ntolerance = 0.1\n",
            "model: a tolerance has no effect on the modal reducer",
        ),
        (
            LEAST + "[model]\norder = 9\ntolerance = 0.1\n",
            "model: give either the tolerance or the order",
        ),
        (LEAST + "[model]\nretain = -1\n", "study.toml:5: model.retain"),
        (
            LEAST + "[model]\nretain_buses = 'far'\n",
            "study.toml:5: model.retain_buses: 'far' names",
        ),
        (
            LEAST + "[model]\nretain = 3\nretain_buses = '42'\n",
            "model: give one of the column norm, the buses and the number of retained machines",
        ),
        (LEAST + "[model]\nweights = 'heavy'\n", "study.toml:5: model.weights"),
        (LEAST + "[model]\nwhole_deg = -1\n", "study.toml:5: model.whole_deg"),
        (
            LEAST + "[model]\nkind = 'retained'\noutputs = 'states'\n",
            "model: outputs 'states' has no effect on the retained model",
        ),
        (
            LEAST + "[model]\noutputs = 'states'\n",
            "model: outputs 'states' has no effect on the auto model",
        ),
        (
            LEAST + "[model]\nkind = 'whole'\ncoupling = 'lagged'\n",
            "model: the lagged coupling has no effect on the whole model",
        ),
        (
            LEAST + "[model]\nkind = 'paper'\noutputs = 'polar'\n",
            "model: the paper model forms states: outputs 'polar' is not its",
        ),
        (
            LEAST + "[model]\nkind = 'linear'\noutputs = 'polar'\ncoupling = 'lagged'\n",
            "model: the lagged coupling needs outputs 'states'",
        ),
        (
            LEAST + "[model]\ncalibrate = true\n",
            "model.calibrate finds the paper's thresholds, not auto's",
        ),
        (
            LEAST + "[model]\nkind = 'adaptive'\ncalibrate = true\n",
            "model.calibrate finds the paper's thresholds, not adaptive's",
        ),
        (LEAST + "[check]\nsample = 'some'\n", "study.toml:5: check.sample"),
        (LEAST + "[clearing_times]\nwanted = true\nlongest = 99\n", "clearing_times.longest"),
        (LEAST + "[[contingency]]\nname = ''\nevents = []\n", "contingency"),
        (LEAST + "[[contingency]]\nname = 'a'\nevnts = []\n", "did you mean 'events'?"),
        (LEAST + "[case]\nraw_revision = 28\n", "study.toml:5: case.raw_revision"),
        (LEAST + "[case]\nraw_revision = 'x'\n", "study.toml:5: case.raw_revision"),
        (LEAST + "[outputs]\nmonitor = '3-2'\n", "study.toml:5: outputs.monitor"),
        (
            LEAST + "[outputs]\nmonitor = ['voltage', 'flw 3-2']\n",
            "study.toml:5: outputs.monitor.1: flw: the range '3-2' ends before it starts "
            "(did you mean flow?), not 'flw 3-2'",
        ),
        (LEAST + "[outputs]\nmonitor = 'every 0'\n", "'every' is followed by a number of steps"),
        (
            LEAST + "[outputs]\nmonitor = 'voltage'\nsignals = ['speed']\n",
            "outputs.monitor takes the place of outputs.signals",
        ),
        (
            LEAST + "[check]\nsample = 'some'\n",
            "study.toml:5: check.sample: input should be a valid int",
        ),
        (LEAST + "[study_area]\nareas = 'north'\n", "study.toml:5: study_area.areas"),
        ("contingencies = 3\n", "contingencies"),
        ("= 1\n", "not TOML"),
    ],
)
def test_a_fault_is_named(tmp_path, text, said):
    assert said in faults(tmp_path, text).replace(str(tmp_path) + "/", "")


def test_a_faulty_value_of_several_types_is_one_fault_in_plain_words(tmp_path):
    told = faults(tmp_path, LEAST + "[outputs]\nmonitor = 'voltage nowhere'\n")
    assert "outputs.monitor: voltage: 'nowhere' names nothing" in told
    assert "tuple" not in told
    assert "function" not in told


def test_every_key_of_the_model_reaches_its_settings():
    keys = {
        "kind": "linear",
        "retain_buses": "42,50-51",
        "angle_deg": 30,
        "whole_deg": 4,
        "longest_above": 2,
        "order": 60,
        "slow_modes": 0.1,
        "weights": "states",
        "outputs": "states",
        "coupling": "lagged",
    }
    model = parse_study({"model": keys}).model
    assert model.settings(model.kind) == ModelSettings(
        ModelKind.LINEAR,
        RetainSettings(buses="42,50-51"),
        ReductionSettings(ReducerKind.BALANCED, None, 60, 0.1, Weights.STATES),
        Outputs.STATES,
        BoundaryCoupling.LAGGED,
        30.0,
        4.0,
        2.0,
    )
    others = {"kind": "adaptive", "retain": 3, "tolerance": 0.01, "outputs": "polar"}
    model = parse_study({"model": others}).model
    settings = model.settings(model.kind)
    assert settings.retain == RetainSettings(count=3)
    assert settings.reduction.tolerance == 0.01
    assert settings.ported


@pytest.mark.parametrize("kind", ["detailed", "paper", "paper-whole", "hybrid", "projected"])
def test_calibration_goes_with_the_models_of_the_paper(kind):
    assert parse_study({"model": {"kind": kind, "calibrate": True}}).model.calibrate


@pytest.mark.parametrize("kind", ["auto", "detailed", "linear", "retained", "adaptive", "whole"])
def test_outputs_through_ports_may_be_said_of_every_model_that_may_have_them(kind):
    model = parse_study({"model": {"kind": kind, "outputs": "polar"}}).model
    assert model.settings(ModelKind.DETAILED).outputs is Outputs.POLAR


def test_content_read_back_is_the_same_study(tmp_path):
    study = load_study(written(tmp_path, template()))
    assert parse_study(json.loads(json.dumps(study.content()))) == study


def test_the_schema_accepts_what_is_accepted_and_refuses_unknown_keys(tmp_path):
    validator = jsonschema.Draft202012Validator(json_schema())
    content = load_study(written(tmp_path, template())).content()
    validator.validate(content)
    assert not validator.is_valid(content | {"modle": {}})
    assert not validator.is_valid({"schema": 1, "run": {"t_end": 0}})


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CaseFileError, match=r"nothing\.toml"):
        load_study(tmp_path / "nothing.toml")


@pytest.mark.parametrize(
    "line",
    ["[" + " " * 5000, "[[" + " a" * 3000, "\t[" + "a." * 3000, " " * 9000 + "=", "[" * 5000],
)
def test_a_line_of_a_text_that_looks_like_a_table_takes_no_time(tmp_path, line):
    path = tmp_path / "study.toml"
    path.write_text(f'name = """x\n{line}"""\n[contingencies]\nbus_fault = "1"\n')
    began = time.monotonic()
    with pytest.raises(CaseFileError, match=r"study\.toml:4: unknown key"):
        load_study(path)
    assert time.monotonic() - began < 2.0


def test_lines_are_found_whatever_the_spelling_of_keys(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('[ "run" ]\n"t_end" = -1\n\n  [ model ] # a comment\n  kind = "x"\n')
    with pytest.raises(CaseFileError) as caught:
        load_study(path)
    assert "study.toml:2: run.t_end" in str(caught.value)
    assert "study.toml:5: model.kind" in str(caught.value)
