"""Reactors of lines and magnetizing branches come and go with their branch.

Voltages are compared with those of an admittance matrix put together here from the numbers in the file:
two machines behind their reactances, loads as admittances at the start, no use of gridfold's branches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from raw_texts import LINES, TRANSFORMERS, raw_text, with_field

import gridfold as gf
from gridfold.grid.network_state import BranchFaultPoint, NetworkState

DYR = "1 'GENCLS' 1 4.5 0.0 /\n2 'GENCLS' 1 4.0 0.0 /\n"
MACHINES = {1: 250.0, 2: 200.0}  # bus and MVA; ZSORCE is 0.25 p.u. of these
BASE = 100.0
TRANSFORMER_LINES = {"1-3": 0, "2-5": 4}


@dataclass(frozen=True)
class Element:
    """A branch by what the file says: buses, impedance, charging, ratio, admittances at the ends."""

    first: int
    second: int
    z: complex
    b: float = 0.0
    ratio: float = 1.0
    at_first: complex = 0j
    at_second: complex = 0j


ELEMENTS = {
    "3-4:1": Element(3, 4, 0.01 + 0.08j, 0.04),
    "3-4:2": Element(3, 4, 0.011 + 0.085j, 0.04),
    "4-5": Element(4, 5, 0.008 + 0.06j, 0.03),
    "3-5": Element(3, 5, 0.012 + 0.1j, 0.05),
    "1-3": Element(1, 3, 0.05j, ratio=1.03),
    "2-5": Element(2, 5, 0.06j, ratio=0.98),
}
ENDS = {  # branch, fields of its first line, and what they are at the ends
    "BI": ("3-5", {9: "0", 10: "-0.5"}, -0.5j, 0j),
    "GI": ("3-5", {9: "0.2"}, 0.2 + 0j, 0j),
    "BJ": ("3-5", {12: "-0.5"}, 0j, -0.5j),
    "GJ": ("4-5", {11: "0.1"}, 0j, 0.1 + 0j),
    "all four": ("4-5", {9: "0.05", 10: "0.3", 11: "0.02", 12: "-0.4"}, 0.05 + 0.3j, 0.02 - 0.4j),
    "capacitors": ("3-4:2", {10: "0.2", 12: "0.2"}, 0.2j, 0.2j),
    "MAG1, MAG2": ("2-5", {7: "0.01", 8: "-0.15"}, 0.01 - 0.15j, 0j),
    "MAG2 behind a ratio": ("1-3", {8: "-0.2"}, -0.2j, 0j),
}


def changed(name, status=None):
    """Sections of the file with the ends of a branch, and the elements that belong to them."""
    branch, fields, at_first, at_second = ENDS[name]
    elements = ELEMENTS | {
        branch: replace(ELEMENTS[branch], at_first=at_first, at_second=at_second)
    }
    lines, transformers = list(LINES), list(TRANSFORMERS)
    records, at = (lines, [*ELEMENTS].index(branch))
    if branch in TRANSFORMER_LINES:
        records, at = transformers, TRANSFORMER_LINES[branch]
    for position, value in {**fields, **(status or {})}.items():
        records[at] = with_field(records[at], position, value)
    return branch, elements, {"BRANCH": lines, "TRANSFORMER": transformers}


def build(sections, tmp_path):
    raw, dyr = tmp_path / "ends.raw", tmp_path / "ends.dyr"
    raw.write_text(raw_text(sections))
    dyr.write_text(DYR)
    return gf.build_model(gf.load_case(raw, dyr))


def place(model, branch):
    ends, _, circuit = branch.partition(":")
    names = [str(b).removeprefix("branch ") for b in model.case.branches]
    return names.index(f"{ends}:{circuit or '1'}")


def stamp(y, element):
    """Add an element between rows of the buses less one."""
    i, j = element.first - 1, element.second - 1
    series, half = 1 / element.z, 0.5j * element.b
    y[i, i] += (series + half) / element.ratio**2 + element.at_first
    y[j, j] += series + half + element.at_second
    y[i, j] -= series / element.ratio
    y[j, i] -= series / element.ratio


def voltages(model, elements, grounded=()):
    """Bus voltages with these elements, from the machines and loads at the start."""
    flow = model.power_flow
    size = max(max(e.first, e.second) for e in elements)
    y = np.zeros((size, size), dtype=complex)
    current = np.zeros(size, dtype=complex)
    for element in elements:
        stamp(y, element)
    for bus, load in ((4, 180 + 50j), (5, 90 + 25j)):
        y[bus - 1, bus - 1] += np.conj(load / BASE) / abs(flow.voltage[bus - 1]) ** 2
    for (bus, mva), power in zip(MACHINES.items(), flow.unit_power, strict=True):
        own = 1 / (0.25j * BASE / mva)
        voltage = flow.voltage[bus - 1]
        y[bus - 1, bus - 1] += own
        current[bus - 1] = own * voltage + np.conj(power / voltage)
    kept = [k for k in range(size) if k + 1 not in grounded]
    solved = np.zeros(size, dtype=complex)
    solved[kept] = np.linalg.solve(y[np.ix_(kept, kept)], current[kept])
    return solved[:5]


def in_state(model, state):
    return model.for_state(state).bus_voltages(model.x0[None, :])[0]


@pytest.mark.parametrize("name", ENDS)
def test_the_ends_are_there_at_the_start_and_go_with_a_trip(name, tmp_path):
    branch, elements, sections = changed(name)
    model = build(sections, tmp_path)
    np.testing.assert_allclose(
        voltages(model, elements.values()), model.power_flow.voltage, atol=1e-9
    )
    rest = [element for key, element in elements.items() if key != branch]
    out = NetworkState(branches_out=frozenset({place(model, branch)}))
    np.testing.assert_allclose(in_state(model, out), voltages(model, rest), atol=1e-10)


@pytest.mark.parametrize("name", [n for n in ENDS if ENDS[n][0] not in TRANSFORMER_LINES])
def test_the_ends_come_with_a_line_that_is_closed(name, tmp_path):
    branch, elements, sections = changed(name, status={13: "0"})
    model = build(sections, tmp_path)
    rest = [element for key, element in elements.items() if key != branch]
    np.testing.assert_allclose(voltages(model, rest), model.power_flow.voltage, atol=1e-9)
    np.testing.assert_allclose(
        in_state(model, NetworkState()), voltages(model, elements.values()), atol=1e-10
    )


@pytest.mark.parametrize("fraction", [0.25, 0.9])
@pytest.mark.parametrize("name", ["BI", "GJ", "all four", "MAG1, MAG2", "MAG2 behind a ratio"])
@pytest.mark.parametrize("impedance", [0j, 0.01 + 0.02j])
def test_a_fault_inside_a_branch_leaves_the_ends_where_they_are(
    name, fraction, impedance, tmp_path
):
    branch, elements, sections = changed(name)
    model = build(sections, tmp_path)
    whole = elements.pop(branch)
    near = replace(whole, second=6, z=whole.z * fraction, b=whole.b * fraction, at_second=0j)
    far = replace(
        whole, first=6, z=whole.z * (1 - fraction), b=whole.b * (1 - fraction), ratio=1, at_first=0j
    )
    parts = [*elements.values(), near, far]
    if impedance:
        parts.append(Element(5, 6, 1e12, at_second=1 / impedance))
    expected = voltages(model, parts, grounded=() if impedance else (6,))
    point = BranchFaultPoint(place(model, branch), fraction, impedance)
    state = NetworkState(branch_faults=frozenset({point}))
    np.testing.assert_allclose(in_state(model, state), expected, atol=1e-9)


def test_a_tripped_line_takes_its_reactor_with_it_in_a_run(tmp_path):
    """The town's voltage is 0.984 p.u. after the trip; with the reactor left it was 0.949."""
    _, _, sections = changed("BI")
    model = build(sections, tmp_path)
    run = gf.simulate(model, [gf.BranchTrip("3-5", 0.1)], t_end=0.2)
    town = np.abs(run.bus_voltage([4])[:, 0])
    assert town[0] == pytest.approx(0.954, abs=1e-3)
    assert town[-1] == pytest.approx(0.984, abs=1e-3)


