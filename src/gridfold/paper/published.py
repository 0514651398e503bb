"""The numbers that Osipov & Sun print, to stand beside ours.

Source: D. Osipov and K. Sun, "Adaptive Nonlinear Model Reduction for Fast Power System Simulation":
section III and Tables I to IV. Nothing here is computed, and nothing is used in a computation but the
thresholds, and the clearing times where they are asked for.
"""

from __future__ import annotations

from typing import NamedTuple

SOURCE = "Osipov & Sun, Adaptive Nonlinear Model Reduction for Fast Power System Simulation"

#: The study area: the New England region.
STUDY_BUSES = range(1, 37)

# Section III.A.
GENERATORS = 48
EXTERNAL_GENERATORS = 39
EXTERNAL_STATES = 351
NONLINEAR_FUNCTIONS = 156
LINEARIZED_FUNCTIONS = 136
NONLINEAR_FUNCTIONS_WHOLE = 192
#: Nonlinear functions of each generator: the paper counts the last four of its nine states.
FUNCTIONS_PER_GENERATOR = 4
#: States kept at the bound below: the text truncates 200 of 351.
ORDER = 151
HANKEL_BOUND = 1e-5

COLUMN_NORM = 1.0
ANGLE_PARTITIONED_DEG = 67.0
ANGLE_WHOLE_DEG = 6.0
#: Largest root mean square error of a rotor angle for which the thresholds are chosen.
LARGEST_ERROR_DEG = 6.0
T_END = 16.0
TIME_STEP = 0.01


class Errors(NamedTuple):
    """An error by model: linear, adaptive partitioned, adaptive unpartitioned."""

    linear: float
    adaptive_partitioned: float
    adaptive_whole: float


class Table1Row(NamedTuple):
    """Bus, bus of the worst generator, critical clearing time (s), rotor-angle errors (degrees)."""

    bus: int
    generator: int
    cct: float
    errors: Errors


def _row(bus: int, generator: int, cct: float, *errors: float) -> Table1Row:
    return Table1Row(bus, generator, cct, Errors(*errors))


#: Table I by faulted bus.
TABLE_1 = {
    row.bus: row
    for row in (
        _row(1, 26, 0.13, 8.85, 1.33, 1.06),
        _row(2, 26, 0.13, 3.10, 0.86, 0.57),
        _row(3, 23, 0.39, 25.94, 5.51, 5.12),
        _row(4, 26, 0.12, 1.50, 0.75, 0.41),
        _row(5, 23, 0.09, 0.59, 0.48, 0.29),
        _row(6, 23, 0.08, 0.72, 0.60, 0.30),
        _row(7, 26, 0.05, 0.28, 0.28, 0.47),
        _row(8, 23, 0.05, 4.87, 4.41, 0.29),
        _row(9, 26, 0.06, 3.26, 2.83, 0.29),
        _row(10, 26, 0.13, 10.49, 2.90, 1.26),
        _row(11, 23, 0.19, 8.81, 1.40, 1.46),
        _row(12, 23, 0.10, 1.89, 0.98, 0.44),
        _row(13, 23, 0.12, 2.57, 0.97, 0.49),
        _row(14, 23, 0.13, 2.83, 1.00, 0.51),
        _row(15, 23, 0.07, 0.38, 0.38, 0.33),
        _row(16, 23, 0.05, 0.87, 0.78, 0.31),
        _row(17, 26, 0.03, 0.30, 0.30, 0.59),
        _row(18, 23, 0.04, 0.33, 0.33, 0.66),
        _row(19, 26, 0.03, 0.11, 0.11, 0.95),
        _row(20, 26, 0.03, 0.27, 0.27, 1.05),
        _row(21, 23, 0.22, 12.97, 1.65, 1.89),
        _row(22, 23, 0.19, 6.55, 1.32, 1.06),
        _row(23, 23, 0.20, 3.83, 1.07, 0.71),
        _row(24, 23, 0.18, 5.66, 1.46, 0.91),
        _row(25, 23, 0.22, 20.45, 2.22, 3.87),
        _row(26, 26, 0.03, 0.35, 0.34, 0.86),
        _row(27, 23, 0.10, 0.29, 0.27, 0.46),
        _row(28, 26, 0.12, 0.28, 0.30, 0.42),
        _row(29, 23, 0.06, 3.15, 3.48, 0.43),
        _row(30, 23, 0.06, 1.21, 1.35, 0.38),
        _row(31, 23, 0.08, 0.40, 0.43, 0.25),
        _row(32, 26, 0.11, 1.25, 0.79, 0.42),
        _row(33, 26, 0.11, 1.05, 0.65, 0.39),
        _row(34, 23, 0.15, 3.79, 0.89, 0.63),
        _row(35, 26, 0.14, 3.14, 0.82, 0.52),
        _row(36, 23, 0.21, 4.03, 0.92, 0.61),
    )
}


class StateErrors(NamedTuple):
    """A row of Table II: state of gridfold, the paper's symbol, unit and errors by model."""

    state: str
    symbol: str
    unit: str
    errors: Errors


#: Bus of the generator of Table II; two machines stand there.
TABLE_2_BUS = 23
#: Table II: errors of the states of generator 23 after the fault at bus 3, in the paper's order.
TABLE_2 = (
    StateErrors("rotor_angle", "δ", "degrees", Errors(2.24e1, 5.5, 5.1)),
    StateErrors("mechanical_power", "Pm", "p.u.", Errors(1.8e-3, 4.1e-4, 3.4e-4)),
    StateErrors("governor_power", "Pgv", "p.u.", Errors(2.3e-2, 5.1e-3, 4.5e-3)),
    StateErrors("regulator_voltage", "VR", "p.u.", Errors(1.7e-1, 3.7e-2, 4.1e-2)),
    StateErrors("rate_feedback", "Rf", "p.u.", Errors(1.3e-2, 3.4e-3, 3.2e-3)),
    StateErrors("field_voltage", "Efd", "p.u.", Errors(9.8e-2, 2.2e-2, 2.3e-2)),
    StateErrors("d_transient_voltage", "E'd", "p.u.", Errors(6.9e-2, 1.4e-2, 1.5e-2)),
    StateErrors("q_transient_voltage", "E'q", "p.u.", Errors(1.1e-2, 2.8e-3, 2.6e-3)),
    StateErrors("speed", "ω", "p.u.", Errors(4.7e-3, 1.0e-3, 9.7e-4)),
)


class Times(NamedTuple):
    """Seconds a simulation by model, a column of Table III."""

    detailed: float
    linear: float
    adaptive_partitioned: float
    adaptive_whole: float


#: The faults of Table III.
LARGE_DISTURBANCE_BUS = 3
SMALL_DISTURBANCE_BUS = 17
#: Table III: fault at bus 3, fault at bus 17; the first two rows are printed once for both.
TABLE_3 = {"large": Times(3.7, 0.9, 1.6, 1.0), "small": Times(3.7, 0.9, 1.5, 0.6)}


class Table4Row(NamedTuple):
    """Rotor-angle errors in degrees after a fault: adaptive partitioned and unpartitioned."""

    fault: str
    adaptive_partitioned: float
    adaptive_whole: float


#: Table IV: the temporary fault, and those that lead to a new operating condition.
TABLE_4 = (
    Table4Row("temporary fault at bus 3", 5.51, 5.12),
    Table4Row("fault at line 3-2, line tripped", 5.48, 5.09),
    Table4Row("fault at line 3-4, line tripped", 5.28, 4.80),
    Table4Row("fault at bus 3, bus tripped", 2.74, 2.04),
)
