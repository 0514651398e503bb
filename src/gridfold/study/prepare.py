"""The work that is done once for a study, and what each worker makes of it."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.dynamics.device import Device
from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.network import LoadModel
from gridfold.dynamics.plausible import naming_doubts
from gridfold.dynamics.psse_records import Unsupported, WithoutData
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.settings import settled
from gridfold.editing.edit_files import edits_of, load_edits
from gridfold.equivalents.auto import Work, choose_model
from gridfold.equivalents.calibrate import ThresholdKind, calibrate
from gridfold.equivalents.choice import Family, ModelSettings
from gridfold.equivalents.families import Mode, ReducedExternal, WholeSystem
from gridfold.equivalents.fit import Fit
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import ANGLES_DEG, STUDY_AREAS, ModelKind
from gridfold.equivalents.moved_modes import compared_modes
from gridfold.equivalents.saved import load_reduced, save_reduced
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.equivalents.tolerant import TolerantModel
from gridfold.errors import EventError, OptionError, StepWarning, warn_caller
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.criteria import Criterion
from gridfold.grid.criterion_checks import check_criteria
from gridfold.grid.events import BusFault
from gridfold.grid.relays import Relay
from gridfold.grid.selection_text import as_ranges
from gridfold.grid.timeline import build_timeline, initial_state
from gridfold.io.criterion_records import criteria_of
from gridfold.io.event_places import numbering
from gridfold.io.event_records import relays_of
from gridfold.numerics.kernel_cache import SOURCES
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition, chosen_study_buses, partition, study_buses
from gridfold.powerflow import PowerFlowResult, solve_power_flow
from gridfold.runs.basis import basis_of
from gridfold.runs.loading import faults_later, load_case
from gridfold.runs.longer_step import choose_for_many
from gridfold.runs.method import Choice, choose_stepper
from gridfold.runs.monitor import Columns, monitored
from gridfold.runs.own_devices import devices_in
from gridfold.runs.simulate import ModelStore
from gridfold.runs.size import check_states
from gridfold.runs.strict import refuse_doubtful_start
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.unstable_start import with_start_checked
from gridfold.study.generate import Contingency, list_contingencies
from gridfold.study.named_files import NamedFiles, case_source
from gridfold.study.study_file import Study

#: Models that do without a study area.
_WITHOUT_AREA = (ModelKind.DETAILED, ModelKind.AUTO)
#: Topologies of which small models are kept: those that contingencies at hand may share.
_TOPOLOGIES = 8


@dataclass(frozen=True)
class Offline:
    """All that a worker needs, as plain data that can be sent to other processes and machines.

    Parameters
    ----------
    study : Study
        The study file.
    case : Case
        The grid.
    power_flow : PowerFlowResult
        Its operating point.
    study_buses : frozenset of int
        The study area; empty where the detailed model needs none.
    method : Choice
        Integration rule and step of all runs.
    settings : ModelSettings
        The model that is simulated, with thresholds as given or calibrated.
    reason : str or None
        Why it was chosen, where the study leaves that open.
    reduced : bytes, optional
        The reduced external area, as in a file of :func:`gridfold.save_reduced`.
    named : NamedFiles
        The files that the study names: code of further device models as it was read, and digests.
    sources : str
        SHA-256 of the sources of gridfold.
    time_limit : float, optional
        Longest time for one contingency in seconds.
    on_gpu, gpu_only : bool
        Whether contingencies run on a GPU, and whether they end where that fails.
    """

    study: Study
    case: Case
    power_flow: PowerFlowResult
    study_buses: frozenset[int]
    method: Choice
    settings: ModelSettings
    reason: str | None
    reduced: bytes | None
    named: NamedFiles
    sources: str = SOURCES
    time_limit: float | None = None
    on_gpu: bool = False
    gpu_only: bool = False

    @cached_property
    def token(self) -> str:
        """What tells one study from another."""
        digest = hashlib.sha256(self.case.fingerprint.encode())
        digest.update(self.study.model_dump_json().encode())
        chosen = (
            self.settings,
            self.method,
            sorted(self.study_buses),
            self.time_limit,
            self.on_gpu,
            self.gpu_only,
        )
        digest.update(repr(chosen).encode())
        digest.update(self.reduced or b"")
        digest.update(repr([code.digest for code in self.named.own_code]).encode())
        return digest.hexdigest()

    @property
    def devices(self) -> Mapping[str, Device]:
        """All device models of the study."""
        return devices_in(self.named.own_code)


@dataclass(frozen=True)
class Prepared:
    """A study that is ready to simulate contingencies; shared by the threads of one process."""

    study: Study
    model: DetailedModel
    method: Choice
    criterion: SynchronismCriterion
    parts: Partition | None
    small: SmallModels | None
    rule: SwitchingRule
    intact: ModelStore
    time_limit: float | None = None
    tolerant: TolerantModel | None = None
    relays: tuple[Relay, ...] = ()
    columns: Columns | None = None
    criteria: tuple[Criterion, ...] = ()
    on_gpu: bool = False
    gpu_only: bool = False

    @property
    def study_machines(self) -> tuple[UnitKey, ...]:
        """Machines whose angles are looked at: those of the study area, else all."""
        return self.model.machines if self.parts is None else self.parts.study_units


def do_offline_work(
    study: Study,
    named: NamedFiles,
    workers: int | None = None,
    earlier: Mapping[str, Any] | None = None,
) -> tuple[Offline, tuple[Contingency, ...]]:
    """Case, power flow, thresholds and reduction of a study, and its contingencies.

    `named` is what the study names; all else is checked before code in it is run. `workers` threads
    calibrate. A study that goes on takes the model of its `earlier` settings, :func:`describe`.

    Raises
    ------
    GridfoldError
        Something in the study does not fit.
    """
    early, folder = None, named.folder
    is_edited = bool(study.edits or study.case.edits)
    if named.own_code and (study.case.dyr is not None or is_edited):
        # events and edits may name devices that the code brings, and buses that edits add
        with suppress(EventError, *((OptionError,) if is_edited else ())):
            _surveyed(_without_records(study), folder, DEVICES)
    else:
        early = _surveyed(study, folder, DEVICES)
    devices = devices_in(named.own_code)
    case, buses, contingencies, power_flow = early or _surveyed(study, folder, devices)
    model = _build(study, case, power_flow, devices)
    if study.case.strict:
        refuse_doubtful_start(case, basis_of(with_start_checked(model)))
    _check_settings(study, model, contingencies)
    _watched(study, model, buses)
    check_criteria(criteria_of(study.criteria), case, buses or None)
    parts = partition(model, buses) if buses else None
    method = _method(study, model, contingencies, earlier)
    for doubt in method.doubts:
        warn_caller(doubt, StepWarning)
    settings, reason, family = _chosen(
        study, model, parts, method.stepper, contingencies, workers, earlier
    )
    reduced = None
    if isinstance(family, Ladder | ReducedExternal):
        reduced = _saved(family, settings.norm)
    offline = Offline(study, case, power_flow, buses, method, settings, reason, reduced, named)
    return offline, contingencies


def _surveyed(
    study: Study, folder: Path, devices: Mapping[str, Device]
) -> tuple[Case, frozenset[int], tuple[Contingency, ...], PowerFlowResult]:
    """Case, study area, contingencies and operating point."""
    with faults_later(lambda: _start(study, folder, devices)):
        case = load_grid(study, folder, devices)
    buses = _study_buses(study, case)
    contingencies = list_contingencies(study, case, buses, folder)
    for relay in relays_of(study.relays, number=numbering(case)):
        relay.changes(case)
    with naming_doubts(case, devices):
        return case, buses, contingencies, solve_power_flow(case)


def _start(study: Study, folder: Path, devices: Mapping[str, Device]) -> None:
    """Start the case with all options by which a file with faults may be loaded."""
    answered: dict[str, object] = {"allow_unsupported_network": True}
    if study.case.unsupported is Unsupported.ERROR:
        answered["unsupported"] = Unsupported.CLASSICAL
    if study.case.without_data is WithoutData.ERROR:
        answered["without_data"] = WithoutData.NEGATIVE_LOAD
    grid = study.model_copy(update={"case": study.case.model_copy(update=answered)})
    case = load_grid(grid, folder, devices)
    _build(grid, case, solve_power_flow(case), devices)


def _without_records(study: Study) -> Study:
    """The study as far as it can be checked without the models of its own code."""
    lenient = {
        "unsupported": Unsupported.DROP,
        "without_data": WithoutData.NEGATIVE_LOAD,
        "edits": None,
    }
    return study.model_copy(update={"case": study.case.model_copy(update=lenient), "edits": ()})


def load_grid(study: Study, folder: Path, devices: Mapping[str, Device] = DEVICES) -> Case:
    """The case of a study, with the device models `devices`."""
    wanted = study.case
    dyr = None if wanted.dyr is None else folder / wanted.dyr
    edits = [] if wanted.edits is None else load_edits(folder / wanted.edits)
    return load_case(
        case_source(wanted.source, folder),
        dyr,
        unsupported=wanted.unsupported,
        without_data=wanted.without_data,
        unit_sources=None if wanted.unit_sources is None else folder / wanted.unit_sources,
        allow_unsupported_network=wanted.allow_unsupported_network,
        raw_revision=wanted.raw_revision,
        solve=wanted.solve,
        edits=[*edits, *edits_of(study.edits)],
        devices=devices,
    )


def _check_settings(
    study: Study, model: DetailedModel, contingencies: tuple[Contingency, ...]
) -> None:
    """Raise an EventError where a contingency sets something that no device has."""
    for item in contingencies:
        for stage in build_timeline(model.case, item.events, study.run.t_end):
            try:
                settled(model.layout, stage.state.settings, model.power_flow)
            except EventError as error:
                raise EventError(f"contingency {item.name!r}: {error}") from None


def prepare(offline: Offline) -> Prepared:
    """What simulates the contingencies of a study.

    The same `offline` gives the same to the last digit, in every process.
    """
    if offline.sources != SOURCES:
        raise OptionError(
            "the worker has other sources of gridfold than the run that it works for: "
            f"{SOURCES[:16]}, there {offline.sources[:16]}; install the same on all machines"
        )
    study = offline.study
    model = _build(study, offline.case, offline.power_flow, offline.devices)
    check_states(model, study.run.t_end, offline.method.stepper.step)
    criterion = study.run.criterion
    intact = {initial_state(model.case): model}
    parts, family = _family(offline, model)
    small = tolerant = None
    if family is not None:
        tolerance = offline.settings.tolerance_deg
        if tolerance is not None and isinstance(family, Ladder):
            tolerant = TolerantModel(family, tolerance, _TOPOLOGIES)
        small = SmallModels(family, _TOPOLOGIES) if tolerant is None else tolerant.small
        for mode in set(family.modes) - {Mode.DETAILED}:
            small.get(model, mode)
            small.limits(model, mode)
    rule = offline.settings.rule
    method, limit = offline.method, offline.time_limit
    relays = tuple(relays_of(study.relays, number=numbering(model.case)))
    columns = _watched(study, model, offline.study_buses)
    return Prepared(
        study,
        model,
        method,
        criterion,
        parts,
        small,
        rule,
        intact,
        limit,
        tolerant,
        relays,
        columns,
        criteria_of(study.criteria),
        offline.on_gpu,
        offline.gpu_only,
    )


def _watched(study: Study, model: DetailedModel, buses: frozenset[int]) -> Columns:
    """Columns of what the study watches."""
    return monitored(model, study.outputs.watched, buses or None, "outputs.monitor")


def _study_buses(study: Study, case: Case) -> frozenset[int]:
    area = study.study_area
    asked = chosen_study_buses(case, "study_area.", area.buses, area.areas, area.zones)
    if asked is not None:
        return asked
    if study.case.source in STUDY_AREAS:
        return study_buses(case, areas=STUDY_AREAS[study.case.source])
    lists = study.contingencies
    places = (lists.bus_faults, lists.line_faults, lists.machine_trips)
    named = any("study area" in " ".join(place.lower().split()) for place in places)
    if study.model.kind in _WITHOUT_AREA and not named:
        return frozenset()
    raise OptionError(f"case {case.name} has no study area of its own; give it in [study_area]")


def _build(
    study: Study, case: Case, power_flow: PowerFlowResult, devices: Mapping[str, Device]
) -> DetailedModel:
    loads = LoadModel.parse(study.case.loads)
    return build_model(case, power_flow, devices=devices, on_limit=study.case.on_limit, loads=loads)


def _method(
    study: Study,
    model: DetailedModel,
    contingencies: tuple[Contingency, ...],
    earlier: Mapping[str, Any] | None,
) -> Choice:
    """The integration rule of all runs; that of the earlier ones if the study goes on."""
    run = study.run
    if earlier is not None:
        chosen = choose_stepper(model, earlier["method"], earlier["step"])
        return replace(chosen, reason=earlier["method_reason"])
    disturbances = [item.events for item in contingencies]
    return choose_for_many(
        model, disturbances, run.method, run.step, t_end=run.t_end, criterion=run.criterion
    )


def _chosen(
    study: Study,
    model: DetailedModel,
    parts: Partition | None,
    stepper: Stepper,
    contingencies: tuple[Contingency, ...],
    workers: int | None,
    earlier: Mapping[str, Any] | None,
) -> tuple[ModelSettings, str | None, Family | None]:
    """The model's settings, why it was chosen, and its family; None for the detailed model."""
    kind, reason = study.model.kind, None
    if earlier is not None:
        kind, reason = ModelKind(earlier["model"]), earlier.get("model_reason")
    settings = study.model.settings(kind)
    if kind is ModelKind.AUTO:
        settings = study.model.settings(ModelKind.ADAPTIVE)
        work = _work(study, stepper, contingencies)
        chosen = choose_model(settings, model, parts, work, stepper)
        return replace(settings, kind=chosen.kind), chosen.reason, chosen.family
    if kind is ModelKind.DETAILED or parts is None:
        return settings, reason, None
    if study.model.calibrate:
        settings = _calibrated(study, settings, parts, stepper, contingencies, workers)
    fitted = (earlier or {}).get("fit")
    family = settings.build(parts, stepper, Fit.of_record(fitted) if fitted else None)
    if isinstance(family, Ladder) and earlier is not None:
        known = earlier.get("step_seconds", {})
        family = replace(family, step_seconds={Mode(name): s for name, s in known.items()})
    return settings, reason, family


