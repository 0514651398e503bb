"""The contract of a dynamic device.

A device model is one file: its parameters, states, inputs and outputs by name, and up to three
kernels over all its units at once. All kernels have one signature,

    kernel(x, u, p, y, dx)

with matrices of shape (rows, units): states `x`, inputs `u`, parameters `p`, algebraic outputs `y`,
derivatives `dx`. A kernel indexes them by row and unit, ``x[ROW, i]``. They are called in three stages:

1. ``source``      x, p       -> the first rows of y: the Norton current, and what is worth keeping;
2. ``output``      x, u, p, y -> the other rows of y (the network voltages are known now);
3. ``derivative``  x, u, p, y -> dx.

Only machines and devices of loads have a source. A kernel is plain Python over floats that is
compiled twice, for real and for complex numbers: the complex one gives the Jacobian, so no derivative
is ever coded by hand.
Comparisons in a kernel must therefore use ``.real``. Start values are found by Newton's method on the
same kernels: no equation is written twice.

Signals are joined by name among the devices of one unit: an input is taken from the state or output of
that name of another device of the same unit. A device with the input ``name_before`` and the output
``name`` stands between those that give and those that take that signal; compensators and limiters of
excitation stand between others (:func:`taken`).
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum, IntEnum
from functools import cache, cached_property
from hashlib import sha256
from keyword import iskeyword
from types import FunctionType
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from gridfold.cards import Card, first_few
from gridfold.errors import DeviceError
from gridfold.numerics.code_digest import code_digest
from gridfold.numerics.code_files import package_name
from gridfold.numerics.compiled import compile_callback, invoke, jit
from gridfold.numerics.products import with_products
from gridfold.numerics.unit_matrix import ROLES, UnitMatrix, unit_matrix
from gridfold.numerics.vector_code import vector_code

Matrix = NDArray[np.float64] | NDArray[np.complex128]
Kernel = Callable[[Any, Any, Any, Any, Any], None]
Values = Mapping[str, NDArray[np.float64]]


class Role(IntEnum):
    """What a device is; the order is that in which outputs are evaluated."""

    MACHINE = 0
    LOAD = 1
    COMPENSATOR = 2
    STABILIZER = 3
    OVEREXCITATION_LIMITER = 4
    UNDEREXCITATION_LIMITER = 5
    REGULATOR_INPUT = 6
    EXCITER = 7
    GOVERNOR = 8
    TURBINE = 9
    PLANT_CONTROL = 10
    TORQUE_CONTROL = 11
    ELECTRICAL_CONTROL = 12
    PITCH_CONTROL = 13
    AERODYNAMICS = 14
    DRIVE_TRAIN = 15


#: What belongs to a converter: it takes the place of a machine.
CONVERTER_ROLES = (
    Role.ELECTRICAL_CONTROL,
    Role.TORQUE_CONTROL,
    Role.PLANT_CONTROL,
    Role.DRIVE_TRAIN,
    Role.AERODYNAMICS,
    Role.PITCH_CONTROL,
)

#: Start values follow the demand: the machine says which field voltage and power it needs, and so on.
START_ORDER = (
    Role.MACHINE,
    Role.LOAD,
    Role.COMPENSATOR,
    Role.OVEREXCITATION_LIMITER,
    Role.UNDEREXCITATION_LIMITER,
    Role.REGULATOR_INPUT,
    Role.EXCITER,
    Role.TURBINE,
    Role.GOVERNOR,
    Role.STABILIZER,
    *CONVERTER_ROLES,
)


class Scaling(Enum):
    """How a parameter on the generator's own base is converted to the system base."""

    NONE = 0
    POWER = 1
    IMPEDANCE = -1


