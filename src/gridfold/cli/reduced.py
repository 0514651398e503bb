"""Commands about the parts of a reduced model: the areas, and the reduced external area."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from gridfold.cli.choice import ExternalOptions
from gridfold.cli.console import out, say_basis, speaks_to_people, write_json_option
from gridfold.cli.options import (
    AreaOptions,
    CaseOptions,
    JsonOption,
    NormOptions,
    model_option,
)
from gridfold.equivalents.choice import ModelSettings
from gridfold.equivalents.families import ReducedExternal
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import ModelKind, Outputs
from gridfold.equivalents.moved_modes import compared_modes
from gridfold.equivalents.saved import save_reduced
from gridfold.grid.selection_text import as_ranges
from gridfold.partition import Coupling, Partition, couple
from gridfold.partition import partition as divide
from gridfold.report.tables import (
    FUNCTIONS_PER_GENERATOR,
    facts_table,
    ladder_facts,
    ladder_table,
    norm_table,
    partition_facts,
    reduction_facts,
    tie_table,
)
from gridfold.runs.basis import basis_of

OutputsOption = Annotated[
    Outputs, model_option(help="For models that act through ports, or for those of the paper.")
]


def partition(
    source: CaseOptions,
    area: AreaOptions,
    norm: NormOptions,
    json: JsonOption = None,
) -> None:
    """Print study and external area, tie lines, and the column norms of external machines.

    Example: gridfold partition npcc --study-buses 1-36
    """
    model = source.build()
    parts = divide(model, area.find(model.case, source.case))
    coupling = couple(parts)
    threshold = norm.per_unit(coupling)
    write_json_option(json, _partition_record(parts, coupling, threshold))
    if speaks_to_people(json):
        buses = as_ranges(parts.study_buses).replace(",", ", ")
        out.print(facts_table(partition_facts(parts, coupling, threshold, buses)))
        out.print(tie_table(parts))
        out.print(norm_table(coupling, threshold))
        say_basis(basis_of(model))


def reduce(
    source: CaseOptions,
    external: ExternalOptions,
    outputs: OutputsOption = Outputs.POLAR,
    tolerance_deg: Annotated[
        float | None,
        model_option(
            help="Error (deg) that rotor angles of the study area may have in runs: what is not given "
            "follows from it."
        ),
    ] = None,
    file: Annotated[
        Path | None, typer.Option("--out", help="Write the reduced model (.npz).")
    ] = None,
    json: JsonOption = None,
) -> None:
    """Linearize and reduce the external area; print its order, error bound and singular values.

    Example: gridfold reduce npcc --study-buses 1-36 --out npcc.npz
    """
    model = source.build()
    began = time.perf_counter()
    parts = external.divide(model, source.case)
    kind = ModelKind.PAPER if outputs is Outputs.STATES else ModelKind.ADAPTIVE
    settings = replace(external.settings(kind, parts), tolerance_deg=tolerance_deg)
    family = settings.build(parts)
    seconds = time.perf_counter() - began
    assert isinstance(family, Ladder | ReducedExternal)
    if file is not None:
        save_reduced(file, family, settings.norm)
    write_json_option(json, _reduction_record(family, settings, seconds))
    if speaks_to_people(json):
        if isinstance(family, Ladder):
            out.print(ladder_table(family))
            out.print(facts_table(ladder_facts(family, seconds)))
        else:
            buses = as_ranges(family.parts.study_buses).replace(",", ", ")
            out.print(facts_table(reduction_facts(family, settings.norm, buses, seconds)))
        if file is not None:
            out.print(facts_table({"Saved as": str(file)}))
        say_basis(basis_of(model))


def _partition_record(parts: Partition, coupling: Coupling, norm: float) -> dict[str, Any]:
    kept = coupling.kept(norm)
    model, case = parts.model, parts.model.case
    per = FUNCTIONS_PER_GENERATOR
    external, study = len(parts.external_units), len(parts.study_units)
    norms = sorted(zip(coupling.norms, coupling.units, strict=True), reverse=True)
    outside = [bus.number for bus in case.buses if bus.number not in parts.study_buses]
    return {
        "case": case.name,
        "fingerprint": case.fingerprint,
        **basis_of(model).record(),
        "study": {
            "buses": sorted(parts.study_buses),
            "machines": [str(unit) for unit in parts.study_units],
            "states": len(parts.states_of(parts.study_units)),
        },
        "external": {
            "buses": outside,
            "machines": [str(unit) for unit in parts.external_units],
            "states": len(parts.states_of(parts.external_units)),
        },
        "states": model.n_states,
        "tie_lines": [
            {
                "branch": str(case.branches[tie.branch]).removeprefix("branch "),
                "study_bus": tie.study_bus,
                "external_bus": tie.external_bus,
            }
            for tie in parts.tie_lines
        ],
        "boundary_buses": list(parts.boundary_buses),
        "threshold": {"per_unit": norm, "siemens_at_20_kv": coupling.siemens(norm)},
        "column_norms": [
            {"unit": str(u), "per_unit": float(v), "kept": u in kept} for v, u in norms
        ],
        "reference": None if coupling.reference is None else str(coupling.reference),
        "functions": {
            "per_generator": per,
            "external": per * external,
            "kept": per * len(kept),
            "linearized": per * (external - len(kept)),
            "whole": per * (external + study),
        },
    }


def _reduction_record(
    family: Ladder | ReducedExternal, settings: ModelSettings, seconds: float
) -> dict[str, Any]:
    case = family.parts.model.case
    record = {
        "case": case.name,
        "fingerprint": case.fingerprint,
        **basis_of(family.parts.model).record(),
        **settings.record(family),
        "seconds": seconds,
    }
    if isinstance(family, ReducedExternal):
        values = family.reduction.hankel_values
        return record | {
            "states": len(family.area.index),
            "hankel_singular_values": None if values is None else values.tolist(),
        }
    areas = [_area_record(area) for area in family.areas]
    modes = [mode.record() for mode in compared_modes(family.areas[-1])]
    return record | areas[0] | {"areas": areas, "swing_modes": modes}


def _area_record(area: FoldedArea) -> dict[str, Any]:
    values = area.bases.hankel_values
    return {
        "retained": [str(unit) for unit in area.retained],
        "ports": list(area.ports.buses),
        "states": len(area.area.state_index),
        "order": area.bases.order,
        "bound": area.bases.bound,
        "hankel_singular_values": None if values is None else values.tolist(),
    }
