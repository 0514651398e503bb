"""What compiled code is going to read is checked first: it never reads beyond the end of an array."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.dynamics.area_model import LinearArea
from gridfold.numerics.band_watch import BandWatch
from gridfold.numerics.modal_form import modal_form
from gridfold.numerics.steppers.base import time_grid
from gridfold.numerics.watch import BoxWatch, SpreadWatch
from gridfold.systems.dense import DenseSystem
from gridfold.systems.modal import ModalSystem

STEPPERS = (gf.RungeKutta4(), gf.AdamsBashforthMoulton4(), gf.ImplicitTrapezoidal())
A = np.array([[-1.0, 2.0, 0.0], [-2.0, -1.0, 0.0], [0.0, 0.0, -3.0]])


@pytest.fixture(scope="module")
def system():
    return DenseSystem(A, np.zeros(3)).compiled


@pytest.fixture(scope="module")
def modes():
    form = modal_form(A)
    assert form is not None
    return ModalSystem(form, np.zeros(3))


@pytest.mark.parametrize("wrong", [np.zeros(2), np.zeros(4), np.zeros((2, 3)), 1.0, np.zeros(0)])
@pytest.mark.parametrize("stepper", STEPPERS, ids=lambda stepper: stepper.name)
def test_a_state_of_another_length_is_refused(system, stepper, wrong):
    with pytest.raises((gf.OptionError, ValueError)):
        stepper.integrate(system, time_grid(0.0, 1.0, 0.01), wrong)
    with pytest.raises((gf.OptionError, ValueError)):
        system(wrong)


@pytest.mark.parametrize("places", [[-1], [10**6], [0.5]])
def test_places_outside_of_the_scratch_space_are_refused(system, places):
    with pytest.raises(gf.OptionError, match="scratch space"):
        system.work_along(np.zeros((1, 3)), np.array(places))


@pytest.mark.parametrize("stepper", STEPPERS, ids=lambda stepper: stepper.name)
@pytest.mark.parametrize(
    "watch",
    [
        SpreadWatch(np.array([3]), np.array([0]), np.ones(1), np.zeros(1), 1.0),
        BandWatch(np.eye(4), np.zeros(4), 1.0),
        BoxWatch(np.eye(4), np.zeros(4), np.ones(4)),
    ],
)
def test_a_watch_of_a_larger_system_is_refused(system, stepper, watch):
    with pytest.raises(gf.OptionError, match="reads 4 states of a system with 3"):
        stepper.integrate(system, time_grid(0.0, 1.0, 0.01), np.zeros(3), [watch])


@pytest.mark.parametrize(
    ("index", "group", "weight"),
    [([-1], [0], [1.0]), ([0], [1], [1.0]), ([0], [-1], [1.0]), ([0, 1], [0], [1.0]),
     ([0], [0], [1.0, 2.0]), ([0.0], [0], [1.0])],
)  # fmt: skip
def test_a_watch_whose_positions_do_not_fit_is_refused(index, group, weight):
    with pytest.raises(gf.OptionError, match="watch"):
        SpreadWatch(np.array(index), np.array(group), np.array(weight), np.zeros(1), 1.0)


@pytest.mark.parametrize("partner", [[0, 1, 3], [-1, 1, 2], [1, 2, 0], [0, 1], [0.0, 1.0, 2.0]])
def test_partners_that_are_none_are_refused(modes, partner):
    with pytest.raises(gf.OptionError, match="partner"):
        replace(modes.form, partner=np.array(partner))


def test_modes_are_asked_for_states_of_their_length_only(modes):
    times = np.array([0.1, 0.2])
    assert modes.states_after(np.ones(3), times).shape == (2, 3)
    for start, out in ((np.ones(2), None), (np.ones(3), np.zeros((1, 3))), (np.ones(4), None)):
        with pytest.raises(gf.OptionError, match="states of shape"):
            modes.states_after(start, times, out)
    with pytest.raises(gf.OptionError, match="rows of shape"):
        modes.reach(np.ones(3), 1.0, np.eye(2))
    with pytest.raises(gf.OptionError, match="offset has shape"):
        replace(modes, offset=np.zeros(2))


def _wrong(value):
    """Neighbours of an array: shorter, longer, flat or with one more axis."""
    yield value[:-1]
    yield np.concatenate([value, value[-1:]])
    yield value[None]


@pytest.fixture(scope="module")
def area(npcc, npcc_parts) -> LinearArea:
    return gf.reduce(npcc_parts, gf.BalancedTruncation(order=60)).area


@pytest.mark.parametrize("name", ["index", "a", "partners", "b", "input_reference", "drift"])
def test_arrays_of_a_linear_area_that_do_not_fit_each_other_are_refused(area, name):
    assert name in {field.name for field in fields(area)}
    for value in _wrong(getattr(area, name)):
        with pytest.raises((gf.OptionError, ValueError)):
            replace(area, **{name: value})


def test_positions_of_a_linear_area_outside_of_the_system_are_refused(area, npcc):
    from gridfold.dynamics.area_model import build_area_model

    for place in (-1, npcc.n_states, 2**40):
        index = area.index.copy()
        index[3] = place
        with pytest.raises(gf.OptionError, match="linear area"):
            build_area_model(npcc, replace(area, index=index))


@pytest.mark.parametrize("name", ["diagonal", "b", "offset", "c", "current", "voltage", "turned"])
def test_arrays_of_an_area_behind_ports_that_do_not_fit_each_other_are_refused(npcc_linear, name):
    ports = npcc_linear.linear_ports
    for value in _wrong(getattr(ports, name)):
        with pytest.raises((gf.OptionError, ValueError)):
            replace(ports, **{name: value})


def test_states_of_a_model_have_its_length(npcc):
    for wrong in (np.zeros(npcc.n_states - 1), np.zeros(npcc.n_states + 1), np.zeros(1)):
        for function in (npcc.compiled, npcc.partials, npcc.jacobian):
            with pytest.raises(gf.OptionError, match="a state has shape"):
                function(wrong)
        for function in (npcc.signals, npcc.bus_voltages, npcc.terminal_voltages):
            with pytest.raises(gf.OptionError, match="a state has shape"):
                function(wrong[None, :])
