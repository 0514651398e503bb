"""IEEEVC of PSS/E: the exciter sees a voltage beyond, or before, the terminals of its machine.

PSS/E Model Library, IEEEVC; IEEE Std 421.5, load compensation. With the current I out of the
machine, in per unit of its base,

    VCT = | V + (RC + j XC) I |

XC above 0 lets the voltage droop with reactive power, XC below 0 makes up for the drop of a transformer
or line. From V conj(I) = P + j Q,

    VCT^2 = V^2 + 2 (RC P + XC Q) + (RC^2 + XC^2) I^2,    I^2 = (P^2 + Q^2) / V^2.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gridfold.dynamics.blocks import higher
from gridfold.dynamics.device import Bound, Device, Parameter, Role, Scaling, Values

RC, XC, BASE_SPEED = range(3)
VT, P, Q, ID, IQ = range(5)
VCT = 0

#: Numbers of the dynamics record.
DYR_COLUMNS: tuple[str | None, ...] = ("compensating_resistance", "compensating_reactance")


def output(x, u, p, y, dx):
    """The compensated voltage."""
    for i in range(p.shape[1]):
        along = p[RC, i] * u[P, i] + p[XC, i] * u[Q, i]
        current = u[ID, i] * u[ID, i] + u[IQ, i] * u[IQ, i]
        size = p[RC, i] * p[RC, i] + p[XC, i] * p[XC, i]
        squared = u[VT, i] * u[VT, i] + 2 * along + size * current
        y[VCT, i] = np.sqrt(higher(squared, 0.0 * squared))


def guess(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """Nothing is unknown."""
    return {}


IEEEVC = Device(
    model="ieeevc",
    title="voltage compensator IEEEVC",
    role=Role.COMPENSATOR,
    parameters=(
        Parameter("compensating_resistance", "RC", "p.u.", Bound.ANY, Scaling.IMPEDANCE),
        Parameter("compensating_reactance", "XC", "p.u.", Bound.ANY, Scaling.IMPEDANCE),
    ),
    states=(),
    inputs=("terminal_voltage", "active_power", "reactive_power", "d_current", "q_current"),
    outputs=("compensated_voltage",),
    output=output,
    guess=guess,
    psse_record=DYR_COLUMNS,
)
