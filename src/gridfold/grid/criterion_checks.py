"""Criteria held against a case: the buses and machines that they are about."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence

from gridfold.errors import OptionError, require_list
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.criteria import (
    CRITERIA,
    AngleSeparation,
    Criterion,
    FrequencyBand,
    VoltageDip,
    VoltageRecovery,
)
from gridfold.grid.selection import select_buses, select_machines


def check_criteria(
    criteria: Sequence[Criterion], case: Case, study: Collection[int] | None = None
) -> None:
    """Raise an OptionError that names every criterion which does not fit the case."""
    kinds = tuple(CRITERIA.values())
    require_list(
        criteria, lambda item: isinstance(item, kinds), "criteria", "[gridfold.VoltageDip(0.8)]"
    )
    faults = []
    for number, criterion in enumerate(criteria):
        try:
            _check(criterion, case, study)
        except OptionError as error:
            faults.append(f"criterion {str(criterion)!r}: {error}")
        if str(criterion) in map(str, criteria[:number]):
            faults.append(f"criterion {str(criterion)!r} is given twice; give one of them a name")
    if faults:
        raise OptionError("\n".join(faults))


def judged_buses(
    criterion: VoltageDip | VoltageRecovery, case: Case, study: Collection[int] | None
) -> tuple[int, ...]:
    """Numbers of the buses that a criterion is about."""
    text = criterion.buses or ("study area" if study else "all")
    return select_buses(text, case, "buses", study)


def judged_machines(
    criterion: AngleSeparation, case: Case, among: Iterable[UnitKey], study: Collection[int] | None
) -> tuple[UnitKey, ...]:
    """The machines `among` those with a rotor that a criterion is about."""
    return select_machines(criterion.machines or "all", case, "machines", study, tuple(among))


def _check(criterion: Criterion, case: Case, study: Collection[int] | None) -> None:
    if isinstance(criterion, VoltageDip | VoltageRecovery):
        if not judged_buses(criterion, case, study):
            raise OptionError(f"{criterion.buses!r} chooses no bus")
    elif isinstance(criterion, AngleSeparation):
        units = [record.key for record in case.devices]
        if len(judged_machines(criterion, case, dict.fromkeys(units), study)) < 2:
            raise OptionError(f"{criterion.machines or 'all'!r} chooses fewer than two machines")
    elif isinstance(criterion, FrequencyBand):
        low, high = criterion.lowest_hz or 0.0, criterion.highest_hz or math.inf
        if not low < case.frequency_hz < high:
            raise OptionError(f"the band does not hold the {case.frequency_hz:g} Hz of {case.name}")
        for name, ratio in (("lowest_hz", low), ("highest_hz", high)):
            if getattr(criterion, name) is not None and not 0.5 < ratio / case.frequency_hz < 2:
                raise OptionError(
                    f"{name} is {ratio:g}, far from the {case.frequency_hz:g} Hz of {case.name}"
                )