class Bound(Enum):
    """Range of a parameter."""

    ANY = "any finite number"
    NOT_NEGATIVE = "0 or more"
    POSITIVE = "positive"
    INTEGER = "a whole number"

    def holds(self, value: float) -> bool:
        """Whether `value` is in the range."""
        if not np.isfinite(value):
            return False
        if self is Bound.INTEGER:
            return float(value).is_integer()
        return self is Bound.ANY or value > 0 or (value == 0 and self is Bound.NOT_NEGATIVE)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a device model: name in files, symbol in the docs, unit, range, default."""

    name: str
    symbol: str
    unit: str
    bound: Bound = Bound.POSITIVE
    scaling: Scaling = Scaling.NONE
    default: float | None = None


class Side(Enum):
    """Which way a limit holds."""

    LOWEST = -1
    HIGHEST = 1


@dataclass(frozen=True)
class Limit:
    """A parameter that limits something; `state` is named where it limits a state directly.

    Where the parameter is an addition to another one, that is `added_to`.
    """

    parameter: str
    side: Side
    state: str | None = None
    added_to: str | None = None


def limits(lowest: str, highest: str, state: str | None = None) -> tuple[Limit, Limit]:
    """The pair of limits of one quantity."""
    return Limit(lowest, Side.LOWEST, state), Limit(highest, Side.HIGHEST, state)


def positions(*names: str | Parameter) -> Any:
    """Rows by name: ``X = positions(*STATES)``, then ``x[X.field_voltage, i]``.

    Kernels index their matrices by them, so that names and rows cannot part. What is returned is also
    a tuple of numbers, 0, 1, 2 ..., in the order of `names`.

    Raises
    ------
    DeviceError
        A name is given twice, or cannot be one in Python.
    """
    texts = [name.name if isinstance(name, Parameter) else name for name in names]
    wrong = [text for text in texts if not text.isidentifier() or iskeyword(text) or text[0] == "_"]
    if wrong or len(set(texts)) < len(texts):
        listed = ", ".join(repr(t) for t in wrong or (t for t in texts if texts.count(t) > 1))
        why = "no name of a row" if wrong else "there more than once"
        raise DeviceError(f"positions of a device's rows: {why}: {listed}")
    return namedtuple("positions", texts)(*range(len(texts)))


#: Limiters of excitation, whose signals are added to that of the stabilizer.
LIMITERS = (Role.OVEREXCITATION_LIMITER, Role.UNDEREXCITATION_LIMITER)
#: What an exciter takes in the place of a signal where its unit has it: a compensator stands between
#: the terminals and the exciter, limiters of excitation between the stabilizer and the exciter.
BETWEEN = {"terminal_voltage": "compensated_voltage", "stabilizer_signal": "regulator_signal"}
#: What feeds an exciter from the terminals is their voltage, whatever the exciter measures.
ALIASES = {"supply_voltage": "terminal_voltage"}


#: Terms of a load's voltage dependence: an exponent, and its weights in active and reactive power.
Terms = tuple[tuple[float, complex], ...]


def as_given(parameters: Mapping[str, float], base_mva: float) -> Mapping[str, float]:
    """No value of a parameter stands for a rule."""
    return parameters


def nothing_foreseen(p: Values, known: Mapping[str, Any]) -> Mapping[str, Any]:
    """No signal is decided before the others are found."""
    return {}


def always(parameters: Mapping[str, float]) -> bool:
    """Every unit has states or outputs."""
    return True


def no_faults(parameters: Mapping[str, float]) -> Iterable[str]:
    """Parameters need no check beyond their ranges."""
    return ()


@dataclass(frozen=True, repr=False)
class Device(Card):
    """A device model.

    Parameters
    ----------
    model : str
        Name in case files.
    title : str
        Name for people.
    role : Role
        What it is.
    parameters : tuple of Parameter
        Rows of `p`, in order; after them come `set_points` and the base speed in rad/s.
    set_points : tuple of str
        Constants that the start decides, such as a voltage reference.
    states : tuple of str
        Rows of `x`.
    inputs : tuple of str
        Rows of `u`. A machine's inputs ``voltage_real`` and ``voltage_imag`` come from the network.
    sources, outputs : tuple of str
        Rows of `y`: those that the source kernel fills, then those that the output kernel fills. A
        source kernel's first two are the real and imaginary part of the Norton current.
    source, output, derivative : callable, optional
        The kernels.
    admittance : callable, optional
        Norton admittance in per unit, from the parameters, shape (units,).
    targets : tuple of str
        States or outputs whose start value is prescribed by the power flow or by other devices.
    solved_inputs : tuple of str
        Inputs that the start decides; together with `set_points` as many as `targets`.
    defaults : mapping
        Value of an input that no device provides.
    guess : callable
        First guess of unknowns by name from parameters and known signals; 0 where it is silent.
    foresee : callable
        Signals of its unit that it decides at the start before any other, from parameters and the
        operating point; for example the speed that belongs to a power.
    resolve : callable
        Parameters of one unit as they act, from those given and its base in MVA: where a value stands
        for a rule, such as a limit of 0 for one that follows from others.
    check : callable
        Faults of one unit's parameters as they act, beyond their ranges.
    limits : tuple of Limit
        Parameters that are limits. The start is found without them, and then compared with them.
    rating : callable, optional
        Of a device of a load: its base in MVA from its parameters and the power of the load in MW.
    characteristic : callable, optional
        Of a device of a load: how the power that the network draws there depends on the voltage.
    has_dynamics : callable
        Whether parameters of one unit need the kernels at all.
    psse_record : tuple of str or None
        Parameters in the order of its PSS/E record, behind bus, model and id; None is not used.
    psse_measured : tuple of int
        Positions in that record of the numbers of buses at which it measures: 0, or its own.
    psse_names : tuple of str
        Model names of the records that it answers; its own in capitals where none are given.
    psse_icons : int
        How many values of the record are ICONs, which come first and are whole numbers.
    replaces_built_in : bool
        Whether it may stand in the place of a model of the package that has its name or answers its
        records. That is told with every result.
    """

    model: str
    title: str
    role: Role
    parameters: tuple[Parameter, ...]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    derivative: Kernel | None = None
    set_points: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    source: Kernel | None = None
    output: Kernel | None = None
    admittance: Callable[[Values], NDArray[np.complex128]] | None = None
    targets: tuple[str, ...] = ()
    solved_inputs: tuple[str, ...] = ()
    defaults: Mapping[str, float] = field(default_factory=dict)
    guess: Callable[[Values, Mapping[str, Any]], Mapping[str, Any]] = lambda p, known: {}
    foresee: Callable[[Values, Mapping[str, Any]], Mapping[str, Any]] = nothing_foreseen
    resolve: Callable[[Mapping[str, float], float], Mapping[str, float]] = as_given
    check: Callable[[Mapping[str, float]], Iterable[str]] = no_faults
    limits: tuple[Limit, ...] = ()
    rating: Callable[[Mapping[str, float], float], float] | None = None
    characteristic: Callable[[Mapping[str, float]], Terms] | None = None
    has_dynamics: Callable[[Mapping[str, float]], bool] = always
    psse_record: tuple[str | None, ...] = ()
    psse_measured: tuple[int, ...] = ()
    psse_names: tuple[str, ...] = ()
    psse_icons: int = 0
    replaces_built_in: bool = False

    def _facts(self) -> dict[str, object]:
        return {
            "model": self.model,
            "kind": self.role.name.lower(),
            "parameters": len(self.parameters),
            "states": first_few(self.states),
        }

    @cached_property
    def parameter_rows(self) -> tuple[str, ...]:
        """Names of the rows of `p`."""
        return (*(p.name for p in self.parameters), *self.set_points, "base_speed")

    @property
    def leads(self) -> bool:
        """Whether it keeps an island alive: a machine that follows no voltage, but has its own."""
        follows = self.admittance is None or "voltage_angle" in self.states
        return self.role is Role.MACHINE and not follows

    @property
    def injects(self) -> bool:
        """Whether it feeds a current into the network, and so sees the voltage of its bus."""
        return bool(self.sources)

    @property
    def signal_rows(self) -> tuple[str, ...]:
        """Names of the rows of `y`."""
        return self.sources + self.outputs

    @property
    def kernels(self) -> dict[str, Kernel]:
        """Its kernels by what they are, in the order in which they are called."""
        stages = {"source": self.source, "output": self.output, "derivative": self.derivative}
        return {stage: kernel for stage, kernel in stages.items() if kernel is not None}

    def acting(self, given: Mapping[str, float], base_mva: float) -> dict[str, float]:
        """Parameters of a unit as they act: with defaults, and resolved where none is missing."""
        values = {p.name: given.get(p.name, p.default) for p in self.parameters}
        known = {name: value for name, value in values.items() if value is not None}
        if len(known) < len(values):
            return known
        found = self.resolve(known, base_mva)
        if not isinstance(found, Mapping) or not values.keys() <= found.keys():
            raise DeviceError(
                f"device {self.model} ({self.file}): its resolve gives {found!r}, not all parameters "
                "by name"
            )
        return dict(found)

    @property
    def functions(self) -> dict[str, FunctionType]:
        """All functions of the model, by the name of the field."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, FunctionType)}

    @property
    def file(self) -> str | None:
        """The file that it comes from; None for a model with the package's functions alone."""
        own = (f for f in self.functions.values() if not package_name(f.__module__))
        return next((function.__code__.co_filename for function in own), None)

    @property
    def own_digest(self) -> str | None:
        """SHA-256 of the code of a model that is none of the package's, as hexadecimal digits."""
        written = list(self.functions.values())
        if self.file is None:
            return None
        return sha256(repr([code_digest(function)[0] for function in written]).encode()).hexdigest()


