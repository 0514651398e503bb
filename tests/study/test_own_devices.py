"""Own code of studies: read, trusted, run from what was read, and part of a study's identity."""

from __future__ import annotations

import pickle
import sys
import textwrap
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from shutil import copytree

import pytest
from own_exciters import RAW, own_dyr, own_file

import gridfold as gf
from gridfold.dynamics.registry import DEVICES
from gridfold.io.study_store import StudyStore
from gridfold.numerics.code_files import package_digest, read_code
from gridfold.runs.own_code import run_code
from gridfold.runs.own_devices import devices_in, read_devices
from gridfold.study import engine
from gridfold.study.named_files import read_named
from gridfold.study.prepare import prepare
from gridfold.study.study_file import parse_study

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_exciter_study"
STUDY = {
    "case": {"source": "two-plants", "devices": ["my_exciter.py"]},
    "contingencies": {"csv": "faults.csv"},
    "contingency": [{"name": "one", "events": [{"kind": "bus-fault", "bus": 1, "duration": 0.05}]}],
    "run": {"t_end": 0.2},
    "outputs": {"curves": False},
}
#: What a study names, and a change of it that leaves its numbers as they are.
NAMED = {
    "my_exciter.py": "\n# another comment\n",
    "my_exciter.py imports helpers.law": "\n# another comment\n",
    "two-plants/case.toml": "\n# another comment\n",
    "two-plants/buses.csv": "\n# another comment\n",
    "two-plants/devices/my_exciter.csv": "\n# another comment\n",
    "faults.csv": "\n# another comment\n",
}
FILES = {"my_exciter.py imports helpers.law": "helpers/law.py"}


@pytest.fixture
def here(tmp_path):
    """The example with its exciter's law in a module beside it, and faults in a table."""
    folder = tmp_path / "study"
    copytree(EXAMPLE, folder)
    exciter = folder / "my_exciter.py"
    text = exciter.read_text()
    (folder / "helpers").mkdir()
    (folder / "helpers" / "__init__.py").touch()
    (folder / "helpers" / "law.py").write_text("from .ceiling import LIMIT\n")
    (folder / "helpers" / "ceiling.py").write_text("LIMIT = 1.0\n")
    exciter.write_text(
        text.replace("\nPARAMETERS", "\nfrom helpers.law import LIMIT\n\nPARAMETERS", 1)
    )
    (folder / "faults.csv").write_text("name,kind,bus,duration\ntwo,bus-fault,2,0.05\n")
    return folder


def run(here, out="results", **options):
    study = parse_study(STUDY)
    return gf.run_study(study, here / out, folder=here, count=1, trust_devices=True, **options)


def device(path, text):
    path.write_text(textwrap.dedent(text))
    return path


def test_nothing_is_run_before_it_is_trusted(tmp_path):
    evil = device(tmp_path / "evil.py", "open('RAN', 'w')\nimport more")
    device(tmp_path / "more.py", "open('RAN', 'w')")
    study = parse_study({"case": {"devices": ["evil.py"]}, "contingencies": {"bus_faults": "1"}})
    with pytest.raises(gf.OptionError) as raised:
        gf.run_study(study, tmp_path / "out", folder=tmp_path)
    code = read_code(evil)
    for file in code.files:
        assert f"{file.path}  sha256 {file.sha256}" in str(raised.value)
    assert len(code.files) == 2
    assert "--trust-devices" in str(raised.value)
    other = read_code(device(tmp_path / "other.py", ""))
    with pytest.raises(gf.OptionError, match=r"evil\.py"):
        gf.run_study(study, tmp_path / "out", folder=tmp_path, trust_devices={other.digest})
    assert sorted(p.name for p in tmp_path.iterdir()) == ["evil.py", "more.py", "other.py"]
    assert not Path("RAN").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"case": {"source": "gone", "devices": ["d.py"]}}, "gone"),
        ({"study_area": {"buses": "9999"}}, "no bus 9999"),
        ({"contingencies": {"bus_faults": "9999"}}, "9999"),
        ({"contingencies": {"csv": "gone.csv"}}, r"gone\.csv"),
    ],
)
def test_all_else_in_a_study_is_checked_before_its_code_runs(tmp_path, change, message):
    device(tmp_path / "d.py", f"open({str(tmp_path / 'RAN')!r}, 'w')")
    content = {"case": {"devices": ["d.py"]}, "contingencies": {"bus_faults": "1"}} | change
    with pytest.raises(gf.GridfoldError, match=message):
        gf.run_study(parse_study(content), tmp_path / "o", folder=tmp_path, trust_devices=True)
    assert not (tmp_path / "RAN").exists()


