"""Trajectories of PSS/E itself: three buses, a branch trip or a step of a voltage reference.

They are skipped where the folder of public cases is not at hand. What is beyond the common limits has a
cause that the page "Beside PSS/E" tells.
"""

from __future__ import annotations

import pytest
from beside_psse import STUDIES, Difference, compare, reference_path

#: Closer than the common limits: PSS/E's rotor speeds, in p.u.
CLOSER = {"slip": 5e-6}

#: Beyond the common limits, by case and kind of column; parts of the range where they are so said.
BEYOND = {
    # without a time constant the field voltage follows at once, in PSS/E one step of 5 ms later
    ("sexs_te_zero", "field_voltage"): 0.004,
    # the exciter of PSS/E sees the voltage half a step late
    ("exst1", "voltage_pu"): 3e-4,
    ("exst1", "slip"): 5e-5,
    # PSS/E's own step
    ("regca1_reference_flag", "voltage_pu"): 3e-4,
    # PowerWorld divides the mechanical power of GENCLS by the speed
    ("degov", "speed_pu"): 9e-5,
}


def bound(one: Difference) -> float:
    return BEYOND.get((one.case, one.kind), CLOSER.get(one.kind, one.allowed))


@pytest.mark.parametrize("name", STUDIES)
def test_trajectory_is_that_of_psse(name):
    if not reference_path(name).is_file():
        pytest.skip("GRIDFOLD_CASES names no folder of public cases")
    for one in compare(STUDIES[name]):
        assert one.largest <= bound(one), one.column
