"""What is fed with spoilt input: each reader, with sound files to start from, and the command."""

from __future__ import annotations

import io
import os
import shlex
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

import numpy as np
from bad_input_samples import SMALL_CASE, write_small_case
from fuzz.mutate import NUMBERS, WORDS, mutated
from scipy.io import savemat
from study_stores import new_store

import gridfold as gf
from gridfold.cli.app import app, main
from gridfold.grid.timeline import build_timeline
from gridfold.io.dyr import read_dyr
from gridfold.io.unit_sources import read_unit_sources
from gridfold.report.result_tables import result_tables
from gridfold.report.study_report import write_report
from gridfold.report.study_tables import study_facts
from gridfold.study.generate import from_table, list_contingencies
from gridfold.study.study_file import load_study, template

TESTS = Path(__file__).parents[1]
_RAW = TESTS / "io" / "raw"
_DYR = TESTS / "io" / "dyr"
_ANY_DYNAMICS = {"unsupported": "drop", "without_data": "negative_load"}


@dataclass(frozen=True)
class Target:
    """A reader: sound files by name, what reads the file of that name, and whether it is text."""

    name: str
    seeds: Callable[[], Sequence[tuple[str, bytes]]]
    read: Callable[[Path], object]
    text: bool = True
    #: Files that lie beside the spoilt one.
    beside: Callable[[], dict[str, bytes]] = dict

    def make(self, seed: int, number: int) -> tuple[str, bytes]:
        """Name and content of the spoilt file with this number; the same each time."""
        chance = Random(f"{self.name} {seed} {number}")
        name, content = chance.choice(self.seeds())
        return name, mutated(content, chance, self.text)

    def warm_up(self, seed: int) -> None:
        """Compile what sound files need: that takes longer than an input may."""
        self.make(seed, 0)
        for name, content in self.seeds():
            with suppress(gf.GridfoldError):
                self.feed(name, content)

    def feed(self, name: str, content: bytes) -> None:
        """Read the file; raises what the reader raises."""
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            for other, sound in {**self.beside(), name: content}.items():
                path = folder / other
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(sound)
            self.read(folder / name)


def _files(*patterns: Path) -> Callable[[], Sequence[tuple[str, bytes]]]:
    @cache
    def read() -> Sequence[tuple[str, bytes]]:
        found = [path for each in patterns for path in sorted(each.parent.glob(each.name))]
        return tuple((path.name, path.read_bytes()) for path in found)

    return read


@cache
def _npcc() -> gf.DetailedModel:
    return gf.build_model(gf.load_case("npcc"))


def _read_raw(path: Path) -> None:
    case = gf.load_case(path, allow_unsupported_network=True)
    with suppress(gf.PowerFlowError):
        gf.solve_power_flow(case)
    gf.solve_power_flow(gf.load_case(path, allow_unsupported_network=True, solve="limits"))


def _read_dyr(path: Path) -> None:
    read_dyr(path)
    case = gf.load_case(path.with_name("grid.raw"), path, **_ANY_DYNAMICS)
    gf.build_model(case, on_limit=gf.OnLimit.ADJUST)


@cache
def _mat() -> Sequence[tuple[str, bytes]]:
    bus = [[1, 3, 0, 0, 0, 0, 1, 1, 0, 20, 1], [2, 1, 50, 10, 0, 5, 1, 1, 0, 20, 1]]
    machine = [1, 1.8, 0.3, 0.3, 8, 0.03, 1.7, 0.3, 0.3, 0.4, 0.05, 6, 0, 0, 0.2, 0, 50, 130]
    content = {
        "mpc": {
            "baseMVA": 100.0,
            "bus": np.array(bus, float),
            "gen": np.array([[1, 50, 0, 99, -99, 1, 100, 1]], float),
            "branch": np.array([[1, 2, 0.01, 0.1, 0, 0, 0, 0, 0, 0, 1]], float),
        },
        "GenData": np.array([machine], float),
        "ExcData": np.array([[20, 0.2, 1, 0.314, 0.063, 0.35, 0.0039, 1.555]], float),
        "TurbData": np.array([[0.5, 0.05, 0.2]], float),
    }
    files = []
    for compressed in (False, True):
        stream = io.BytesIO()
        savemat(stream, content, do_compression=compressed)
        files.append(("grid.mat", stream.getvalue()))
    return files


def _read_folder(path: Path) -> None:
    folder = path.parent.parent if path.parent.name == "devices" else path.parent
    gf.simulate(gf.build_model(gf.load_case(folder)), [gf.BusFault(3)], 0.3)


class _Folder(Target):
    def warm_up(self, seed: int) -> None:
        """Compile the implicit rule besides, which stiff data need."""
        super().warm_up(seed)
        with tempfile.TemporaryDirectory() as scratch:
            model = gf.build_model(gf.load_case(write_small_case(Path(scratch))))
            gf.simulate(model, [gf.BusFault(3)], 0.3, gf.ImplicitTrapezoidal())


