"""What a result rests on beside the data of the files: said with every result, in one form."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.loads import LoadModel
from gridfold.dynamics.own_models import own_notices
from gridfold.grid.case import Case
from gridfold.grid.doubts import Doubt
from gridfold.grid.replacement import Replacement
from gridfold.powerflow.result import PowerFlowResult


@dataclass(frozen=True)
class Basis:
    """What became of a case on the way to its model.

    Parameters
    ----------
    loads : LoadModel
        How loads depend on voltage.
    replacements : tuple of Replacement
        Dynamic models that were replaced or left out, generators that became negative loads.
    limits_moved : tuple of str
        Limits of devices that were moved to the start.
    unsupported : tuple of str
        Parts of the network that were left out, as gridfold has no model for them.
    notices : tuple of str
        What else was noticed in the files, and in the solution of their power flow.
    missing : tuple of str
        Faults of dynamic data for which there is no model at all.
    unplaced : tuple of str
        Records of dynamic data that name a unit which the network does not have.
    data_doubts : tuple of Doubt
        Data that are hardly meant.
    warnings : tuple of str
        What else was noticed while the model was built.
    """

    loads: LoadModel = field(default_factory=LoadModel)
    replacements: tuple[Replacement, ...] = ()
    limits_moved: tuple[str, ...] = ()
    unsupported: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    unplaced: tuple[str, ...] = ()
    data_doubts: tuple[Doubt, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why results are not validated, in words; none if they are."""
        lines = []
        if self.replacements:
            most = max(self.replacements, key=lambda item: item.share)
            kinds = _count(len(self.replacements), "kind")
            touched = f" (up to {most.share:.1%} of {most.of} touched)" if most.share else ""
            lines.append(f"{kinds} of dynamic data replaced or left out{touched}")
        if self.unsupported:
            lines.append(f"{_count(len(self.unsupported), 'part')} of the network left out")
        if self.unplaced:
            count = _count(len(self.unplaced), "record")
            lines.append(f"{count} of dynamic data at units that are not there")
        if self.missing:
            lines.append(f"{_count(len(self.missing), 'fault')} of the dynamic data")
        return tuple(lines)

    @property
    def validated(self) -> bool:
        """Whether everything in the files that acts has the model that the files ask for."""
        return not self.reasons

    def record(self) -> dict[str, Any]:
        """All of it, ready for JSON."""
        return {
            "validated": self.validated,
            "load_model": self.loads.text,
            "replacements": [item.record() for item in self.replacements],
            "limits_moved": list(self.limits_moved),
            "unsupported": list(self.unsupported),
            "unplaced": list(self.unplaced),
            "case_notices": list(self.notices),
            "warnings": list(self.warnings),
            "data_doubts": [str(doubt) for doubt in self.data_doubts],
        }


def basis_of(model: DetailedModel) -> Basis:
    """What results of a model rest on."""
    moved = model.limits_moved
    warnings = tuple(line for line in model.warnings if not line.endswith(moved))
    basis = basis_of_case(model.case, model.loads, model.doubts, flow=model.power_flow)
    blocks = model.layout.blocks
    own = own_notices({b.device.model: len(b.units) for b in blocks}, [b.device for b in blocks])
    notices = (*basis.notices, *own)
    return replace(basis, limits_moved=moved, warnings=warnings, notices=notices)


def basis_of_case(
    case: Case,
    loads: LoadModel,
    doubts: tuple[Doubt, ...],
    missing: tuple[str, ...] = (),
    flow: PowerFlowResult | None = None,
) -> Basis:
    """The same of a case of which there may be no model, nor a power flow."""
    return Basis(
        loads,
        case.replacements,
        unsupported=case.unsupported,
        notices=(*case.notices, *(flow.notices if flow else ())),
        missing=missing,
        unplaced=case.unplaced,
        data_doubts=doubts,
    )


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