def test_every_file_of_devices_that_cannot_be_read_is_told(tmp_path):
    wrong = device(tmp_path / "wrong.py", "x = 1\nif:\n")
    nested = device(tmp_path / "nested.py", "import broken")
    device(tmp_path / "broken.py", "\n\nx = (")
    deep = device(tmp_path / "deep.py", f"x = {'-' * 200_000}1")
    null = device(tmp_path / "null.py", "x\0")
    native = device(tmp_path / "native.py", "import fast")
    suffix = next(s for s in __import__("_imp").extension_suffixes() if "abi3" not in s)
    (tmp_path / f"fast{suffix}").write_bytes(b"\x7fELF")
    with pytest.raises(gf.OptionError) as raised:
        read_devices([wrong, tmp_path / "gone.py", tmp_path, nested, deep, null, native])
    lines = str(raised.value).splitlines()
    for line, start in zip(
        lines,
        (f"{wrong}:2: SyntaxError", f"{tmp_path / 'gone.py'}: there is no", f"{tmp_path}: there is no",
         f"{tmp_path / 'broken.py'}:3: SyntaxError",
         f"{deep}:", f"{null}:", f"{native}: it imports {tmp_path / 'fast'}"),
        strict=True,
    ):  # fmt: skip
        assert line.startswith(start)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import sys\nsys.exit(0)", r":2: .*asks to end the program \(exit code 0\)"),
        ("import os\nos._exit(0)", r":2: .*asks to end the program \(exit code 0\)"),
        ("from posix import _exit\n_exit(0)", r":2: .*asks to end the program"),
        ("raise SystemExit", r":1: .*asks to end the program"),
        ("exit('so long')", r":1: .*asks to end the program"),
        ("import helper", r"helper\.py:2: .*asks to end the program"),
        ("class Out(BaseException):\n  pass\nraise Out('no')", ":3: Out: no"),
        ("\n\n1 / 0", ":3: ZeroDivisionError: division by zero"),
        ("import nowhere", ":1: ModuleNotFoundError: No module named 'nowhere'"),
        ("import helper2.gone", ":1: ModuleNotFoundError: No module named 'helper2.gone'"),
        ("x = 1", "defines no device model"),
        ("from gridfold.dynamics.exciters.sexs import *", "defines no device model"),
        (
            "__import__('importlib').import_module('unseen_by_anyone')",
            "otherwise than by an import",
        ),
    ],
)
def test_code_that_does_not_give_devices_is_an_error_with_file_and_line(
    tmp_path, monkeypatch, text, message
):
    monkeypatch.syspath_prepend(str(tmp_path))
    device(tmp_path / "helper.py", "import sys\nsys.exit(3)")
    device(tmp_path / "helper2.py", "")
    device(tmp_path / "unseen_by_anyone.py", "")
    before = set(sys.modules)
    with pytest.raises(gf.OptionError, match=message):
        devices_in(read_devices([device(tmp_path / "mine.py", text)]))
    sys.modules.pop("unseen_by_anyone", None)
    left = {name for name in set(sys.modules) - before if name.startswith("gridfold_own")}
    assert {name.partition(".")[2] for name in left} <= {"mine"}, "only what ran to its end"
    assert not left or "defines no" in message


@pytest.mark.parametrize(
    ("call", "told"),
    [
        ("exit(0)", "asks to end the program"),
        ("(_ for _ in ()).throw(__import__('typer').Exit(0))", "Exit"),
        ("1 / 0", "ZeroDivisionError"),
    ],
)
def test_what_a_function_of_a_device_raises_is_an_error_with_file_and_line(here, call, told):
    exciter = here / "my_exciter.py"
    text = exciter.read_text()
    exciter.write_text(text.replace("    role=", f"    check=lambda p: {call},\n    role="))
    line = exciter.read_text().splitlines().index(f"    check=lambda p: {call},") + 1
    with pytest.raises(gf.DeviceError, match=rf"my_exciter\.py:{line}: .*{told}"):
        run(here)


