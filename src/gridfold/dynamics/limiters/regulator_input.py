"""What an exciter gets where its unit has limiters of excitation: the sum of stabilizer and limiters.

It stands in no case file: a unit with a limiter has it.
"""

from __future__ import annotations

from gridfold.dynamics.device import Device, Role


def output(x, u, p, y, dx):
    """The sum."""
    for i in range(p.shape[1]):
        y[0, i] = u[0, i] + u[1, i] + u[2, i]


REGULATOR_INPUT = Device(
    model="regulator_input",
    title="sum of stabilizer and limiters",
    role=Role.REGULATOR_INPUT,
    parameters=(),
    states=(),
    inputs=("stabilizer_signal", "overexcitation_signal", "underexcitation_signal"),
    outputs=("regulator_signal",),
    output=output,
    defaults={
        "stabilizer_signal": 0.0,
        "overexcitation_signal": 0.0,
        "underexcitation_signal": 0.0,
    },
)