def test_the_magnetizing_branch_of_three_windings_goes_with_its_first_winding(tmp_path):
    lines = ("3,5,4,'T',1,1,1,0.02,-0.3", "0.0,0.2,100,0.0,0.3,100,0.0,0.4,100", "/", "/", "/")
    model = build({"TRANSFORMER": (*TRANSFORMERS, *lines)}, tmp_path)
    legs = [
        Element(3, 6, 0.15j, at_first=0.02 - 0.3j), Element(5, 6, 0.05j), Element(4, 6, 0.25j)
    ]  # fmt: skip
    others = [*ELEMENTS.values()]
    np.testing.assert_allclose(
        model.power_flow.voltage[:5], voltages(model, [*others, *legs]), atol=1e-9
    )
    first = NetworkState(branches_out=frozenset({place(model, "3-6:T")}))
    expected = voltages(model, [*others, *legs[1:]])
    np.testing.assert_allclose(in_state(model, first)[:5], expected, atol=1e-10)


def test_a_case_folder_has_the_ends_as_columns(tmp_path):
    folder = tmp_path / "ends"
    folder.mkdir()
    (folder / "case.toml").write_text('name = "ends"\n')
    (folder / "buses.csv").write_text("number\n1\n2\n")
    (folder / "generators.csv").write_text("bus,control\n1,slack\n")
    (folder / "branches.csv").write_text(
        "from_bus,to_bus,reactance,from_conductance,from_susceptance,to_conductance,to_susceptance\n"
        "1,2,0.1,0.01,-0.2,0.03,0.4\n"
    )
    y = gf.grid.admittance.bus_admittance(gf.load_case(folder)).toarray()
    np.testing.assert_allclose(
        y, [[-10j + 0.01 - 0.2j, 10j], [10j, -10j + 0.03 + 0.4j]], atol=1e-14
    )