_EVENTS = """[[event]]
kind = "bus-fault"
bus = 3
start = 0.1
duration = 0.05
[[event]]
kind = "branch-fault"
branch = "3-2"
fraction = 0.5
start = 1.0
[[event]]
kind = "machine-trip"
bus = 23
id = "2"
time = 2.0
[[event]]
kind = "load-step"
bus = 5
time = 3.0
active_mw = 10.0
"""


def _read_events(path: Path) -> None:
    build_timeline(_npcc().case, gf.load_events(path), 16.0)


_RELAYS = """[[relays]]
kind = "under-frequency-shedding"
areas = "1"
measured_at = 3
stages = [{ pickup = 59.3, delay = 0.1, share = 0.05 }, { pickup = 59.0, delay = 0.1, share = 0.1 }]
[[relays]]
kind = "distance"
branch = "3-2"
bus = 3
[[relays]]
kind = "generator-frequency-trip"
bus = 23
id = "2"
delay = 0.5
above = 61.5
"""


def _read_relays(path: Path) -> None:
    build_timeline(_npcc().case, gf.load_relays(path), 16.0)


_UNITS = "bus,id,source\n23,2,gas\n24,1,hydro\n"


def _read_units(path: Path) -> None:
    read_unit_sources(path, _npcc().case)


_STUDY = """schema = 1
name = "short"
[contingencies]
bus_faults = "1-4,26"
line_faults = "area 1"
machine_trips = "zone 1"
csv = "list.csv"
[[contingency]]
name = "two"
events = [{kind = "bus-fault", bus = 3}, {kind = "branch-trip", branch = "3-2", time = 0.2}]
[model]
kind = "linear"
retain = 2
[study_area]
buses = "1-36"
[run]
t_end = 1.0
"""
_TABLE = "name,kind,bus,duration,branch,time\na,bus-fault,3,0.1,,\nb,branch-trip,,,3-2,0.2\n"


def _read_study(path: Path) -> None:
    study = load_study(path)
    list_contingencies(study, _npcc().case, frozenset(range(1, 37)), path.parent)


def _read_table(path: Path) -> None:
    list(from_table(path))


@cache
def _store() -> Sequence[tuple[str, bytes]]:
    with tempfile.TemporaryDirectory() as scratch:
        new_store(Path(scratch)).close()
        return (("study.sqlite", (Path(scratch) / "study.sqlite").read_bytes()),)


def _read_store(path: Path) -> None:
    with gf.StudyStore.read(path.parent) as store:
        study_facts(store)
        result_tables(store.frame(), 10, 80)
        write_report(store, path.with_name("report.html"))


@cache
def _reduced() -> Sequence[tuple[str, bytes]]:
    parts = gf.partition(_npcc(), range(1, 37))
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "reduced.npz"
        gf.save_reduced(path, gf.reduce(parts), 1.0)
        return ((path.name, path.read_bytes()),)


def _read_reduced(path: Path) -> None:
    gf.load_reduced(path, _npcc())


