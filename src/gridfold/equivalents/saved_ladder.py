"""Keep folded areas in a file: what they are projected on. All else is made anew from the case."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.equivalents.area_bases import Bases
from gridfold.equivalents.families import Mode
from gridfold.equivalents.fit import Fit
from gridfold.equivalents.folded import FoldedArea, on_bases
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import Outputs
from gridfold.grid.case import UnitKey
from gridfold.partition import Partition, partition
from gridfold.partition.ports import find_ports
from gridfold.reduction import Reducer

_PARTS = ("lift", "restrict", "weights", "input_weights", "hankel")


def ladder_header(family: Ladder) -> dict[str, Any]:
    """What a file says of a ladder, beside the case and the reducer."""
    return {
        "outputs": Outputs.POLAR.value,
        "whole": family.whole,
        "areas": [
            {
                "retained": [list(unit) for unit in area.retained],
                "bound": area.bases.bound,
                "miss": area.bases.miss,
            }
            for area in family.areas
        ],
        "step_seconds": {mode.value: value for mode, value in family.step_seconds.items()},
        "light_limits": {mode.value: value for mode, value in family.light_limits.items()},
        **({} if family.fit is None else {"fit": family.fit.record()}),
    }


def ladder_arrays(family: Ladder) -> dict[str, NDArray[Any]]:
    """The bases of each area, and the operating point that they belong to."""
    arrays: dict[str, NDArray[Any]] = {
        "x0": family.origin,
        "state_names": np.array(family.parts.model.state_names, dtype=np.str_),
    }
    for k, area in enumerate(family.areas):
        bases = area.bases
        values = np.zeros(0) if bases.hankel_values is None else bases.hankel_values
        arrays |= dict(
            zip(
                _names(k),
                (bases.lift, bases.restrict, bases.weights, bases.input_weights, values),
                strict=True,
            )
        )
    return arrays


def build_ladder(
    header: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    model: DetailedModel,
    reducer: Reducer,
) -> Ladder:
    """The ladder of a file, for `model`.

    Raises
    ------
    LookupError, TypeError, ValueError
        Something is missing, or has another type, shape or range than it should.
    """
    parts = partition(model, header["study_buses"])
    areas = tuple(
        _area(parts, record, [arrays[name] for name in _names(k)], reducer)
        for k, record in enumerate(header["areas"])
    )
    if not areas:
        raise ValueError("there is no area")
    seconds = {Mode(name): float(value) for name, value in header["step_seconds"].items()}
    light = {Mode(name): float(value) for name, value in header["light_limits"].items()}
    fit = Fit.of_record(header["fit"]) if "fit" in header else None
    family = Ladder(areas, bool(header["whole"]), seconds, light, fit=fit)
    if seconds and set(seconds) != {Mode.DETAILED, *family.rungs}:
        raise ValueError("step_seconds does not name the rungs")
    if not set(light) <= set(family.rungs):
        raise ValueError("light_limits names what is no rung")
    return family


def _area(
    parts: Partition,
    record: Mapping[str, Any],
    arrays: list[NDArray[Any]],
    reducer: Reducer,
) -> FoldedArea:
    retained = tuple(UnitKey(int(bus), str(name)) for bus, name in record["retained"])
    strange = set(retained) - set(parts.external_units)
    if strange:
        raise ValueError(f"{min(strange)} is retained and not in the external area")
    linear = [unit for unit in parts.external_units if unit not in set(retained)]
    ports = find_ports(parts.model, linear, parts.study_buses)
    lift, restrict, weights, swings, hankel = arrays
    n, p = len(lift), 2 * len(ports.buses)
    for name, array in (("weights", weights), ("input_weights", swings)):
        if len(array) != p and not (array is swings and not len(array)):
            raise ValueError(f"{name} has {len(array)} rows, expected {p}")
    bound = None if record["bound"] is None else float(record["bound"])
    values, miss = hankel if len(hankel) else None, float(record["miss"])
    bases = Bases(lift, restrict, weights, swings, miss, values, bound)
    area = on_bases(parts, retained, ports, reducer, bases)
    if len(area.area.x0) != n:
        raise ValueError(f"lift has {n} rows, expected {len(area.area.x0)}")
    return area


def _names(k: int) -> list[str]:
    return [f"area{k}_{part}" for part in _PARTS]
