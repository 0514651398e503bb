"""Port models side by side give the derivatives that each gives alone."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.batch.ports import batch_ports
from gridfold.dynamics.port_model import PortModel
from gridfold.equivalents.families import Mode
from gridfold.equivalents.folded import FoldedArea, fold
from gridfold.equivalents.model_kind import Weights
from gridfold.reduction import Unreduced
from gridfold.runs.loading import load_psse

ROOT = Path(__file__).parents[2]
CASES = Path(os.environ.get("GRIDFOLD_CASES", ROOT / ".." / "shared" / "data"))


def same_derivatives(system: PortModel, members: int) -> None:
    start = system.restrict(system.parts.model.x0)
    spread = np.random.default_rng(3).standard_normal((len(start), members))
    states = start[:, None] + 0.03 * spread
    alone = np.column_stack([system.compiled(column) for column in states.T])
    found = batch_ports(system.parts, members)(states.ravel()).reshape(states.shape)
    np.testing.assert_allclose(found, alone, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("members", [8, 16])
def test_members_have_the_derivatives_that_they_have_alone(
    npcc: gf.DetailedModel, npcc_retained: FoldedArea, members: int
) -> None:
    small = npcc_retained.build(Mode.RETAINED, npcc)
    assert isinstance(small.system, PortModel)
    same_derivatives(small.system, members)


def test_an_infinite_bus_is_no_exception(
    npcc: gf.DetailedModel,
) -> None:
    case = npcc.case
    devices = tuple(device for device in case.devices if device.bus != 78)
    source = gf.DeviceRecord("infinite_bus", 78, "1", {"reactance": 0.05})
    model = gf.build_model(replace(case, devices=(*devices, source)))
    parts = gf.partition(model, range(1, 37))
    kept = [unit for unit in parts.external_units if unit.bus in (42, 50)]
    area = fold(parts, kept, Unreduced(), Weights.STATES)
    small = area.build(Mode.RETAINED, model)
    assert isinstance(small.system, PortModel)
    same_derivatives(small.system, 8)


def test_prime_movers_of_linear_machines_may_be_exact() -> None:
    raw, dyr = CASES / "ieee39/IEEE39.raw", CASES / "ieee39/IEEE39.dyr"
    if not (raw.is_file() and dyr.is_file()):
        pytest.skip(f"{raw} is absent; GRIDFOLD_CASES names the folder of public cases")
    case = load_psse(raw, dyr, unsupported="drop", allow_unsupported_network=True).case
    devices = tuple(record for record in case.devices if record.model != "ieel")
    impedances = gf.LoadModel((0.0, 0.0, 1.0))
    model = gf.build_model(replace(case, devices=devices), loads=impedances)
    parts = gf.partition(model, (15, 16, 19, 20, 21, 22, 23, 24, 33, 34, 35, 36))
    area = fold(parts, (), Unreduced())
    assert area.governed
    small = area.build(Mode.LINEAR, model)
    assert isinstance(small.system, PortModel)
    same_derivatives(small.system, 8)
