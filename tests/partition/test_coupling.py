from __future__ import annotations

import numpy as np
import pytest
from area_cases import external_admittance

import gridfold as gf
from gridfold.errors import OptionError
from gridfold.partition import couple, partition
from gridfold.partition.coupling import external_network


@pytest.fixture(scope="module")
def coupling(parts):
    return couple(parts)


def test_the_column_norms_of_npcc_are_those_of_the_study_area_side(coupling):
    norms = dict(zip((unit.bus for unit in coupling.units), coupling.norms, strict=True))
    largest = sorted(norms.items(), key=lambda item: -item[1])[:6]
    assert [(bus, round(float(norm), 2)) for bus, norm in largest] == [
        (78, 17.05), (42, 1.99), (50, 1.20), (134, 1.11), (51, 1.07), (133, 0.61),
    ]  # fmt: skip


def test_one_per_unit_keeps_the_five_generators_of_the_paper_and_takes_bus_123_as_reference(
    coupling,
):
    assert [unit.bus for unit in coupling.kept(1.0)] == [42, 50, 51, 78, 134]
    assert coupling.reference == gf.UnitKey(123, "1")
    # Four functions a machine: 156 of the external area, of which 34 machines' are linear.
    assert 4 * len(coupling.units) == 156
    assert 4 * (len(coupling.units) - 5) == 136


def test_the_threshold_is_inclusive_and_0_keeps_all(coupling):
    assert coupling.kept(0.0) == coupling.units
    assert coupling.kept(float(coupling.norms.max())) != ()
    assert coupling.kept(float("inf")) == ()
    with pytest.raises(OptionError, match="-1"):
        coupling.kept(-1.0)


def test_1_per_unit_on_100_mva_is_a_quarter_siemens_at_20_kv(coupling):
    assert coupling.siemens(1.0) == 0.25
    assert coupling.per_unit(0.25) == 1.0
    assert coupling.per_unit(coupling.siemens(0.37)) == pytest.approx(0.37, rel=1e-14)


@pytest.mark.parametrize("study", [range(1, 37), range(37, 141), [*range(1, 37), 78, 133, 134]])
def test_the_norms_equal_those_of_a_dense_reduction_written_out(npcc, study):
    parts = partition(npcc, study)
    m = len(parts.external_units)
    rows = external_admittance(parts)[m:, :m]
    expected = np.sqrt((np.abs(rows) ** 2).sum(axis=0))
    np.testing.assert_allclose(couple(parts).norms, expected, rtol=1e-9, atol=1e-12)


def test_the_external_network_gives_the_terminal_voltages_of_the_whole(npcc, parts):
    x = npcc.x0 + 0.1 * np.random.default_rng(3).standard_normal(npcc.n_states)
    signals = npcc.signals(x[None, :])
    voltages = npcc.bus_voltages(x[None, :])[0]
    currents = {
        unit: signals[0, real] + 1j * signals[0, imag]
        for (real, imag, _), unit in zip(npcc.layout.sources, npcc.layout.source_units, strict=True)
    }
    index = npcc.case.bus_index
    network = external_network(parts)
    boundary = voltages[[index[bus] for bus in parts.boundary_buses]]
    injected = np.array([currents[unit] for unit in parts.external_units])
    expected = voltages[[index[unit.bus] for unit in parts.external_units]]
    found = network.impedance @ injected + network.transfer @ boundary
    np.testing.assert_allclose(found, expected, atol=1e-11)
