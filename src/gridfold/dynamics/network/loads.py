"""Loads that are not constant impedances: the network equations with them are nonlinear.

A load is its constant-impedance equivalent, which is part of the linear network, and a correcting
current

    I_c = V (Y - y(|V|)),    y(m) = conj(sum of S_k (m / V0)^n_k) / m^2,

where S_k is the part of its power at the initial voltage V0 that goes with the power n_k of the voltage
(0: constant power, 1: constant current), and Y = y(V0). Below a voltage of 0.7 p.u. it is a constant
impedance, y(0.7), as usual in stability programs (PSS/E's PQBRAK). The solver iterates

    V = K (I + I_c(V) - J V),    K = (Y_network - J)^-1,

with J the slope of I_c at the machines' currents of the operating point, from the voltages of the last
call. Where it does not converge the voltages are not a number.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.device import Terms
from gridfold.dynamics.loads.break_voltage import BREAK_VOLTAGE
from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.errors import CaseError, OptionError
from gridfold.grid.case import Case, Load, UnitKey
from gridfold.numerics.compiled import compile_callback, compiled_part, invoke
from gridfold.powerflow.injections import dc_power
from gridfold.powerflow.result import PowerFlowResult

#: Change of a voltage in p.u. at which the iteration ends, and the most iterations.
TOLERANCE, ITERATIONS = 1e-12, 300
#: Exponent of an impedance; numbers of a load in the data of the solver beside its terms, that is its
#: admittance (2), J (4) and initial voltage; size of the header.
_IMPEDANCE, _FIXED, _HEADER = 2.0, 7, 6
#: Exponents of constant power and constant current.
_POWER, _CURRENT = 0.0, 1.0
#: Times that the iteration is begun anew where it fails, each with half the step of the one before.
_ATTEMPTS = 5


@dataclass(frozen=True)
class LoadModel:
    """How loads depend on voltage in a simulation.

    Parameters
    ----------
    shares : tuple of float, optional
        Parts of constant power, current and impedance, of active and reactive power alike; None takes
        those that the case gives for each load.
    """

    shares: tuple[float, float, float] | None = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if self.shares is None:
            return
        if len(self.shares) != 3 or not all(0 <= share <= 1 for share in self.shares):
            raise OptionError(
                f"the shares of loads are three numbers from 0 to 1, not {self.shares}"
            )
        if abs(sum(self.shares) - 1) > 1e-9:
            raise OptionError(
                f"the shares of constant power, current and impedance add up to {sum(self.shares):g}, "
                "not to 1"
            )

    @classmethod
    def parse(cls, text: str) -> LoadModel:
        """From ``z``, ``raw``, or shares such as ``0.2,0.3,0.5``."""
        if text == "raw":
            return cls(None)
        if text == "z":
            return cls()
        try:
            parts = tuple(float(part) for part in text.split(","))
        except ValueError:
            parts = ()
        if len(parts) != 3:
            raise OptionError(
                f"loads are given as z, raw or P,I,Z such as 0.2,0.3,0.5, not {text!r}"
            )
        return cls(parts)

    @property
    def text(self) -> str:
        """What :meth:`parse` makes it from."""
        if self.shares is None:
            return "raw"
        return "z" if self.shares == (0, 0, 1) else ",".join(f"{s:g}" for s in self.shares)

    def __str__(self) -> str:
        if self.shares is None:
            return "as in the case"
        names = ("power", "current", "impedance")
        given = [
            f"{100 * s:g} % constant {n}" for s, n in zip(self.shares, names, strict=True) if s
        ]
        return ", ".join(given)


@dataclass(frozen=True)
class NonlinearLoads:
    """Parts of loads that are no constant impedances, by bus.

    Parameters
    ----------
    buses : tuple of int
        Bus numbers.
    exponents : ndarray, shape (n_exponents,)
        Powers of the voltage.
    power : ndarray of complex, shape (n_loads, n_exponents)
        Part of the power at the initial voltage that goes with each, in p.u.
    voltage : ndarray, shape (n_loads,)
        Initial voltage magnitudes in p.u.
    """

    buses: tuple[int, ...]
    exponents: NDArray[np.float64]
    power: NDArray[np.complex128]
    voltage: NDArray[np.float64]

    @property
    def admittance(self) -> NDArray[np.complex128]:
        """Their equivalent in the linear network, shape (n_loads,)."""
        return np.asarray(np.conj(self.power.sum(axis=1)) / self.voltage**2)

    def at(self, positions: Sequence[int]) -> NonlinearLoads:
        """Some of them."""
        chosen = np.array(positions, dtype=np.int64)
        buses = tuple(self.buses[k] for k in positions)
        return NonlinearLoads(buses, self.exponents, self.power[chosen], self.voltage[chosen])

    def drawn(
        self, m: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Power at voltages (..., n_loads) from the break voltage on, and its slope."""
        parts = self.power * (m / self.voltage)[..., None] ** self.exponents
        return parts.sum(axis=-1), (parts * self.exponents).sum(axis=-1) / m

    def currents(self, voltage: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Correcting currents at voltages of shape (..., n_loads)."""
        m = np.maximum(np.abs(voltage), BREAK_VOLTAGE)
        return np.asarray(voltage * (self.admittance - np.conj(self.drawn(m)[0]) / m**2))

    def slopes(self, voltage: NDArray[np.complex128]) -> NDArray[np.float64]:
        """d(real, imaginary current)/d(real, imaginary voltage), shape (n_loads, 2, 2)."""
        size = np.abs(voltage)
        m = np.maximum(size, BREAK_VOLTAGE)
        drawn, slope = (np.conj(part) for part in self.drawn(m))
        h = self.admittance - drawn / m**2
        rate = np.where(size > BREAK_VOLTAGE, 2 * drawn / m**3 - slope / m**2, 0.0)
        turned = voltage * rate / np.where(size > 0, size, 1.0)
        by_real = h + turned * voltage.real
        by_imag = 1j * h + turned * voltage.imag
        return np.stack(
            [
                np.stack([by_real.real, by_imag.real], axis=-1),
                np.stack([by_real.imag, by_imag.imag], axis=-1),
            ],
            axis=-2,
        )

    def less(self, held: NDArray[np.complex128], current: NDArray[np.complex128]) -> NonlinearLoads:
        """The same without some constant power and constant current (n_loads,) each."""
        gone = {_POWER: held, _CURRENT: current}
        power = self.power.copy()
        for column, exponent in enumerate(self.exponents.tolist()):
            power[:, column] -= gone.get(exponent, 0.0)
        return replace(self, power=power)

    def places(self, terminals: Sequence[int]) -> NDArray[np.int64]:
        """Their positions among the terminals."""
        return np.array([terminals.index(bus) for bus in self.buses], dtype=np.int64)

    def real_slopes(
        self, voltages: NDArray[np.complex128], terminals: Sequence[int]
    ) -> NDArray[np.float64]:
        """Slopes over all terminals in real form, (2 n_terminals, 2 n_terminals)."""
        at = self.places(terminals)
        return self.scattered(self.slopes(voltages[at]), at, len(terminals))

    @staticmethod
    def scattered(
        slopes: NDArray[np.float64], at: NDArray[np.int64], n: int
    ) -> NDArray[np.float64]:
        """Slopes (n_loads, 2, 2) at places among n terminals in real form, (2 n, 2 n)."""
        result = np.zeros((2, n, 2, n))
        result[:, at, :, at] = slopes
        return result.reshape(2 * n, 2 * n)


def nonlinear_loads(
    power_flow: PowerFlowResult,
    model: LoadModel,
    characteristics: Mapping[UnitKey, Terms] | None = None,
    apart: Collection[UnitKey] = (),
) -> NonlinearLoads | None:
    """The parts of all loads and dc lines in service that are no impedances; None without any.

    Parameters
    ----------
    power_flow : PowerFlowResult
        The operating point.
    model : LoadModel
        What loads are of which nothing else is said.
    characteristics : mapping, optional
        Voltage dependence of single loads.
    apart : collection of UnitKey
        Loads that are something else.
    """
    case, given = power_flow.case, characteristics or {}
    size = np.abs(power_flow.voltage)
    found: dict[float, NDArray[np.complex128]] = {}
    faults: list[str] = []
    plain = not given and model.shares is not None and not any(model.shares[:2])
    for load, drawn in () if plain else power_flow.drawn_by_loads():
        if load.key in apart:
            continue
        at = case.bus_index[load.bus]
        if load.key in given:
            terms = _weighted(given[load.key], drawn, float(size[at]))
            if not np.isfinite([part for _, part in terms]).all():
                faults.append(
                    f"{case.locate(load)}: the terms of its voltage dependence add up to 0 at "
                    f"{size[at]:.4g} p.u., but it draws {case.base_mva * drawn:.4g} MVA"
                )
        else:
            terms = _modelled(load, drawn, case, float(size[at]), model)
        for exponent, part in terms:
            found.setdefault(exponent, np.zeros(len(size), dtype=np.complex128))[at] += part
    for flow in power_flow.dc_flows:
        exponent = _CURRENT if flow.line.holds_current else _POWER
        held = found.setdefault(exponent, np.zeros(len(size), dtype=np.complex128))
        held += dc_power(case, [flow])
    if faults:
        raise CaseError(faults, f"case {case.name}, loads")
    found.pop(_IMPEDANCE, None)
    exponents = sorted(found)
    power = np.array([found[e] for e in exponents], dtype=np.complex128).reshape(-1, len(size)).T
    some = np.flatnonzero((power != 0).any(axis=1))
    if not len(some):
        return None
    buses = tuple(case.buses[k].number for k in some)
    return NonlinearLoads(buses, np.array(exponents), power[some], size[some])


def _modelled(
    load: Load, drawn: complex, case: Case, size: float, model: LoadModel
) -> list[tuple[float, complex]]:
    """Exponents and powers at the initial voltage `size` of a load as the load model says."""
    if model.shares is not None:
        return [(exponent, share * drawn) for exponent, share in enumerate(model.shares[:2])]
    steady = complex(load.active_mw, load.reactive_mvar)
    current = complex(load.current_active_mw, load.current_reactive_mvar)
    return [(0.0, steady / case.base_mva), (1.0, current / case.base_mva * size)]


def _weighted(terms: Terms, drawn: complex, size: float) -> list[tuple[float, complex]]:
    """Exponents and powers at the initial voltage `size` of a load with terms of its own."""
    parts = [(exponent, weight * size**exponent) for exponent, weight in terms]
    total = sum(weight for _, weight in parts)
    active = drawn.real / total.real if total.real else (np.nan if drawn.real else 0.0)
    reactive = drawn.imag / total.imag if total.imag else (np.nan if drawn.imag else 0.0)
    return [(e, complex(active * w.real, reactive * w.imag)) for e, w in parts]


def real_form(matrix: NDArray[np.complex128]) -> NDArray[np.float64]:
    """The real matrix that acts on (real parts, imaginary parts) as `matrix` does."""
    return np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])


def with_loads(
    linear: CompiledNetwork,
    loads: NonlinearLoads,
    terminals: Sequence[int],
    near: NDArray[np.complex128],
    slopes: NDArray[np.float64] | None = None,
) -> CompiledNetwork:
    """The network `linear` with loads at some of its terminals.

    Parameters
    ----------
    linear : CompiledNetwork
        Solves (Y - J) V = I for all terminals.
    loads : NonlinearLoads
        The loads.
    terminals : sequence of int
        Bus numbers of the terminals.
    near : ndarray of complex, shape (n_terminals,)
        Voltages near a solution, from which the iteration starts if it has no others.
    slopes : ndarray, shape (n_loads, 2, 2), optional
        J at the loads; zero by default.
    """
    n, at = len(terminals), loads.places(terminals)
    slopes = np.zeros((len(at), 2, 2)) if slopes is None else slopes
    y, terms = loads.admittance, len(loads.exponents)
    rows = [
        y.real, y.imag, *slopes.reshape(-1, 4).T, loads.voltage, *loads.power.real.T,
        *loads.power.imag.T,
    ]  # fmt: skip
    header = [n, len(at), terms, linear.address, linear.integers.size, linear.reals.size]
    table = np.stack(rows, axis=1).ravel()
    return CompiledNetwork(
        _compiled().address,
        np.concatenate([header, at, linear.integers]).astype(np.int64),
        np.concatenate([loads.exponents, table, near.real, near.imag, linear.reals]),
        4 * n + linear.scratch_size,
    )


def closed_with_loads(
    network: NDArray[np.float64],
    loads: NonlinearLoads | None,
    voltages: NDArray[np.complex128],
    terminals: Sequence[int],
) -> NDArray[np.float64]:
    """Slopes of voltages in currents with the loads' own slopes at `voltages` (n_terminals,).

    `network` is the real form of the linear network's impedance, (2 n_terminals, 2 n_terminals).
    """
    if loads is None:
        return network
    slopes = loads.real_slopes(voltages, terminals)
    return np.asarray(np.linalg.solve(np.eye(len(network)) - network @ slopes, network))


def _solve(integers, reals, currents, voltages, scratch):
    n, terms = integers[0], integers[2]
    near = terms + (_FIXED + 2 * terms) * integers[1]
    fresh = True
    for t in range(2 * n):
        fresh = fresh and voltages[t] == 0.0
    if not fresh and _iterate(integers, reals, currents, voltages, scratch, 1.0):
        return
    part = 1.0
    for _ in range(_ATTEMPTS):
        for t in range(2 * n):
            voltages[t] = reals[near + t]
        if _iterate(integers, reals, currents, voltages, scratch, part):
            return
        part *= 0.5
    for t in range(2 * n):
        voltages[t] = np.nan


@compiled_part
def _iterate(integers, reals, currents, voltages, scratch, part):
    """Iterate from the given voltages, a `part` of each step; returns whether it converged."""
    n, count, terms = integers[0], integers[1], integers[2]
    inner_integers = integers[_HEADER + count : _HEADER + count + integers[4]]
    row_size = _FIXED + 2 * terms
    inner_at = terms + row_size * count + 2 * n
    inner_reals = reals[inner_at : inner_at + integers[5]]
    total, before, rest = scratch[: 2 * n], scratch[2 * n : 4 * n], scratch[4 * n :]
    for _ in range(int(ITERATIONS / part)):
        for t in range(2 * n):
            total[t] = currents[t]
            before[t] = voltages[t]
        for k in range(count):
            t, at = integers[_HEADER + k], terms + row_size * k
            v_r, v_i = voltages[t], voltages[n + t]
            size = max(np.sqrt(v_r * v_r + v_i * v_i), BREAK_VOLTAGE)
            p, q = _drawn(reals, at + _FIXED, terms, size / reals[at + 6])
            h_r, h_i = reals[at] - p / (size * size), reals[at + 1] + q / (size * size)
            total[t] += h_r * v_r - h_i * v_i - reals[at + 2] * v_r - reals[at + 3] * v_i
            total[n + t] += h_r * v_i + h_i * v_r - reals[at + 4] * v_r - reals[at + 5] * v_i
        invoke(integers[3], (inner_integers, inner_reals, total, voltages, rest))
        change = 0.0
        for t in range(2 * n):
            change = max(change, abs(voltages[t] - before[t]))
        if change <= TOLERANCE:
            return True
        if not change < 1e3:
            return False
        for t in range(2 * n):
            voltages[t] = before[t] + part * (voltages[t] - before[t])
    return False


@compiled_part
def _drawn(reals, at, terms, ratio):
    """Active and reactive power at a voltage in parts of the initial one; exponents come first."""
    p, q = 0.0, 0.0
    for j in range(terms):
        exponent, active, reactive = reals[j], reals[at + j], reals[at + terms + j]
        if active == 0.0 and reactive == 0.0:
            continue
        if exponent == 0.0:
            factor = 1.0
        elif exponent == 1.0:
            factor = ratio
        else:
            factor = np.exp(exponent * np.log(ratio))
        p += active * factor
        q += reactive * factor
    return p, q


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
