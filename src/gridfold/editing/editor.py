"""Edits one after another, and the case that they give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from gridfold.dynamics.assemble import device_faults
from gridfold.dynamics.device import Device
from gridfold.dynamics.own_models import Devices, device_models
from gridfold.dynamics.registry import DEVICES
from gridfold.editing.edits import Add, Dispatch, Edit, Remove, ScaleLoad, Set, Switch
from gridfold.errors import CaseError, GridfoldError, OptionError, require_list
from gridfold.grid.case import Case, Record
from gridfold.grid.validation import validate_case

#: How a notice of a case about an edit begins.
EDITED = "edited: "
#: Buses, areas or zones: a number, or text such as ``1-36,78``.
Places = str | int


def apply_edits(case: Case, edits: Sequence[Edit], devices: Mapping[str, Device] = DEVICES) -> Case:
    """The case with edits, one after another, checked as a whole.

    `Case.notices` of the new case tell what was done.

    Parameters
    ----------
    case : Case
        The case; it is left as it is.
    edits : sequence of Edit
        See :mod:`gridfold.editing.edits` and :func:`gridfold.load_edits`.
    devices : mapping
        All device models by name.

    Raises
    ------
    CaseError
        Lists every edit that names what is not there or gives a value without meaning, else every fault
        that the edits bring into the case.
    """
    require_list(
        edits, lambda item: hasattr(item, "apply"), "edits", "gridfold.load_edits('edits.toml')"
    )
    if not edits:
        return case
    faults: list[str] = []
    after, origins, done = case, dict(case.origins), []
    for number, edit in enumerate(edits, start=1):
        try:
            after, text, names = edit.apply(after, devices)
        except GridfoldError as error:
            faults.append(f"edit {number}: {error}")
            continue
        origins |= dict.fromkeys(names, f"edit {number}")
        done.append(f"{EDITED}{text}")
    if not faults:
        after = replace(after, origins=origins, notices=(*case.notices, *done))
        faults = _new_faults(replace(case, origins=origins), after, devices)
    if faults:
        raise CaseError(faults, f"edits of case {case.name}")
    return after


def _new_faults(before: Case, after: Case, devices: Mapping[str, Device]) -> list[str]:
    """Faults of the case that it did not have before."""
    faults = validate_case(after)
    if not faults:
        faults = list(device_faults(after, devices))
    old = {*validate_case(before), *device_faults(before, devices)} if faults else set()
    return [fault for fault in faults if fault not in old]


@dataclass(frozen=True)
class CaseEditor:
    """Edits of a case that are noted one after another; :meth:`case` applies them.

    Every method gives a new editor, so that several cases may go on from one. Records and values are
    written as in :mod:`gridfold.editing.names`.

    Parameters
    ----------
    base : Case
        The case, which is left as it is.
    edits : tuple of Edit
        What has been noted.
    devices : mapping
        All device models by name.
    """

    base: Case = field(repr=False)
    edits: tuple[Edit, ...] = ()
    devices: Mapping[str, Device] = field(default_factory=lambda: DEVICES, repr=False)

    def scale_load(
        self,
        factor: float | None = None,
        *,
        active_mw: float | None = None,
        buses: Places = "",
        areas: Places = "",
        zones: Places = "",
    ) -> CaseEditor:
        """Loads in service times `factor`, or to `active_mw` together; without a place, all of them."""
        times = None if factor is None else _number("factor", factor)
        power = None if active_mw is None else _number("active_mw", active_mw)
        return self.then(ScaleLoad(times, power, str(buses), str(areas), str(zones)))

    def set(self, *records: str) -> CaseEditor:
        """Values of records, each as ``"GENROU 101:1 H=4 D=0"``."""
        return self.then(*map(Set, records))

    def switch(self, record: str, state: str) -> CaseEditor:
        """Branches, generators, loads or shunts, as ``"branch 101-103:1"``, ``"in"`` or ``"out"``."""
        return self.then(Switch(record, state))

    def redispatch(
        self,
        active_mw: float,
        *,
        buses: Places = "",
        areas: Places = "",
        zones: Places = "",
        units: str = "",
    ) -> CaseEditor:
        """`active_mw` more (negative: less) from units, shared in proportion to their power."""
        return self.then(
            Dispatch(_number("active_mw", active_mw), str(buses), str(areas), str(zones), units)
        )

    def add(self, *records: str | Record) -> CaseEditor:
        """New records, each as ``"load 101:2 PL=50"`` or as a record such as :class:`gridfold.Load`."""
        return self.then(*map(Add, records))

    def remove(self, *records: str) -> CaseEditor:
        """Records that go, each as ``"SEXS 101:1"``."""
        return self.then(*map(Remove, records))

    def then(self, *edits: Edit) -> CaseEditor:
        """Further edits, such as those of :func:`gridfold.load_edits`."""
        return replace(self, edits=(*self.edits, *edits))

    def case(self) -> Case:
        """The edited case.

        Raises
        ------
        CaseError
            Lists the faults, as :func:`gridfold.apply_edits`.
        """
        return apply_edits(self.base, self.edits, self.devices)


def _number(name: str, value: float) -> float:
    """A number of Python; OptionError where it is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise OptionError(f"{name} must be a number, not {value!r}") from None


def edit_case(case: Case, devices: Devices = ()) -> CaseEditor:
    """See :meth:`gridfold.Case.edit`."""
    return CaseEditor(case, devices=device_models(devices))
