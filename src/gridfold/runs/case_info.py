"""Look at a case as far as it goes: neither missing models nor a failing power flow are errors here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from gridfold.cards import Card
from gridfold.dynamics.device import Device
from gridfold.dynamics.initialize import OnLimit
from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.network import LoadModel
from gridfold.dynamics.own_models import answering, is_own
from gridfold.dynamics.plausible import case_doubts, model_doubts
from gridfold.dynamics.psse_models import kind_of
from gridfold.dynamics.psse_records import Unsupported, WithoutData, with_user_written
from gridfold.dynamics.registry import DEVICES
from gridfold.editing import Edit
from gridfold.errors import CaseError, InitializationError, PowerFlowError
from gridfold.grid.case import Branch, Case
from gridfold.grid.doubts import Doubt
from gridfold.grid.dynamic_records import DynamicData, SkippedRecord
from gridfold.io.dyr import read_dyr
from gridfold.io.powerio_cases import read_network
from gridfold.io.unit_sources import read_unit_sources, with_sources
from gridfold.powerflow import PowerFlowResult, solve_power_flow
from gridfold.runs.basis import Basis, basis_of, basis_of_case
from gridfold.runs.loading import Solve, edited, solved_as, with_devices
from gridfold.runs.unstable_start import with_start_checked


class ModelCount(NamedTuple):
    """Records of one model in dynamic data: name, what it is, how many, whether there is a model.

    `own` tells whether that is one of the user's own.
    """

    model: str
    kind: str
    records: int
    implemented: bool
    own: bool = False


class AreaTie(NamedTuple):
    """A branch in service between two areas; the areas are those of its first and second bus."""

    branch: Branch
    areas: tuple[int, int]


@dataclass(frozen=True, repr=False)
class CaseInfo(Card):
    """A case and how far one gets with it.

    Parameters
    ----------
    case : Case
        The case, without devices if its dynamic data have faults.
    basis : Basis
        What was left out or replaced, and the faults of the dynamic data.
    models : tuple of ModelCount
        Models in the dynamic data.
    skipped : tuple of SkippedRecord
        Records of the dynamic data that were not read.
    advice : tuple of str
        Options that would make a model in spite of the faults.
    power_flow : PowerFlowResult or None
        None where it does not converge.
    model : DetailedModel or None
        None where there is none.
    trouble : str
        Why there is no power flow or no model; empty if there is nothing more to say.
    """

    case: Case
    basis: Basis
    models: tuple[ModelCount, ...] = ()
    skipped: tuple[SkippedRecord, ...] = ()
    advice: tuple[str, ...] = ()
    power_flow: PowerFlowResult | None = None
    model: DetailedModel | None = None
    trouble: str = ""

    def _facts(self) -> dict[str, object]:
        known = sum(model.implemented for model in self.models)
        return {
            "case": self.case.name,
            "buses": len(self.case.buses),
            "models": f"{known} of {len(self.models)} kinds in gridfold",
            "power flow": "none" if self.power_flow is None else "solved",
            "dynamic model": "none" if self.model is None else f"{self.model.n_states} states",
            "trouble": self.trouble or "none",
        }


def examine_files(
    network: str | Path,
    dyr: str | Path | None,
    loads: LoadModel,
    on_limit: OnLimit = OnLimit.ERROR,
    unsupported: Unsupported = Unsupported.ERROR,
    without_data: WithoutData = WithoutData.ERROR,
    raw_revision: int | None = None,
    unit_sources: str | Path | None = None,
    solve: Solve = Solve.STORED,
    devices: Mapping[str, Device] = DEVICES,
    edits: Sequence[Edit] = (),
) -> CaseInfo:
    """What is in a RAW or MATPOWER file and a DYR file, and how far gridfold gets with them.

    Raises
    ------
    CaseError
        A file cannot be read, or the network is wrong.
    """
    case = read_network(network, allow_unsupported=True, raw_revision=raw_revision)
    if unit_sources is not None:
        case = with_sources(case, read_unit_sources(unit_sources, case))
    try:
        case = case if edits else solved_as(case, solve)
    except PowerFlowError as error:
        return CaseInfo(
            case, basis_of_case(case, loads, _doubts(case, None, devices)), trouble=str(error)
        )
    if dyr is None:
        case = edited(case, edits, solve) if edits else case
        flow, trouble = _flow(case)
        basis = basis_of_case(case, loads, _doubts(case, flow, devices), flow=flow)
        return CaseInfo(case, basis, power_flow=flow, trouble=trouble)
    data = with_user_written(read_dyr(dyr), devices)
    models = _counts(data, devices)
    try:
        case = with_devices(case, data, unsupported, without_data, devices)
    except CaseError as error:
        flow, trouble = _flow(case)
        if edits:
            trouble = "\n".join(filter(None, ("Edits are not made: models are missing.", trouble)))
        basis = basis_of_case(case, loads, _doubts(case, flow, devices), tuple(error.faults), flow)
        return CaseInfo(case, basis, models, data.skipped, error.advice, flow, None, trouble)
    case = edited(case, edits, solve, devices) if edits else case
    flow, trouble = _flow(case)
    model = None
    if flow is not None:
        try:
            built = build_model(case, flow, loads=loads, on_limit=on_limit, devices=devices)
            model = with_start_checked(built)
        except (CaseError, InitializationError) as error:
            trouble = str(error)
    if model is None:
        basis = basis_of_case(case, loads, _doubts(case, flow, devices), flow=flow)
    else:
        basis = basis_of(model)
    return CaseInfo(case, basis, models, data.skipped, (), flow, model, trouble)


def examine_case(
    case: Case,
    loads: LoadModel,
    on_limit: OnLimit = OnLimit.ERROR,
    devices: Mapping[str, Device] = DEVICES,
) -> CaseInfo:
    """The same of a case that is loaded; raises as :func:`gridfold.build_model`."""
    model = with_start_checked(build_model(case, loads=loads, on_limit=on_limit, devices=devices))
    counts = Counter(record.model for record in case.devices)
    models = tuple(
        ModelCount(name, _role(name, devices), n, True, name in devices and is_own(devices[name]))
        for name, n in counts.items()
    )
    return CaseInfo(case, basis_of(model), models, power_flow=model.power_flow, model=model)


def area_ties(case: Case) -> tuple[AreaTie, ...]:
    """Branches in service between areas, by the pair of areas."""
    area = {bus.number: bus.area for bus in case.buses}
    ties = (
        AreaTie(branch, (area[branch.from_bus], area[branch.to_bus]))
        for branch in case.branches
        if branch.in_service and area[branch.from_bus] != area[branch.to_bus]
    )
    return tuple(sorted(ties, key=lambda tie: sorted(tie.areas)))


def _role(name: str, devices: Mapping[str, Device]) -> str:
    return devices[name].role.name.lower() if name in devices else "negative load"


def _flow(case: Case) -> tuple[PowerFlowResult | None, str]:
    try:
        return solve_power_flow(case), ""
    except PowerFlowError as error:
        return None, str(error)


def _doubts(
    case: Case, flow: PowerFlowResult | None, devices: Mapping[str, Device]
) -> tuple[Doubt, ...]:
    return case_doubts(case, devices) if flow is None else model_doubts(flow, devices)


def _counts(data: DynamicData, devices: Mapping[str, Device]) -> tuple[ModelCount, ...]:
    known = answering(devices)
    own = {name for name, device in known.items() if is_own(device)}
    counts = Counter(record.model for record in data.records)
    return tuple(
        ModelCount(model, kind_of(model, known).value, count, model in known, model in own)
        for model, count in counts.items()
    )
