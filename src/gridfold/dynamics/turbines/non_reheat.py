"""Steam turbine without reheat: equations (1) of Osipov & Sun."""

from __future__ import annotations

from gridfold.dynamics.device import Device, Parameter, Role

TCH, BASE_SPEED = range(2)
PM = 0
PGV = 0


def derivative(x, u, p, y, dx):
    """Mechanical power follows the governor through the steam chest."""
    for i in range(x.shape[1]):
        dx[PM, i] = (-x[PM, i] + u[PGV, i]) / p[TCH, i]


NON_REHEAT_TURBINE = Device(
    model="non_reheat_turbine",
    title="non-reheat steam turbine",
    role=Role.TURBINE,
    parameters=(Parameter("charging_time", "Tch", "s"),),
    states=("mechanical_power",),
    inputs=("governor_power",),
    derivative=derivative,
    targets=("mechanical_power",),
    solved_inputs=("governor_power",),
)
