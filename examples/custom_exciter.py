"""An exciter of one's own on the NPCC system.

It has one gain and one lag: TA dEfd/dt = KA (Vref - Vt + Vs) - Efd. Run it with
``python examples/custom_exciter.py``.
"""

from dataclasses import replace

import gridfold as gf
from gridfold.dynamics.device import Device, Parameter, Role, positions

PARAMETERS = (Parameter("gain", "KA", "p.u."), Parameter("time_constant", "TA", "s"))
STATES = ("field_voltage",)
INPUTS = ("terminal_voltage", "stabilizer_signal")

P = positions(*PARAMETERS, "voltage_reference", "base_speed")  # rows of p
X = positions(*STATES)
U = positions(*INPUTS)


def derivative(x, u, p, y, dx):
    """Amplify the voltage error; column i is one unit."""
    for i in range(x.shape[1]):
        error = p[P.voltage_reference, i] - u[U.terminal_voltage, i] + u[U.stabilizer_signal, i]
        dx[X.field_voltage, i] = (p[P.gain, i] * error - x[X.field_voltage, i]) / p[
            P.time_constant, i
        ]


SIMPLE_EXCITER = Device(
    model="simple_exciter",
    title="first-order exciter",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=("voltage_reference",),
    states=STATES,
    inputs=INPUTS,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
)


def with_simple_exciters(case: gf.Case, gain: float = 20.0, time_constant: float = 0.2) -> gf.Case:
    """The case with a simple exciter in place of each IEEE type-1 exciter."""
    parameters = {"gain": gain, "time_constant": time_constant}
    devices = tuple(
        gf.DeviceRecord("simple_exciter", record.bus, record.id, parameters)
        if record.model == "ieee_type1"
        else record
        for record in case.devices
    )
    return replace(case, name=f"{case.name}, simple exciters", devices=devices)


def run() -> gf.Trajectory:
    """Simulate a fault at bus 3 with the simple exciters."""
    case = with_simple_exciters(gf.load_case("npcc"))
    model = gf.build_model(case, devices=SIMPLE_EXCITER)
    return gf.simulate(model, [gf.BusFault(3, start=0.0, duration=0.2)], t_end=16.0)


if __name__ == "__main__":
    result = run()
    print(result.status.advice)
    print(f"largest speed: {result.signal('speed').max():.4f} p.u.")
