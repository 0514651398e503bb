"""Growth at the operating point, against all eigenvalues of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import one_machine_infinite_bus

import gridfold as gf
from gridfold.grid.case import Case
from gridfold.runs import unstable_start
from gridfold.runs.unstable_start import growing_mode, with_start_checked


def with_exciter(case: Case, unit: str, **parameters: float) -> Case:
    """The case with other parameters of one exciter, or of all with ``*``."""
    devices = tuple(
        replace(record, parameters={**record.parameters, **parameters})
        if record.model == "ieee_type1" and unit in ("*", str(record.key))
        else record
        for record in case.devices
    )
    return replace(case, devices=devices)


def rightmost(model: gf.DetailedModel) -> complex:
    """The rightmost eigenvalue, of all of them."""
    values = np.linalg.eigvals(model.jacobian(model.x0))
    value = values[np.argmax(values.real)]
    return complex(value.real, abs(value.imag))


def test_a_stable_start_says_nothing(npcc):
    assert abs(rightmost(npcc)) < 1e-6  # the angle that all machines share
    assert growing_mode(npcc) is None
    assert with_start_checked(npcc) is npcc


@pytest.mark.parametrize(
    ("unit", "change", "at_least"),
    [
        ("23:2", {"exciter_gain": -63.7}, 200.0),  # TE = 0.314 s: about 63.7 / 0.314 = 203 1/s
        ("23:2", {"exciter_gain": -1.3}, 0.5),
        ("23:2", {"exciter_gain": -5000.0}, 10_000.0),
        ("*", {"regulator_gain": 60.0, "feedback_gain": 0.0}, 0.1),  # pairs
    ],
)
def test_modes_that_grow_are_those_of_all_eigenvalues(npcc, unit, change, at_least):
    model = gf.build_model(with_exciter(npcc.case, unit, **change))
    expected, mode = rightmost(model), growing_mode(model)
    assert expected.real > at_least
    assert mode is not None
    assert mode.eigenvalue == pytest.approx(expected, rel=1e-4)
    if unit != "*":
        assert (mode.device, mode.state.partition(":")[2]) == ("ieee_type1", unit)


def test_small_models_are_looked_at_whole(npcc, monkeypatch):
    model = gf.build_model(with_exciter(npcc.case, "23:2", exciter_gain=-1.3))
    iterated = growing_mode(model)
    monkeypatch.setattr(unstable_start, "_DENSE", 10_000)
    whole = growing_mode(model)
    assert iterated is not None
    assert whole is not None
    assert whole.eigenvalue == pytest.approx(iterated.eigenvalue, rel=1e-5)
    assert whole.state == iterated.state


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_modes_on_the_axis_and_zeros_of_the_common_angle_do_not_grow(damping):
    case = one_machine_infinite_bus(damping)
    assert growing_mode(gf.build_model(case)) is None
    alone = (case.devices[0], replace(case.devices[0], bus=2))  # two machines: an angle in common
    assert growing_mode(gf.build_model(replace(case, devices=alone))) is None


def test_the_warning_tells_eigenvalue_place_and_pace(npcc):
    model = gf.build_model(with_exciter(npcc.case, "23:2", exciter_gain=-63.7))
    (text,) = with_start_checked(model).warnings
    assert text.startswith("the operating point is unstable: mode 202 1/s in field_voltage of ")
    assert text.endswith("ieee_type1 23:2 grows by itself, e-fold every 0.0049 s")
