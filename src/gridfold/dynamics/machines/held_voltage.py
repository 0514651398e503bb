"""A fictitious generator of the lagged coupling: a boundary voltage that is held during a step.

It stands for a boundary bus of the other area (Osipov & Sun, section II.A), and in no case file.
"""

from __future__ import annotations

from gridfold.dynamics.device import Device, Role


def source(x, u, p, y, dx):
    """The held voltage itself, which the cut network takes for a source."""
    for i in range(p.shape[1]):
        y[0, i], y[1, i] = x[0, i], x[1, i]


def derivative(x, u, p, y, dx):
    """Nothing changes during a step."""
    for i in range(p.shape[1]):
        dx[0, i] = dx[1, i] = 0.0


HELD_VOLTAGE = Device(
    model="held_voltage",
    title="boundary voltage of the previous step",
    role=Role.MACHINE,
    parameters=(),
    states=("held_real", "held_imag"),
    inputs=(),
    sources=("source_real", "source_imag"),
    source=source,
    derivative=derivative,
)
