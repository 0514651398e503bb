from __future__ import annotations

import sys

import numpy as np
import pytest
from linear_systems import random_stable

from gridfold.errors import OptionError
from gridfold.reduction.interop import to_control, to_pymor
from gridfold.systems import LinearSystem


@pytest.fixture
def system():
    full = random_stable(6, 3, 2, 1)
    names = (("a", "b", "c"), ("u", "v"), ("y",))
    return LinearSystem(full.a, full.b, full.c, [[0.5, 0.0]], *names)


@pytest.mark.filterwarnings("ignore")
def test_control_system_has_the_same_transfer_and_names(system):
    pytest.importorskip("control", reason="python-control is not installed; extra 'interop'")
    converted = to_control(system)
    np.testing.assert_allclose(converted(2j), system.transfer(2j)[0], rtol=1e-12)
    assert converted.state_labels == ["a", "b", "c"]
    assert converted.input_labels == ["u", "v"]
    assert converted.output_labels == ["y"]


@pytest.mark.filterwarnings("ignore")
def test_control_system_keeps_states_that_do_nothing():
    pytest.importorskip("control", reason="python-control is not installed; extra 'interop'")
    idle = LinearSystem(np.diag([-1.0, 0.0]), [[1.0], [0.0]], [[1.0, 0.0]])
    assert to_control(idle).nstates == 2


@pytest.mark.filterwarnings("ignore")
def test_pymor_model_has_the_same_transfer(system):
    pytest.importorskip("pymor", reason="pyMOR is not installed; extra 'interop'")
    converted = to_pymor(system).transfer_function.eval_tf(2j)
    np.testing.assert_allclose(converted, system.transfer(2j)[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("convert", "module", "package"),
    [(to_control, "control", "python-control"), (to_pymor, "pymor.models.iosys", "pyMOR")],
)
def test_missing_package_is_named_with_the_extra(monkeypatch, system, convert, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(OptionError, match=rf"{package} is not installed.*gridfold\[interop\]"):
        convert(system)
