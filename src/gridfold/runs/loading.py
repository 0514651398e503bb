"""Load a case from any source: gridfold's own, PSS/E's RAW and DYR, MATPOWER, RAPID."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TypeVar

from gridfold.cards import Card
from gridfold.dynamics.device import Device
from gridfold.dynamics.own_models import Devices, device_models, telling_own_errors
from gridfold.dynamics.psse_records import Unsupported, WithoutData, device_records
from gridfold.dynamics.registry import DEVICES
from gridfold.editing import Edit, apply_edits
from gridfold.errors import CaseError, GridfoldError, OptionError
from gridfold.grid.case import Case
from gridfold.grid.dynamic_records import DynamicData
from gridfold.grid.replacement import Replacement
from gridfold.io.case_folder import read_case
from gridfold.io.dyr import read_dyr
from gridfold.io.powerio_cases import read_network
from gridfold.io.unit_sources import read_unit_sources, with_sources
from gridfold.powerflow.limits import with_limits
from gridfold.runs.dc_models import dc_replacements
from gridfold.runs.strict import refuse_doubtful_case

Choice = TypeVar("Choice", bound=Enum)

#: Suffixes of networks that other programs have written.
NETWORK_SUFFIXES = (".raw", ".m")
_DYNAMICS_SUFFIX = ".dyr"


class Solve(Enum):
    """Which operating point is solved: the stored one, or that of set points, limits and shunts."""

    STORED = "stored"
    LIMITS = "limits"


@dataclass(frozen=True, repr=False)
class LoadedCase(Card):
    """A case from planners' files, and what was done to it, which the case tells too.

    Parameters
    ----------
    case : Case
        The case.
    replacements : tuple of Replacement
        Dynamic models that were replaced or left out on request.
    notices : tuple of str
        What else the reader should know.
    """

    case: Case
    replacements: tuple[Replacement, ...] = ()
    notices: tuple[str, ...] = ()

    def _facts(self) -> dict[str, object]:
        return {
            "case": self.case.name,
            "buses": len(self.case.buses),
            "devices": len(self.case.devices),
            "replacements": len(self.replacements),
            "notices": len(self.notices),
        }


def load_case(
    source: str | Path,
    dyr: str | Path | None = None,
    *,
    unsupported: Unsupported | str = Unsupported.ERROR,
    without_data: WithoutData | str = WithoutData.ERROR,
    unit_sources: str | Path | None = None,
    allow_unsupported_network: bool = False,
    raw_revision: int | None = None,
    solve: Solve | str = Solve.STORED,
    edits: Sequence[Edit] = (),
    strict: bool = False,
    devices: Devices = DEVICES,
) -> Case:
    """Load a case: a built-in one, one of gridfold's own folders, or files of other programs.

    Parameters
    ----------
    source : str or Path
        ``"npcc"``, ``"npcc-pst"``, a folder with ``case.toml`` and CSV tables, a RAW file of PSS/E
        (``.raw``, revisions 29 to 35), a MATPOWER case (``.m``, a network without devices) or a
        MATLAB file of RAPID (``.mat``, :mod:`gridfold.io.rapid_mat`).
    dyr : str or Path, optional
        Dynamic data of PSS/E (``.dyr``) for the network; without them it has no devices.
    unsupported : {"error", "classical", "drop"}
        What to do with models in these data that gridfold does not have.
    without_data : {"error", "negative_load", "typical"}
        What to do with generators in service that have no machine in these data.
    unit_sources : str or Path, optional
        Table of what drives the units, columns bus, id and source, for typical data.
    allow_unsupported_network : bool
        Leave out what gridfold has no model for in the network.
    raw_revision : int, optional
        Revision of a RAW file, 29 to 35, whatever its header says; by default that of the header or,
        where it gives none, the one that the fields of the records tell.
    solve : {"stored", "limits"}
        Keep the stored operating point, in which units hold the stored voltage of their bus; or find
        that of the file's set points, reactive limits and switched shunts
        (:func:`gridfold.powerflow.limits.with_limits`), and tell what moved in ``Case.notices``.
    edits : sequence of Edit
        What is changed, before the operating point is solved (:func:`gridfold.load_edits`).
    strict : bool
        Refuse data that are hardly meant, and dynamic data of units that the network does not have.
    devices : Device, iterable of Device, or mapping
        Device models of your own (:func:`gridfold.load_devices`), which are asked before a record of
        these data is called unsupported. :func:`gridfold.build_model` needs them too.

    Raises
    ------
    CaseError
        A file is missing or cannot be read, or its data are wrong or not supported; with `strict` also
        where they are hardly meant. Lists every fault.
    OptionError
        An option has an unknown value, or the files do not go together, or the case has no set points
        and limits to solve with.
    PowerFlowError
        There is no operating point within limits, or none was found.
    """
    wanted = _choice("solve", Solve, solve)
    first = Solve.STORED if edits else wanted
    models = device_models(devices)
    if not is_network_file(source, dyr):
        if raw_revision is not None:
            raise OptionError(f"raw_revision is for RAW files of PSS/E, not for {source}")
        if unit_sources is not None:
            raise OptionError(f"unit_sources is for PSS/E's dynamic data, not for {source}")
        case = solved_as(read_case(source), first)
    else:
        case = load_psse(
            source,
            dyr,
            unsupported=unsupported,
            without_data=without_data,
            unit_sources=unit_sources,
            allow_unsupported_network=allow_unsupported_network,
            raw_revision=raw_revision,
            solve=first,
            devices=models,
        ).case
    if edits:
        case = edited(case, edits, wanted, models)
    if strict:
        with telling_own_errors(models.values()):
            refuse_doubtful_case(case, models)
    return case


def solved_as(case: Case, solve: Solve) -> Case:
    """The case at the operating point that is wanted; raises as :func:`load_case`."""
    return with_limits(case) if solve is Solve.LIMITS else case


def edited(
    case: Case, edits: Sequence[Edit], solve: Solve, devices: Mapping[str, Device] = DEVICES
) -> Case:
    """The case with edits, and then at the operating point that is wanted."""
    with telling_own_errors(devices.values()):
        return solved_as(apply_edits(case, edits, devices), solve)


def is_network_file(source: str | Path, dyr: str | Path | None = None) -> bool:
    """Whether `source` is a RAW or MATPOWER file, by its suffix; checks that `dyr` goes with it."""
    suffix = Path(source).suffix.lower()
    if suffix == _DYNAMICS_SUFFIX:
        raise OptionError(f"{source} holds dynamic data alone; the RAW file comes before it")
    if dyr is not None and Path(dyr).suffix.lower() != _DYNAMICS_SUFFIX:
        raise OptionError(f"dynamic data come from a file with the suffix .dyr, not from {dyr}")
    if dyr is not None and suffix not in NETWORK_SUFFIXES:
        raise OptionError(f"{dyr} needs a RAW file (.raw) before it, not {source}")
    return suffix in NETWORK_SUFFIXES


def load_psse(
    raw: str | Path,
    dyr: str | Path | None = None,
    *,
    unsupported: Unsupported | str = Unsupported.ERROR,
    without_data: WithoutData | str = WithoutData.ERROR,
    unit_sources: str | Path | None = None,
    allow_unsupported_network: bool = False,
    raw_revision: int | None = None,
    solve: Solve | str = Solve.STORED,
    devices: Devices = DEVICES,
) -> LoadedCase:
    """Load a case from a RAW file (or a MATPOWER file) and a DYR file.

    Parameters
    ----------
    raw : str or Path
        Network, ``.raw`` or ``.m``.
    dyr : str or Path, optional
        Dynamic data; without them the case has no device records, which is enough for a power flow.
    unsupported, without_data, unit_sources, allow_unsupported_network, raw_revision, solve, devices
        As in :func:`gridfold.load_case`.

    Raises
    ------
    CaseError
        A file cannot be read, or its data are wrong or not supported; lists every fault.
    DeviceError
        A device model of your own is wrong.
    OptionError
        An option has an unknown value.
    PowerFlowError
        As in :func:`gridfold.load_case`.
    """
    on_unsupported = _choice("unsupported", Unsupported, unsupported)
    on_lacking = _choice("without_data", WithoutData, without_data)
    way = _choice("solve", Solve, solve)

    def network(allowed: bool) -> Case:
        case = read_network(raw, allowed, raw_revision)
        if unit_sources is not None:
            case = with_sources(case, read_unit_sources(unit_sources, case))
        return solved_as(case, way)

    if dyr is None:
        case = network(allow_unsupported_network)
    else:
        models = device_models(devices)

        def go_on() -> None:
            data = read_dyr(dyr)  # before the network: its own faults are told in any case
            with_devices(network(True), data, on_unsupported, on_lacking, models)

        with faults_later(go_on):
            case = network(allow_unsupported_network)
        case = with_devices(case, read_dyr(dyr), on_unsupported, on_lacking, models)
    return LoadedCase(case, case.replacements, case.notices)


@contextmanager
def faults_later(go_on: Callable[[], object]) -> Iterator[None]:
    """Where the block raises a CaseError, tell with it what is wrong later: what `go_on` raises.

    `go_on` does what comes after the block with a case for which the options are chosen that an error
    may name. What it raises that is known already is not told again.
    """
    try:
        yield
    except CaseError as error:
        try:
            go_on()
        except GridfoldError as later:
            if not set(getattr(later, "faults", [later.text])) <= set(error.faults):
                raise error.joined(later) from None
        raise


def with_devices(
    case: Case,
    data: DynamicData,
    unsupported: Unsupported = Unsupported.ERROR,
    without_data: WithoutData = WithoutData.ERROR,
    devices: Mapping[str, Device] = DEVICES,
) -> Case:
    """The network `case` with the devices of `data`; raises as :func:`load_psse`."""
    with telling_own_errors(devices.values()):
        found = device_records(
            case, data, unsupported=unsupported, without_data=without_data, devices=devices
        )
    return replace(
        case,
        devices=found.records,
        origins={**case.origins, **found.origins},
        notices=(*case.notices, *found.skipped),
        replacements=(*found.replaced, *dc_replacements(case, data.skipped)),
        unplaced=found.unplaced,
    )


def _choice(name: str, kind: type[Choice], value: Choice | str) -> Choice:
    try:
        return kind(value)
    except ValueError:
        known = ", ".join(str(member.value) for member in kind)
        raise OptionError(f"{name} must be one of {known}, not {value!r}") from None
