"""First-order speed governor without limits: equations (1) of Osipov & Sun."""

from __future__ import annotations

from gridfold.dynamics.device import Device, Parameter, Role, Scaling

R, TGV, PREF, BASE_SPEED = range(4)
PGV = 0
OMEGA = 0


def derivative(x, u, p, y, dx):
    """Governor output power."""
    for i in range(x.shape[1]):
        demand = p[PREF, i] - (u[OMEGA, i] - 1.0) / p[R, i]
        dx[PGV, i] = (-x[PGV, i] + demand) / p[TGV, i]


FIRST_ORDER_GOVERNOR = Device(
    model="first_order_governor",
    title="first-order governor",
    role=Role.GOVERNOR,
    parameters=(
        Parameter("droop", "R", "p.u.", scaling=Scaling.IMPEDANCE),
        Parameter("governor_time", "Tgv", "s"),
    ),
    set_points=("power_reference",),
    states=("governor_power",),
    inputs=("speed",),
    derivative=derivative,
    targets=("governor_power",),
)