def _work(study: Study, stepper: Stepper, contingencies: tuple[Contingency, ...]) -> Work:
    """What the study is going to simulate."""
    new = sum(not all(_leaves_intact(e) for e in item.events) for item in contingencies)
    return Work(len(contingencies), round(study.run.t_end / stepper.step), new)


def _calibrated(
    study: Study,
    settings: ModelSettings,
    parts: Partition,
    stepper: Stepper,
    contingencies: tuple[Contingency, ...],
    workers: int | None,
) -> ModelSettings:
    """The settings of a model of the paper with the thresholds that are not given calibrated."""
    wanted, switches = study.model, settings.kind in ANGLES_DEG
    if wanted.column_norm is not None and (wanted.angle_deg is not None or not switches):
        return settings
    faults = [item.events for item in contingencies if all(_leaves_intact(e) for e in item.events)]
    if not faults:
        raise OptionError(
            "model.calibrate needs faults that clear themselves among the contingencies"
        )
    angle_kind = {
        ModelKind.PAPER: ThresholdKind.PARTITIONED,
        ModelKind.PAPER_WHOLE: ThresholdKind.WHOLE,
    }.get(wanted.kind)
    what = {ThresholdKind.COLUMN_NORM} if wanted.column_norm is None else set()
    if angle_kind is not None and wanted.angle_deg is None:
        what.add(angle_kind)
    found = calibrate(
        parts,
        faults,
        t_end=study.run.t_end,
        stepper=stepper,
        reducer=settings.reduction.build(ported=False),
        limit_deg=wanted.largest_error_deg,
        what=what,
        column_norm=wanted.column_norm,
        criterion=study.run.criterion,
        workers=workers,
        coupling=wanted.coupling or BoundaryCoupling.EXACT,
    )
    values = {kind: threshold.value for kind, threshold in found.thresholds.items()}
    missing = [kind.value for kind in what if values.get(kind) is None]
    if missing:
        raise OptionError(
            f"no {missing[0]} keeps all errors below {wanted.largest_error_deg:g} degrees; "
            "give the thresholds in [model]"
        )
    norm = values.get(ThresholdKind.COLUMN_NORM, wanted.column_norm)
    assert norm is not None
    angle = wanted.angle_deg
    if angle_kind is not None and angle is None:
        angle = values.get(angle_kind)
    retain = replace(settings.retain, column_norm=norm)
    return replace(settings, retain=retain, angle_deg=angle)