def taken(device: Device, name: str, given: Callable[[str], bool]) -> str:
    """The signal that an input of a device is, where `given` tells which ones its unit has."""
    if device.role is Role.EXCITER and name in BETWEEN and given(BETWEEN[name]):
        return BETWEEN[name]
    return ALIASES.get(name, name)


@cache
def compiled_kernel(kernel: Kernel, complex_numbers: bool = False) -> Any:
    """The compiled form of a kernel; its ``address`` can be called from compiled code.

    A kernel from outside of the package reaches nothing beyond its matrices, whatever it asks for.
    """
    number = types.complex128 if complex_numbers else types.float64
    return compile_callback(kernel, _signature(kernel, number))


@cache
def batch_kernel(kernel: Kernel) -> Any:
    """The same for units of many runs at once: its elementary functions are vector instructions."""
    signature = _signature(kernel, types.float64)
    return compile_callback(vector_code(kernel), signature, kind="vector code")


@cache
def batch_derivative(kernel: Kernel) -> Any:
    """The same for derivatives, whose parameters go on with their inverses.

    See :func:`gridfold.numerics.products.with_products`.
    """
    signature = _signature(kernel, types.float64)
    product = with_products(kernel).function
    return compile_callback(vector_code(product), signature, kind="vector code, products")


def _signature(kernel: Kernel, number: Any) -> Any:
    guarded = not package_name(kernel.__module__)
    return types.void(*(UnitMatrix(number, role, guarded) for role in ROLES))


def run_kernel(
    kernel: Kernel | None, x: Matrix, u: Matrix, p: Matrix, y: Matrix, dx: Matrix
) -> None:
    """Run a kernel on complex matrices (rows, units); writes into `y` or `dx`."""
    if kernel is not None and x.shape[1] > 0:
        address = compiled_kernel(kernel, complex_numbers=True).address
        _call(address, x, u, p, y, dx)


@jit()
def _call(address, x, u, p, y, dx):
    invoke(
        address,
        (
            unit_matrix(x, 0, x.shape[0], x.shape[1]),
            unit_matrix(u, 0, u.shape[0], u.shape[1]),
            unit_matrix(p, 0, p.shape[0], p.shape[1]),
            unit_matrix(y, 0, y.shape[0], y.shape[1]),
            unit_matrix(dx, 0, dx.shape[0], dx.shape[1]),
        ),
    )
