"""Folded areas with buses that branches without impedance join, and with dc lines."""

from dataclasses import replace

import numpy as np
import pytest

import gridfold as gf
from gridfold.equivalents.families import Mode
from gridfold.errors import OptionError
from gridfold.grid.dc_lines import DcControl, TransistorEnd, TransistorLine
from gridfold.partition.port_area import interface_weights, linearize_ports
from gridfold.partition.ports import Ports

SHORT = ("branch 38-37:1", "branch 39-37:1", "branch 40-37:1")
#: From the external area into the study area.
LINE = TransistorLine(
    "V",
    True,
    0.5,
    TransistorEnd(45, DcControl.VOLTAGE, 150.0),
    TransistorEnd(10, DcControl.POWER, 60.0, power_factor=0.95),
)
ALWAYS = gf.SwitchingRule(0.0, limits=False)


def folded_run(reactance, event, lines=()):
    """A run on the folded NPCC system with three lines at bus 37 that have this reactance."""
    case = gf.load_case("npcc")
    branches = tuple(
        replace(b, resistance=0.0, reactance=reactance) if str(b) in SHORT else b
        for b in case.branches
    )
    model = gf.build_model(replace(case, branches=branches, dc_lines=lines))
    parts = gf.partition(model, range(1, 37))
    run = gf.simulate_adaptive(model, gf.fold(parts), ALWAYS, [event], 1.5)
    assert run.modes[-1] is not Mode.DETAILED
    return run.trajectory, gf.simulate(model, [event], 1.5)


def test_a_folded_run_is_that_with_hardly_an_impedance():
    """Bus 37 is a port, and 38 to 40 are joined to it."""
    event = gf.BusFault(3, 0.1, 0.1)
    joined, near = (folded_run(x, event)[0] for x in (0.0, 1e-6))
    np.testing.assert_array_equal(joined.times, near.times)
    np.testing.assert_allclose(joined.rotor_angle_deg(), near.rotor_angle_deg(), atol=1e-3)
    np.testing.assert_allclose(joined.bus_voltage(), near.bus_voltage(), atol=1e-5)


def test_a_folded_run_follows_a_dc_line_between_the_areas():
    folded, detailed = folded_run(1e-3, gf.BusFault(3, 0.1, 0.1), (LINE,))
    study = [unit for unit in detailed.model.machines if unit.bus <= 36]
    errors = gf.compare(detailed, folded, tuple(study)).units
    assert max(error.rms_deg for error in errors) < 0.5


def test_ports_that_are_one_node_are_refused_in_words():
    case = gf.load_case("npcc")
    coupler = gf.Branch(37, 74, "K")
    model = gf.build_model(replace(case, branches=(*case.branches, coupler)))
    units = tuple(unit for unit in model.machines if unit.bus > 36)
    ports = Ports((37, 74), frozenset({38, 39, 40}), units, frozenset(range(1, 37)))
    with pytest.raises(OptionError, match="buses 37 and 74 are ports of one area, and a branch"):
        linearize_ports(ports, model, model.x0, interface_weights(model, ports))