def _tampered(content: bytes, chance: Random) -> bytes:
    """A file of arrays of which one is another one; in a third of cases its bytes are spoilt."""
    if chance.random() < 0.33:
        return mutated(content, chance, text=False)
    with np.load(io.BytesIO(content)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = chance.choice(sorted(arrays))
    array = arrays[name]
    kind = chance.randrange(8)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        kinds = ("f4", "i2", "U9", "c16", "?", "f8", "i8", "f2", "S3", "M8[s]")
        arrays[name] = np.zeros(array.shape, chance.choice(kinds))
    elif kind == 2:
        arrays[name] = array[..., None] if chance.random() < 0.5 else array.ravel()[:-1]
    elif kind == 3 and array.dtype.kind in "if" and array.size:
        hostile = (-1, 10**9, -(2**62)) if array.dtype.kind == "i" else (np.nan, np.inf, -1e300)
        array.flat[chance.randrange(array.size)] = chance.choice(hostile)
    elif kind == 4:
        arrays[name] = np.zeros((0,) * array.ndim, array.dtype)
    elif kind == 5:
        arrays[name] = np.concatenate([array.ravel()] * 3)
    elif array.dtype.kind == "U":
        text = mutated(str(array).encode(), chance).decode("utf-8", "replace")
        arrays[name] = np.array(text)
    else:
        arrays[name + "x"] = array
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


class _Reduced(Target):
    def make(self, seed: int, number: int) -> tuple[str, bytes]:
        chance = Random(f"{self.name} {seed} {number}")
        name, content = chance.choice(self.seeds())
        return name, _tampered(content, chance)


#: Commands that are short on a small case; `demo` and `reproduce` take no input.
_COMMANDS = ("simulate", "info", "eigenvalues", "cct", "partition", "reduce", "calibrate", "init",
             "run", "show", "report")  # fmt: skip
_VALUES = (*NUMBERS, *WORDS, "1-99999999", "3", "1", "0.1", "auto", "linear", "detailed", "rk4",
           "bus-fault bus=3", "/dev/zero", "/dev/null", "no/such/file", ".", "npcc", "case",
           "pipe.toml", "pipe.raw", "short.toml", "a.csv", "a.png")  # fmt: skip


_SOUND = ("3", "1", "0.1", "0.01", "1-2", "auto", "linear", "adaptive", "detailed", "rk4", "abm4", "z",
          "bus-fault bus=3", "case", "short.toml", "a.csv", "a.png", "a.npz")  # fmt: skip


class _CommandLine(Target):
    def make(self, seed: int, number: int) -> tuple[str, bytes]:
        """A command line: one of the commands with options and values of all kinds."""
        chance = Random(f"{self.name} {seed} {number}")
        command = chance.choice(_COMMANDS)
        known = [each for each in _parameters(command) if each.startswith("-")]
        words = [command]
        usual = {"init": "new.toml", "run": "short.toml", "show": "short.results", "report": "."}
        words.append(
            usual.get(command, "case") if chance.random() < 0.8 else chance.choice(_VALUES)
        )
        if "--t-end" in known:
            words += ["--t-end", "0.2"]
        for _ in range(chance.choice((0, 1, 1, 1, 2, 3))):
            option = chance.choice(known)
            value = chance.choice(_VALUES if chance.random() < 0.5 else _SOUND)
            words += [option] if chance.random() < 0.15 else [option, value]
        return "line.txt", self._line(words)

    def warm_up(self, seed: int) -> None:
        """Compile what a run on a small case needs."""
        self.feed("line.txt", b"simulate case --t-end 0.2 --fault-bus 3")

    @staticmethod
    def _line(words: Sequence[str]) -> bytes:
        safe = [word.replace("\x00", "").encode("utf-8", "replace").decode() for word in words]
        return shlex.join(safe).encode()

    def feed(self, name: str, content: bytes) -> None:
        """Run the command in a folder of its own; bad input ends it in an exit code."""
        before, arguments, screen = Path.cwd(), sys.argv, io.StringIO()
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            write_small_case(folder / "case")
            (folder / "short.toml").write_text('[case]\nsource = "case/"\n' + _STUDY)
            for pipe in ("pipe.toml", "pipe.raw"):
                os.mkfifo(folder / pipe)
            os.chdir(folder)
            sys.argv = ["gridfold", *shlex.split(content.decode())]
            try:
                with redirect_stdout(screen), redirect_stderr(screen):
                    main()
            except SystemExit as end:
                if end.code == 2:
                    raise gf.OptionError(screen.getvalue()[-200:]) from None
            finally:
                os.chdir(before)
                sys.argv = arguments


@cache
def _parameters(command: str) -> tuple[str, ...]:
    """Options of a command."""
    import typer.main

    group = typer.main.get_command(app)
    context = group.make_context("gridfold", [], resilient_parsing=True)
    found = group.get_command(context, command).params  # type: ignore[attr-defined]
    return tuple(name for parameter in found for name in parameter.opts)


def _first_raw() -> dict[str, bytes]:
    return {"grid.raw": (_RAW / "machines.raw").read_bytes()}


def _small_case() -> dict[str, bytes]:
    return {name: text.encode() for name, text in SMALL_CASE.items()}


TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        Target("raw", _files(_RAW / "*.raw"), _read_raw),
        Target("dyr", _files(_DYR / "*.dyr"), _read_dyr, beside=_first_raw),
        Target("matpower", _files(_RAW / "*.m"), _read_raw),
        Target("mat", _mat, gf.load_case, text=False),
        _Folder("folder", lambda: tuple(_small_case().items()), _read_folder, beside=_small_case),
        Target(
            "events",
            lambda: (("events.toml", _EVENTS.encode()),),
            _read_events,
        ),
        Target(
            "study",
            lambda: (("study.toml", _STUDY.encode()), ("study.toml", template().encode())),
            _read_study,
            beside=lambda: {"list.csv": _TABLE.encode()},
        ),
        Target("relays", lambda: (("relays.toml", _RELAYS.encode()),), _read_relays),
        Target("units", lambda: (("units.csv", _UNITS.encode()),), _read_units),
        Target("table", lambda: (("list.csv", _TABLE.encode()),), _read_table),
        Target("store", _store, _read_store, text=False),
        _Reduced("reduced", _reduced, _read_reduced, text=False),
        _CommandLine("command", lambda: (), lambda path: None),
    )
}
