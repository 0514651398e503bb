from __future__ import annotations

from pathlib import Path

import pytest

from gridfold.dynamics.registry import DEVICES
from gridfold.equivalents import warm_up as module
from gridfold.equivalents.choice import ModelSettings
from gridfold.equivalents.model_kind import ModelKind
from gridfold.equivalents.warm_up import warm_up


@pytest.fixture
def few(monkeypatch):
    """One device and one small model, so that it is quick."""
    monkeypatch.setattr(module, "DEVICES", {"two_axis": DEVICES["two_axis"]})
    monkeypatch.setattr(module, "_REDUCED", (ModelSettings(ModelKind.PAPER_WHOLE),))


def test_all_kernels_and_every_way_to_simulate_are_compiled():
    kernels = [
        kernel
        for device in DEVICES.values()
        for kernel in (device.source, device.output, device.derivative)
        if kernel is not None
    ]
    assert len(list(module._steps())) == 3 * len(kernels) + 1 + len(module._REDUCED)
    assert {settings.kind for settings in module._REDUCED} == {
        ModelKind.ADAPTIVE, ModelKind.WHOLE, ModelKind.PAPER, ModelKind.PAPER_WHOLE,
    }  # fmt: skip


def test_it_says_where_the_code_is_and_how_much(few):
    seen = []
    done = warm_up(lambda step, total: seen.append((step, total)))
    assert seen == [(k + 1, len(seen)) for k in range(len(seen))]
    assert seen[-1][0] == seen[-1][1]
    assert done.functions == len(list(Path(done.folder).glob("*.machine"))) > 0
    assert not done.temporary
