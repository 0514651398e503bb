"""REECB1 of PSS/E: electrical control of photovoltaic plants.

PSS/E Model Library, REECB1; WECC REMTF, REEC_B. It is the control that REECA1 has too
(:mod:`~gridfold.dynamics.converters.electrical`), with a voltage support that always acts.
"""

from __future__ import annotations

from gridfold.dynamics.checks import checks
from gridfold.dynamics.converters import electrical
from gridfold.dynamics.converters.electrical import (
    FILTERED,
    IP_COMMAND,
    IQ_COMMAND,
    MEASURED,
    ORDER,
    PREF,
    Q_CURRENT,
    Q_INTEGRAL,
    V_INTEGRAL,
    both_commands,
    measured_voltage,
    off_voltage,
    other_outputs,
    power_order_rate,
    reactive_reference,
    voltage_support,
)
from gridfold.dynamics.device import Device, Role

REFERENCE, TANGENT = 30, 31
#: A current that limits nothing.
FREE = 1e9

#: Numbers of the dynamics record; the remote bus of its first number is looked at elsewhere.
DYR_COLUMNS: tuple[str | None, ...] = (
    None, "power_factor_code", "voltage_code", "reactive_code", "priority_code",
    *(parameter.name for parameter in electrical.PARAMETERS[:25]),
)  # fmt: skip


def output(x, u, p, y, dx):
    """Both current commands."""
    for i in range(x.shape[1]):
        free = FREE + 0.0 * x[ORDER, i]
        wanted, _ = reactive_reference(x, u, p, i, p[TANGENT, i])
        injected = voltage_support(x, u, p, i, p[REFERENCE, i])
        y[IP_COMMAND, i], y[IQ_COMMAND, i], _, _, _ = both_commands(
            x, u, p, i, wanted, 0.0 * wanted, injected, free, free
        )
        other_outputs(x, u, p, y, i, p[REFERENCE, i], p[TANGENT, i], 1.0)


def derivative(x, u, p, y, dx):
    """Measurements always, all else but in a dip."""
    for i in range(x.shape[1]):
        free = FREE + 0.0 * x[ORDER, i]
        _, dx[FILTERED, i], _ = measured_voltage(x, u, p, i)
        wanted, dx[MEASURED, i] = reactive_reference(x, u, p, i, p[TANGENT, i])
        injected = voltage_support(x, u, p, i, p[REFERENCE, i])
        _, _, d_q, d_v, d_lag = both_commands(
            x, u, p, i, wanted, 0.0 * wanted, injected, free, free
        )
        moves = 0.0 if off_voltage(u, p, i) else 1.0
        dx[Q_INTEGRAL, i] = moves * d_q
        dx[V_INTEGRAL, i] = moves * d_v
        dx[Q_CURRENT, i] = moves * d_lag
        dx[ORDER, i] = moves * power_order_rate(x, u, p, i, u[PREF, i])


REECB1 = Device(
    model="reecb1",
    title="electrical control of photovoltaic plants REECB1",
    role=Role.ELECTRICAL_CONTROL,
    parameters=electrical.PARAMETERS,
    set_points=electrical.SET_POINTS,
    states=electrical.STATES,
    inputs=electrical.INPUTS,
    outputs=electrical.OUTPUTS,
    output=output,
    derivative=derivative,
    targets=electrical.TARGETS,
    solved_inputs=electrical.SOLVED_INPUTS,
    defaults=electrical.DEFAULTS,
    guess=electrical.guess,
    check=checks(electrical.PARAMETERS, ordered=electrical.ORDERED, more=[electrical.codes]),
    limits=electrical.LIMITS,
    psse_names=("REECB1", "REECBU1"),
    psse_record=DYR_COLUMNS,
    psse_icons=5,
    psse_measured=(0,),
)
