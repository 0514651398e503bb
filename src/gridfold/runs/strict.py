"""Warnings as errors: for those who want no result from data that are hardly meant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gridfold.dynamics.device import Device
from gridfold.dynamics.plausible import case_doubts
from gridfold.dynamics.registry import DEVICES
from gridfold.errors import CaseError
from gridfold.grid.case import Case
from gridfold.runs.basis import Basis


def refuse_doubtful_case(case: Case, devices: Mapping[str, Device] = DEVICES) -> None:
    """Raise a CaseError if data of the case are hardly meant, or records name no unit: lists all."""
    _refuse(case, [*case.unplaced, *map(str, case_doubts(case, devices))])


def refuse_doubtful_start(case: Case, basis: Basis) -> None:
    """The same of a model's `basis`: also for an unusual, unstable or inexact operating point."""
    _refuse(case, [*basis.unplaced, *map(str, basis.data_doubts), *basis.warnings])


def _refuse(case: Case, faults: Sequence[str]) -> None:
    if faults:
        raise CaseError(faults, f"case {case.name}, where warnings are errors")
