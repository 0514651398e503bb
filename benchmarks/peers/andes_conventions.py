"""gridfold's devices with the conventions of ANDES, where those differ from PSS/E's.

They serve the comparison alone: with them, what is left between the two programs is numerical. Each is
the package's device with one thing changed. ANDES describes its models itself (its function ``doc``),
PSS/E's are in the PSS/E Model Library.
"""

from __future__ import annotations

from dataclasses import replace

from gridfold.dynamics.device import Device
from gridfold.dynamics.exciters import ieeex1
from gridfold.dynamics.exciters.exdc2 import EXDC2
from gridfold.dynamics.exciters.ieeex1 import IEEEX1
from gridfold.dynamics.machines import genrou
from gridfold.dynamics.machines.genrou import GENROU
from gridfold.numerics.compiled import compiled_part

SPEED = len(IEEEX1.inputs)
FIELD = len(IEEEX1.outputs)

_rates_of_psse = compiled_part(genrou.derivative)
_start_condition = compiled_part(ieeex1.output)


def torque_derivative(x, u, p, y, dx):
    """As GENROU, but the turbine gives a torque, and the damping is one: no division by speed."""
    _rates_of_psse(x, u, p, y, dx)
    for i in range(x.shape[1]):
        torque = y[genrou.PSI_D, i] * y[genrou.IQ, i] - y[genrou.PSI_Q, i] * y[genrou.ID, i]
        damping = p[genrou.D, i] * (x[genrou.OMEGA, i] - 1)
        dx[genrou.OMEGA, i] = (u[genrou.PM, i] - torque - damping) / (2 * p[genrou.H, i])


def field_times_speed(x, u, p, y, dx):
    """The exciter's voltage times the speed of the machine is the field voltage."""
    _start_condition(x, u, p, y, dx)
    for i in range(x.shape[1]):
        y[FIELD, i] = u[SPEED, i] * x[ieeex1.EFD, i]


#: Mechanical torque where PSS/E has mechanical power.
TORQUE_GENROU = replace(GENROU, derivative=torque_derivative, replaces_built_in=True)

#: Limits of the regulator that do not follow the terminal voltage: PSS/E has them in IEEEX1.
FIXED_EXDC2 = replace(IEEEX1, model=EXDC2.model, replaces_built_in=True)

#: Fixed limits, and a field voltage in proportion to the speed.
SPEEDY_EXDC2 = replace(
    FIXED_EXDC2,
    states=(*IEEEX1.states[:-1], "exciter_voltage"),
    inputs=(*IEEEX1.inputs, "speed"),
    outputs=(*IEEEX1.outputs, "field_voltage"),
    output=field_times_speed,
)

#: What is as in ANDES: each line adds to those before it.
CONVENTIONS: dict[str, tuple[Device, ...]] = {
    "nothing": (),
    "torque in GENROU": (TORQUE_GENROU,),
    "+ fixed limits in EXDC2": (TORQUE_GENROU, FIXED_EXDC2),
    "+ speed in EXDC2": (TORQUE_GENROU, SPEEDY_EXDC2),
}