def _leaves_intact(event: object) -> bool:
    return isinstance(event, BusFault) and not event.trip_bus


def _saved(family: Ladder | ReducedExternal, norm: float) -> bytes:
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "reduced.npz"
        save_reduced(path, family, norm)
        return path.read_bytes()


def _family(offline: Offline, model: DetailedModel) -> tuple[Partition | None, Family | None]:
    settings, inside = offline.settings, offline.study_buses
    parts = partition(model, inside) if inside else None
    if settings.kind is ModelKind.DETAILED or parts is None:
        return parts, None
    if offline.reduced is None:
        return parts, settings.build(parts)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "reduced.npz"
        path.write_bytes(offline.reduced)
        family = settings.adopt(load_reduced(path, model).family)
    return family.parts, family


def describe(offline: Offline, prepared: Prepared) -> dict[str, Any]:
    """The model and its settings for people and the report, ready for JSON."""
    small = prepared.small
    record: dict[str, Any] = {
        "model": offline.settings.kind.value,
        "model_reason": offline.reason,
        "method": prepared.method.stepper.name,
        "step": prepared.method.stepper.step,
        "method_reason": prepared.method.reason,
        "method_doubts": list(prepared.method.doubts),
        "study_buses": as_ranges(offline.study_buses),
        "machines": len(prepared.model.machines),
        "states": prepared.model.n_states,
        **basis_of(with_start_checked(prepared.model)).record(),
    }
    if small is None or prepared.parts is None:
        return record
    family = small.family
    assert isinstance(family, Ladder | ReducedExternal | WholeSystem)
    record |= {
        **offline.settings.record(family),
        "tie_lines": len(prepared.parts.tie_lines),
        "external_machines": len(prepared.parts.external_units),
    }
    if prepared.tolerant is not None:
        record["tolerance_told"] = prepared.tolerant.told
    if isinstance(family, Ladder):
        record["step_seconds"] = {mode.value: s for mode, s in family.step_seconds.items()}
        modes = compared_modes(family.areas[-1])
        record["moved_modes"] = [str(mode) for mode in modes if mode.moved]
    return record