def test_code_runs_from_what_was_read_and_not_from_the_disk(here):
    named = read_named(parse_study(STUDY), here)
    for file in ("my_exciter.py", "helpers/law.py", "helpers/ceiling.py"):
        (here / file).write_text("raise RuntimeError('from the disk')")
    own = devices_in(pickle.loads(pickle.dumps(named)).own_code)
    assert set(own) - set(DEVICES) == {"my_exciter"}
    assert run_code(named.own_code[0]).LIMIT == 1.0


def test_two_states_of_a_file_do_not_mix(here):
    first = read_named(parse_study(STUDY), here).own_code
    (here / "helpers" / "ceiling.py").write_text("LIMIT = 2.0\n")
    second = read_named(parse_study(STUDY), here).own_code
    assert [run_code(code).LIMIT for code in (*first, *second, *first)] == [1.0, 2.0, 1.0]
    assert "helpers" not in sys.modules


def test_all_kinds_of_import_statements_find_the_files_that_were_read(tmp_path):
    for name, text in {
        "pack/__init__.py": "from .a import A\nfrom . import b",
        "pack/a.py": "import pack.b as other\nA = other.B + 1",
        "pack/b.py": "B = 1",
        "pack/deep/__init__.py": "",
        "pack/deep/c.py": "from ..b import B\nfrom ... import pack"
        if False
        else "from ..b import B",
        "space/d.py": "D = 4",
        "late.py": "L = 5",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    code = read_code(
        device(
            tmp_path / "main.py",
            """
            import math, numpy as np
            import pack.deep.c
            import space.d
            from pack import A, b as there
            from pack.deep.c import *
            def later():
                from late import L
                return L
            """,
        )
    )
    assert [file.module for file in code.files] == [
        "main", "late", "pack", "pack.a", "pack.b", "pack.deep", "pack.deep.c", "space.d",
    ]  # fmt: skip
    assert [name for name, _ in code.versions] == ["numpy"]
    for file in tmp_path.rglob("*.py"):
        file.unlink()
    module = run_code(code)
    assert (module.A, module.there.B, module.B, module.space.d.D, module.later()) == (2, 1, 1, 4, 5)
    assert module.pack.deep.c.B == 1


@pytest.mark.parametrize("name", NAMED)
def test_a_study_goes_on_only_with_the_files_that_it_began_with(here, name):
    outcome = run(here)
    assert (outcome.total, outcome.failed) == (2, 0)
    file = here / FILES.get(name, name)
    before = file.read_text()
    file.write_text(before + NAMED[name])
    with pytest.raises(gf.OptionError) as raised:
        run(here, resume=True)
    assert f"  {name}: was sha256 " in str(raised.value)
    assert str(raised.value).count("was sha256") == 1
    file.write_text(before)
    assert run(here, resume=True).complete


def test_a_study_goes_on_only_with_the_same_sources_of_gridfold(here, monkeypatch):
    run(here)
    monkeypatch.setattr("gridfold.study.identity.SOURCES", "0" * 64)
    with pytest.raises(gf.OptionError, match="gridfold itself: was sha256"):
        run(here, resume=True)


def test_results_tell_which_files_they_were_made_from(here):
    run(here)
    with StudyStore.read(here / "results") as store:
        about = store.identity
    named = read_named(parse_study(STUDY), here)
    assert about["files"] == named.hashes
    assert set(NAMED) < set(about["files"])
    assert about["sources"] == package_digest()
    (own,) = about["own_code"]
    assert own["digest"] == named.own_code[0].digest
    assert set(own["files"]) == {"my_exciter", "helpers", "helpers.law", "helpers.ceiling"}


def test_a_run_tells_the_code_of_devices_that_are_not_the_packages(here):
    study = parse_study(STUDY)
    found = []
    for limit in ("1.0", "1.0", "2.0"):
        (here / "helpers" / "ceiling.py").write_text(f"LIMIT = {limit}\n")
        (here / "my_exciter.py").touch()
        text = (here / "my_exciter.py").read_text()
        if "LIMIT *" not in text:
            (here / "my_exciter.py").write_text(
                text.replace("= p[P.integral", "= LIMIT * p[P.integral")
            )
        named = read_named(study, here)
        model = prepare(engine.do_offline_work(study, named)[0]).model
        run = gf.simulate(model, [gf.BusFault(1, duration=0.05)], 0.1)
        found.append(run.metadata())
    devices = [about["own_devices"]["my_exciter"] for about in found]
    assert devices[0] != devices[2], "a constant that its law takes from another file"
    assert devices[0] == devices[1]
    assert {about["sources"] for about in found} == {package_digest()}
    assert list(found[0]["own_devices"]) == ["my_exciter"]


def test_a_case_that_extends_another_counts_with_all_its_files(here):
    (here / "more").mkdir()
    (here / "more" / "case.toml").write_text('extends = "../two-plants"\n')
    study = parse_study(STUDY | {"case": {"source": "more"}})
    names = set(read_named(study, here).hashes)
    assert {"more/case.toml", "more/../two-plants/buses.csv"} < names


def test_workers_have_the_code_from_the_run_that_sends_it(here, monkeypatch):
    """Whatever has become of the files by the time a worker begins."""
    sent = []

    class Sending(ThreadPoolExecutor):
        def submit(self, function, offline, batch):
            (here / "my_exciter.py").write_text("raise RuntimeError('from the disk')")
            sent.append(pickle.loads(pickle.dumps(offline)))
            return super().submit(function, sent[-1], batch)

    with Sending(1) as executor:
        assert run(here, executor=executor).failed == 0
    assert sent
    monkeypatch.setattr("gridfold.study.prepare.SOURCES", "0" * 64)
    with pytest.raises(gf.OptionError, match="other sources of gridfold"):
        prepare(sent[0])


def test_studies_with_other_code_have_other_tokens(here):
    study = parse_study(STUDY)
    first, _ = engine.do_offline_work(study, read_named(study, here))
    (here / "helpers" / "ceiling.py").write_text("LIMIT = 2.0\n")
    second, _ = engine.do_offline_work(study, read_named(study, here))
    assert first.token != second.token


@pytest.fixture
def dyr_study(tmp_path):
    """A study of PSS/E files with records of an exciter that a file gives, which tells when it runs."""
    run = f"open({str(tmp_path / 'RAN')!r}, 'w').close()\nfrom numba"
    own_file(tmp_path, ("from numba", run))
    own_dyr(tmp_path)
    (tmp_path / "grid.raw").write_bytes(RAW.read_bytes())
    case = {"source": "grid.raw", "dyr": "own.dyr", "devices": ["mine.py"]}
    fault = {"kind": "bus-fault", "bus": 13, "duration": 0.05}
    return STUDY | {
        "case": case,
        "contingencies": {"machine_trips": "12,22"},
        "contingency": [{"name": "one", "events": [fault]}],
    }


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"study_area": {"buses": "9999"}}, "no bus 9999"),
        ({"contingencies": {"csv": "gone.csv"}}, r"gone\.csv"),
    ],
)
def test_all_else_is_checked_before_code_for_records_runs(tmp_path, dyr_study, change, message):
    study = parse_study(dyr_study | change)
    with pytest.raises(gf.GridfoldError, match=message):
        gf.run_study(study, tmp_path / "o", folder=tmp_path, trust_devices=True)
    assert not (tmp_path / "RAN").exists()


