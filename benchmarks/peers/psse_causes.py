"""What the differences from PSS/E come from: one thing changed in gridfold until they are gone.

The changes serve the comparison alone. Each device is the package's with one thing changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from beside_psse import EVENT, STUDIES, Difference, compare
from psse_rule import AdamsBashforth2
from report import Table

from gridfold.dynamics.blocks import lead_lag, limited_lag
from gridfold.dynamics.device import Device
from gridfold.dynamics.exciters import sexs
from gridfold.dynamics.exciters.sexs import SEXS
from gridfold.dynamics.machines import classical
from gridfold.dynamics.machines.gencls import GENCLS
from gridfold.numerics.steppers import Stepper

#: The step of PSS/E in s, as the samples at the events tell.
PSSE_STEP = 0.005
LATE = len(SEXS.states)


def late_field(x, u, p, y, dx):
    """Field voltage of SEXS by the terminal voltage of one step before."""
    for i in range(x.shape[1]):
        error = p[sexs.VREF, i] + u[sexs.VS, i] - x[LATE, i]
        ratio, lag_time = p[sexs.RATIO, i], p[sexs.TB, i]
        lead, _ = lead_lag(error, x[sexs.LEAD, i], ratio * lag_time, lag_time)
        y[sexs.EFD, i], _ = limited_lag(
            p[sexs.K, i] * lead, x[sexs.VE, i], p[sexs.TE, i], p[sexs.EMIN, i], p[sexs.EMAX, i]
        )


def late_rates(x, u, p, y, dx):
    """As SEXS; a lag of one step stands for the voltage before."""
    for i in range(x.shape[1]):
        error = p[sexs.VREF, i] + u[sexs.VS, i] - u[sexs.VT, i]
        ratio, lag_time = p[sexs.RATIO, i], p[sexs.TB, i]
        lead, dx[sexs.LEAD, i] = lead_lag(error, x[sexs.LEAD, i], ratio * lag_time, lag_time)
        _, dx[sexs.VE, i] = limited_lag(
            p[sexs.K, i] * lead, x[sexs.VE, i], p[sexs.TE, i], p[sexs.EMIN, i], p[sexs.EMAX, i]
        )
        dx[LATE, i] = (u[sexs.VT, i] - x[LATE, i]) / PSSE_STEP


def swing_by_power(x, u, p, y, dx):
    """As the classical machine, but mechanical power and damping are divided by the speed."""
    for i in range(x.shape[1]):
        speed = x[classical.OMEGA, i]
        dx[classical.DELTA, i] = p[classical.BASE_SPEED, i] * (speed - 1)
        torque = (u[classical.PM, i] - p[classical.D, i] * (speed - 1)) / speed
        dx[classical.OMEGA, i] = (torque - y[classical.PE, i]) / (2 * p[classical.H, i])


LATE_SEXS = replace(
    SEXS,
    states=(*SEXS.states, "late_voltage"),
    output=late_field,
    derivative=late_rates,
    guess=lambda p, known: {
        "exciter_voltage": known["field_voltage"],
        "late_voltage": known["terminal_voltage"],
    },
    replaces_built_in=True,
)

#: PowerWorld documents this swing equation for all of its machines.
GENCLS_BY_POWER = replace(GENCLS, derivative=swing_by_power, replaces_built_in=True)


@dataclass(frozen=True)
class Cause:
    """Something in which gridfold is changed, and the cases in which that is tried."""

    words: str
    cases: tuple[str, ...]
    changed: tuple[Device, ...] = ()
    stepper: Stepper | None = None


CAUSES = (
    Cause(
        "PSS/E's rule and step",
        (
            "genrou", "genrou_s10_zero", "sexs", "hygov", "ieeest", "stab1", "load_power",
            "regca1_reference_flag",
        ),
        stepper=AdamsBashforth2(PSSE_STEP),
    ),
    Cause("SEXS without TE sees the voltage one step late", ("sexs_te_zero",), (LATE_SEXS,)),
    Cause("GENCLS divides power by speed, as PowerWorld", ("degov",), (GENCLS_BY_POWER,)),
)  # fmt: skip


def cause_table(found: dict[str, tuple[Difference, ...]]) -> Table:
    """For each cause the worst column of its cases, as is and with the change."""
    rows = []
    for cause in CAUSES:
        for name in cause.cases:
            changed = compare(STUDIES[name], cause.changed, cause.stepper)
            k = int(np.argmax([one.largest / one.allowed for one in found[name]]))
            before, after = found[name][k], changed[k]
            rows.append(
                (cause.words, name, before.column, f"{before.largest:.1e}", f"{after.largest:.1e}")
            )
    return Table(
        "The column that is nearest to its limit, or furthest beyond it, and the same with one thing "
        "changed in gridfold:",
        ("changed", "case", "column", "difference", "then"),
        rows,
    )


# EXST1 alone, driven by PSS/E's own terminal voltage.

#: How late it sees the voltage, s; seconds from which the voltage has no jump behind it.
DELAYS, SETTLED, FINE = (0.0, 0.5 * PSSE_STEP, PSSE_STEP), 0.4, 2e-4


def exciter_table(found: dict[str, tuple[Difference, ...]]) -> Table:
    """Field voltage of EXST1 by its equations and the terminal voltage that PSS/E gives."""
    columns = {one.column: one for one in found["exst1"]}
    field, voltage = columns["field_voltage:2:1"], columns["voltage_pu:2"]
    rows = []
    for delay in DELAYS:
        times, alone = _regulator(voltage, field.reference[0], delay)
        later = (field.times > EVENT + SETTLED) & (field.times < times[-1])
        free = later & (field.reference < 5.9 * voltage.reference)
        error = np.interp(field.times[free], times, alone) - field.reference[free]
        rows.append((f"{delay * 1e3:g} ms", f"{np.abs(error).max():.3f}"))
    return Table(
        "EXST1 alone, driven by the terminal voltage of PSS/E: largest difference of the field voltage "
        f"below its ceiling from {SETTLED:g} s after the event on, when the exciter sees the voltage "
        "late by",
        ("delay", "difference, p.u."),
        rows,
    )


def _regulator(voltage: Difference, field: float, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """VA = 200 / (1 + 0.1 s) (1 + 10 s) / (1 + 20 s) (VREF - VT / (1 + 0.01 s)), the case's numbers."""
    after = np.unique(voltage.times, return_index=True)[1]
    after = after[voltage.times[after] > EVENT + 1e-5]
    times = EVENT + FINE * np.arange(round(4.0 / FINE))
    seen = np.interp(times - delay, voltage.times[after], voltage.reference[after])
    measured, slow, out = voltage.reference[0], field / 200, field
    reference = measured + slow
    found = np.empty_like(times)
    for k, now in enumerate(seen):
        found[k] = out
        error = reference - measured
        out += FINE * (200 * (0.5 * error + 0.5 * slow) - out) / 0.1
        slow += FINE * (error - slow) / 20
        measured += FINE * (now - measured) / 0.01
    return times, found
