"""Rules that carry x' = f(x) forward in time, all behind one contract."""

from gridfold.numerics.steppers.abm4 import AdamsBashforthMoulton4
from gridfold.numerics.steppers.base import Integration, Stepper, time_grid
from gridfold.numerics.steppers.rk4 import RungeKutta4
from gridfold.numerics.steppers.scipy_reference import ScipyReference
from gridfold.numerics.steppers.trapezoidal import ImplicitTrapezoidal

__all__ = [
    "AdamsBashforthMoulton4",
    "ImplicitTrapezoidal",
    "Integration",
    "RungeKutta4",
    "ScipyReference",
    "Stepper",
    "time_grid",
]