def test_workers_know_the_models_of_records(tmp_path, dyr_study):
    named = read_named(parse_study(dyr_study), tmp_path)
    offline, contingencies = engine.do_offline_work(parse_study(dyr_study), named)
    for file in ("mine.py", "own.dyr", "grid.raw"):
        (tmp_path / file).unlink()
    model = prepare(pickle.loads(pickle.dumps(offline))).model
    assert model.own_devices.keys() == {"mine"}
    assert {item.name for item in contingencies} == {"one", "machine 12:1", "machine 22:1"}


def test_files_that_a_call_names_are_trusted_and_part_of_the_study(tmp_path, dyr_study):
    del dyr_study["case"]["devices"]
    study = parse_study(dyr_study)
    with pytest.raises(gf.CaseError, match="MYAVR"):
        gf.run_study(study, tmp_path / "o", folder=tmp_path)
    mine = [tmp_path / "mine.py"]
    outcome = gf.run_study(study, tmp_path / "o", folder=tmp_path, devices=mine, count=1)
    assert (outcome.total, outcome.failed) == (3, 0)
    with StudyStore.read(tmp_path / "o") as store:
        assert store.identity["study"]["case"]["devices"] == ["mine.py"]
        assert "mine.py" in store.identity["files"]
        told = store.identity["settings"]["case_notices"]
    assert f"device mine ({mine[0]}) is a model of your own: 2 units" in told
