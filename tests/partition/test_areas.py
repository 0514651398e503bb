from __future__ import annotations

from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.errors import OptionError
from gridfold.partition import partition, study_buses


def ends(case: gf.Case, parts) -> list[tuple[int, int]]:
    return [(tie.study_bus, tie.external_bus) for tie in parts.tie_lines]


def test_npcc_is_divided_as_in_the_paper(npcc, parts):
    assert sorted(ends(npcc.case, parts)) == [(29, 37), (35, 73)]
    assert sorted(parts.boundary_buses) == [29, 35]
    assert [str(unit) for unit in parts.study_units] == [
        "21:1", "22:1", "23:1", "23:2", "24:1", "25:1", "26:1", "27:1", "36:1",
    ]  # fmt: skip
    assert len(parts.external_units) == 39
    assert len(parts.states_of(parts.external_units)) == 351


def test_the_states_of_both_areas_are_all_states_once(npcc, parts):
    inside, outside = parts.states_of(parts.study_units), parts.states_of(parts.external_units)
    assert sorted(inside + outside) == list(range(npcc.n_states))
    bus = {k: int(name.split(":")[1]) for k, name in enumerate(npcc.state_names)}
    assert {bus[k] for k in inside} <= parts.study_buses
    assert {bus[k] for k in outside}.isdisjoint(parts.study_buses)


def test_a_tie_line_knows_its_branch_and_which_end_is_whose(npcc, parts):
    for tie in parts.tie_lines:
        branch = npcc.case.branches[tie.branch]
        assert {branch.from_bus, branch.to_bus} == {tie.study_bus, tie.external_bus}
        assert tie.study_bus in parts.study_buses
        assert tie.external_bus not in parts.study_buses


@pytest.mark.parametrize("study", [range(37, 141), [23, 12], [*range(1, 37), 78, 133, 134], [78]])
def test_any_set_of_buses_with_a_machine_is_a_study_area(npcc, study):
    parts = partition(npcc, study)
    inside = set(study)
    crossing = {
        k
        for k, branch in enumerate(npcc.case.branches)
        if (branch.from_bus in inside) is not (branch.to_bus in inside)
    }
    assert {tie.branch for tie in parts.tie_lines} == crossing
    assert {unit.bus for unit in parts.study_units} <= inside
    assert set(parts.study_units) | set(parts.external_units) == set(npcc.machines)
    assert not set(parts.study_units) & set(parts.external_units)


def test_areas_and_zones_stand_for_their_buses(npcc):
    case = npcc.case
    buses = tuple(replace(bus, zone=7 if bus.number in (3, 99) else 1) for bus in case.buses)
    zoned = replace(case, buses=buses)
    first = {bus.number for bus in case.buses if bus.area == 1}
    assert 0 < len(first) < len(case.buses)
    assert study_buses(zoned, areas=[1]) == first
    assert study_buses(zoned, zones=[7]) == {3, 99}
    assert study_buses(zoned, buses=[140], areas=[1], zones=[7]) == first | {3, 99, 140}


def test_what_is_not_in_the_case_is_named(npcc):
    with pytest.raises(OptionError, match="no bus 999"):
        partition(npcc, [1, 999])
    with pytest.raises(OptionError, match="no area 98"):
        study_buses(npcc.case, areas=[98])
    with pytest.raises(OptionError, match="no zone 97"):
        study_buses(npcc.case, zones=[97])


def test_an_empty_study_area_is_refused(npcc):
    with pytest.raises(OptionError, match="empty"):
        partition(npcc, [])


def test_an_area_without_a_machine_is_refused(npcc):
    every = [bus.number for bus in npcc.case.buses]
    with pytest.raises(OptionError, match="study area has no machine"):
        partition(npcc, [3])
    with pytest.raises(OptionError, match="external area has no machine"):
        partition(npcc, every)


def test_areas_that_nothing_joins_are_refused(npcc):
    case = npcc.case
    branches = tuple(
        replace(b, in_service=False) if {b.from_bus, b.to_bus} in ({29, 37}, {35, 73}) else b
        for b in case.branches
    )
    assert sum(not b.in_service for b in branches) == 2
    state = npcc.state
    out = frozenset(k for k, b in enumerate(branches) if not b.in_service)
    apart = npcc.for_state(replace(state, branches_out=state.branches_out | out))
    with pytest.raises(OptionError, match="no tie line"):
        partition(apart, range(1, 37))
