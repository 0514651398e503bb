"""Load a grid from PSS/E files: network and operating point from RAW, devices from DYR."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TypeVar

from gridfold.dynamics.psse_records import Unsupported, WithoutData, device_records
from gridfold.errors import OptionError
from gridfold.grid.case import Case
from gridfold.grid.replacement import Replacement
from gridfold.io.dyr import read_dyr
from gridfold.io.powerio_cases import read_network

Choice = TypeVar("Choice", bound=Enum)


@dataclass(frozen=True)
class LoadedCase:
    """A case from planners' files, and what was done to it.

    Parameters
    ----------
    case : Case
        Its `unsupported` repeats the replacements in words, its `notices` the notices.
    replacements : tuple of Replacement
        Dynamic models that were replaced or left out on request.
    notices : tuple of str
        What else the reader should know.
    """

    case: Case
    replacements: tuple[Replacement, ...] = ()
    notices: tuple[str, ...] = ()


def load_psse(
    raw: str | Path,
    dyr: str | Path | None = None,
    *,
    unsupported: Unsupported | str = Unsupported.ERROR,
    without_data: WithoutData | str = WithoutData.ERROR,
    allow_unsupported_network: bool = False,
) -> LoadedCase:
    """Load a case from a RAW file (or a MATPOWER file) and a DYR file.

    Parameters
    ----------
    raw : str or Path
        Network, ``.raw`` or ``.m``.
    dyr : str or Path, optional
        Dynamic data; without them the case has no device records, which is enough for a power flow.
    unsupported : {"error", "classical", "drop"}
        What to do with dynamic models that gridfold does not have.
    without_data : {"error", "negative_load"}
        What to do with generators in service that have no machine in the dynamic data.
    allow_unsupported_network : bool
        Leave out what gridfold has no model for in the network.

    Raises
    ------
    CaseError
        A file cannot be read, or its data are wrong or not supported; lists every fault.
    OptionError
        An option has an unknown value.
    """
    on_unsupported = _choice("unsupported", Unsupported, unsupported)
    on_lacking = _choice("without_data", WithoutData, without_data)
    case = read_network(raw, allow_unsupported_network)
    if dyr is None:
        return LoadedCase(case, (), case.notices)
    found = device_records(case, read_dyr(dyr), unsupported=on_unsupported, without_data=on_lacking)
    case = replace(
        case,
        devices=found.records,
        origins={**case.origins, **found.origins},
        unsupported=(*case.unsupported, *(str(item) for item in found.replaced)),
        notices=(*case.notices, *found.skipped),
    )
    return LoadedCase(case, found.replaced, case.notices)


def _choice(name: str, kind: type[Choice], value: Choice | str) -> Choice:
    try:
        return kind(value)
    except ValueError:
        known = ", ".join(str(member.value) for member in kind)
        raise OptionError(f"{name} must be one of {known}, not {value!r}") from None
