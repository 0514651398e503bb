import time
from dataclasses import replace

import pytest

import gridfold as gf
from gridfold.grid.number_ranges import Numbered, lies_in, numbers_in, parse_ranges


@pytest.fixture
def sparse():
    """A case with gaps in its numbers."""
    buses = [gf.Bus(n, area=n // 100, zone=1) for n in (101, 105, 230, 999)]
    return gf.Case("sparse", tuple(buses), (), ())


def test_a_range_stands_for_the_numbers_of_the_case_in_it(sparse):
    assert numbers_in(sparse, "100-300") == [101, 105, 230]
    assert numbers_in(sparse, "999,101-105,101") == [999, 101, 105]
    assert numbers_in(sparse, "1-2", "areas", Numbered.AREA) == [1, 2]
    assert numbers_in(sparse, "1", "zones", Numbered.ZONE) == [1]


@pytest.mark.parametrize("text", ["1-99999999", "0-999999999999999999"])
def test_a_long_range_takes_no_longer(sparse, text):
    began = time.perf_counter()
    assert numbers_in(sparse, text) == [101, 105, 230, 999]
    assert time.perf_counter() - began < 0.1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("102", "there is no bus 102 in case sparse"),
        ("106-229", "there is no bus in the range 106-229 in case sparse"),
        ("101,7", "there is no bus 7"),
        ("9-3", "ends before it starts"),
        ("-3", "are given as 3,7 or 1-36"),
        ("", "are given as"),
        ("1,,2", "are given as"),
        ("1e3", "are given as"),
        ("nan", "are given as"),
        ("٣", "are given as"),
        ("9" * 4000, "are given as"),
    ],
)
def test_what_names_nothing_is_refused_in_a_short_message(sparse, text, said):
    with pytest.raises(gf.OptionError, match=said) as caught:
        numbers_in(sparse, text)
    assert len(str(caught.value)) < 250


def test_ranges_need_no_case():
    assert parse_ranges("3, 5-9") == (range(3, 4), range(5, 10))
    assert lies_in(7, parse_ranges("3,5-9"))
    assert not lies_in(4, parse_ranges("3,5-9"))


def test_checking_many_islands_takes_time_in_proportion(sparse):
    """Twice the islands took four times the time: 400,000 of them, hours."""
    buses = tuple(gf.Bus(n) for n in range(1, 20001))
    slack = gf.Generator(1, "1", active_mw=1.0, control=gf.Control.SLACK)
    case = replace(sparse, buses=buses, generators=(slack,))
    began = time.perf_counter()
    faults = gf.validate_case(case)
    assert len(faults) == 19999
    assert faults[0] == "the island of bus 2 (1 buses) has no generator in service"
    assert time.perf_counter() - began < 10.0
