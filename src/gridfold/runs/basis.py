"""What a result rests on beside the data of the files: said with every result, in one form."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.loads import LoadModel
from gridfold.grid.case import Case
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
    """

    loads: LoadModel = field(default_factory=LoadModel)
    replacements: tuple[Replacement, ...] = ()
    limits_moved: tuple[str, ...] = ()
    unsupported: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why results are not validated, in words; none if they are."""
        lines = []
        if self.replacements:
            most = max(self.replacements, key=lambda item: item.share)
            kinds = _count(len(self.replacements), "kind")
            touched = f" (up to {most.share:.1%} of {most.of} touched)" if most.share else ""
            lines.append(f"{kinds} of dynamic data replaced or left out{touched}")
        if self.unsupported:
            lines.append(f"{_count(len(self.unsupported), 'part')} of the network left out")
        if self.missing:
            lines.append(f"{_count(len(self.missing), 'fault')} of the dynamic data")
        return tuple(lines)

    @property
    def validated(self) -> bool:
        """Whether everything in the files that acts has the model that the files ask for."""
        return not self.doubts

    def record(self) -> dict[str, Any]:
        """All of it, ready for JSON."""
        return {
            "validated": self.validated,
            "load_model": self.loads.text,
            "replacements": [item.record() for item in self.replacements],
            "limits_moved": list(self.limits_moved),
            "unsupported": list(self.unsupported),
            "case_notices": list(self.notices),
        }


def basis_of(model: DetailedModel) -> Basis:
    """What results of a model rest on."""
    return basis_of_case(model.case, model.loads, model.limits_moved, flow=model.power_flow)


def basis_of_case(
    case: Case,
    loads: LoadModel,
    limits_moved: tuple[str, ...] = (),
    missing: tuple[str, ...] = (),
    flow: PowerFlowResult | None = None,
) -> Basis:
    """The same of a case of which there may be no model, nor a power flow."""
    notices = (*case.notices, *(flow.notices if flow else ()))
    return Basis(loads, case.replacements, limits_moved, case.unsupported, notices, missing)


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
