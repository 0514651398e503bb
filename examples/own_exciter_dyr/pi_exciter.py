"""An exciter of one's own that answers PIAVR records of dynamics data.

    EFD = clip(X, VMIN, VMAX),  TA dX/dt = KP e + I - X,  dI/dt = KI e,
    e = VREF + VS - VT (mode 0),  e = VREF + VS - VT / (1 + s TR) (mode 1)

X and I are held within VMIN and VMAX.

    BUS 'PIAVR' ID  M  TR KP KI TA VMIN VMAX /
    BUS 'USRMDL' ID 'PIAVR' 4 0 1 6 3 0  M  TR KP KI TA VMIN VMAX /
"""

from gridfold.dynamics.blocks import clip, held, limited_lag
from gridfold.dynamics.checks import checks
from gridfold.dynamics.device import Bound, Device, Parameter, Role, limits, positions

PARAMETERS = (
    Parameter("mode", "M", "-", Bound.INTEGER),
    Parameter("measuring_time", "TR", "s"),
    Parameter("proportional_gain", "KP", "p.u."),
    Parameter("integral_gain", "KI", "p.u./s"),
    Parameter("exciter_time", "TA", "s"),
    Parameter("lowest", "VMIN", "p.u.", Bound.ANY),
    Parameter("highest", "VMAX", "p.u.", Bound.ANY, default=6.0),
)
SET_POINTS = ("voltage_reference",)
STATES = ("measured_voltage", "integral", "amplifier")
INPUTS = ("terminal_voltage", "stabilizer_signal")
OUTPUTS = ("field_voltage",)

P = positions(*PARAMETERS, *SET_POINTS, "base_speed")
X, U, Y = positions(*STATES), positions(*INPUTS), positions(*OUTPUTS)


def output(x, u, p, y, dx):
    """Field voltage; column i is one unit."""
    for i in range(x.shape[1]):
        y[Y.field_voltage, i] = clip(x[X.amplifier, i], p[P.lowest, i], p[P.highest, i])


def derivative(x, u, p, y, dx):
    """Filter, integrator and amplifier."""
    for i in range(x.shape[1]):
        low, high = p[P.lowest, i], p[P.highest, i]
        voltage = u[U.terminal_voltage, i]
        dx[X.measured_voltage, i] = (voltage - x[X.measured_voltage, i]) / p[P.measuring_time, i]
        if p[P.mode, i].real > 0:
            voltage = x[X.measured_voltage, i]
        error = p[P.voltage_reference, i] + u[U.stabilizer_signal, i] - voltage
        dx[X.integral, i] = held(p[P.integral_gain, i] * error, x[X.integral, i], low, high)
        wanted = p[P.proportional_gain, i] * error + x[X.integral, i]
        _, dx[X.amplifier, i] = limited_lag(
            wanted, x[X.amplifier, i], p[P.exciter_time, i], low, high
        )


PI_EXCITER = Device(
    model="pi_exciter",
    title="exciter with a proportional-integral regulator",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=SET_POINTS,
    states=STATES,
    inputs=INPUTS,
    outputs=OUTPUTS,
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    check=checks(PARAMETERS, ordered=[("lowest", "highest")]),
    limits=limits("lowest", "highest", "integral") + limits("lowest", "highest", "amplifier"),
    psse_names=("PIAVR",),
    psse_record=tuple(parameter.name for parameter in PARAMETERS),
    psse_icons=1,
)
