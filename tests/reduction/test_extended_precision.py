"""Hankel singular values of the external area of NPCC against a list in extended precision.

The list and its origin: ``npcc_hankel_values.csv``, written by ``benchmarks/hankel_reference.py``.
"""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gridfold.partition import linearize_external, partition
from gridfold.reduction import BalancedTruncation

STORED = Path(__file__).with_name("npcc_hankel_values.csv")
TOLERANCE = 1e-5


@pytest.fixture(scope="module")
def stored():
    table = pd.read_csv(STORED, comment="#")
    np.testing.assert_array_equal(table["number"], np.arange(1, 352))
    return table["value"].to_numpy()


@pytest.fixture(scope="module")
def computed(npcc):
    system = linearize_external(partition(npcc, range(1, 37))).system
    return BalancedTruncation(tolerance=TOLERANCE).reduce(system, np.zeros(system.n))


def test_all_hankel_values_are_those_in_extended_precision(computed, stored):
    assert len(computed.hankel_values) == 351
    scale = stored[0]
    np.testing.assert_allclose(computed.hankel_values, stored, rtol=0, atol=1e-10 * scale)


def test_order_is_the_one_that_exact_values_give(computed, stored):
    bounds = 2 * np.append(np.cumsum(stored[::-1])[::-1], 0.0)  # of the orders 0, 1, ..., 351
    order = int(np.argmax(bounds <= TOLERANCE))
    assert (computed.order, computed.kept_exactly) == (order, 0) == (149, 0)
    np.testing.assert_allclose(computed.bound, bounds[order], rtol=1e-6)


def test_stored_values_fall_and_end_in_zeros(stored):
    positive = stored[stored > 0]
    assert (np.diff(positive) < 0).all()
    np.testing.assert_array_equal(stored[len(positive) :], 0)


def test_stored_list_names_its_command_and_date():
    lines = STORED.read_text(encoding="utf-8").splitlines()
    remarks = [line.removeprefix("# ").partition(": ") for line in lines if line.startswith("# ")]
    header = {key: text for key, _, text in remarks}
    assert header["Command"] == "python benchmarks/hankel_reference.py"
    assert datetime.date.fromisoformat(header["Date"]).year >= 2025
