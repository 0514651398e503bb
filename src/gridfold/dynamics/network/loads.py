"""Loads that are not constant impedances: the network equations with them are nonlinear.

A load of constant power and current is its constant-impedance equivalent, which is part of the linear
network, and a correcting current

    I_c = V (Y - y(|V|)),    y(m) = conj(S_p + S_i m / V0) / m^2,

where S_p and S_i are its parts at the initial voltage V0 and Y = y(V0). Below a voltage of 0.7 p.u. it
is a constant impedance, y(0.7), as usual in stability programs (PSS/E's PQBRAK). The solver iterates

    V = K (I + I_c(V) - J V),    K = (Y_network - J)^-1,

with J the slope of I_c at the machines' currents of the operating point, from the voltages of the last
call. Where it does not converge the voltages are not a number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.network.backend import NETWORK_SIGNATURE, CompiledNetwork
from gridfold.errors import OptionError
from gridfold.numerics.compiled import compile_callback, compiled_part, invoke
from gridfold.powerflow.injections import dc_power
from gridfold.powerflow.result import PowerFlowResult

#: Voltage in p.u. below which every load is a constant impedance.
BREAK_VOLTAGE = 0.7
#: Change of a voltage in p.u. at which the iteration ends, and the most iterations.
_TOLERANCE, _ITERATIONS = 1e-12, 300
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
    power, current : ndarrays of complex, shape (n_loads,)
        Constant-power part, and constant-current part at the initial voltage, in p.u.
    voltage : ndarray, shape (n_loads,)
        Initial voltage magnitudes in p.u.
    """

    buses: tuple[int, ...]
    power: NDArray[np.complex128]
    current: NDArray[np.complex128]
    voltage: NDArray[np.float64]

    @property
    def admittance(self) -> NDArray[np.complex128]:
        """Their equivalent in the linear network, shape (n_loads,)."""
        return np.asarray(np.conj(self.power + self.current) / self.voltage**2)

    def currents(self, voltage: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Correcting currents at voltages of shape (..., n_loads)."""
        m = np.maximum(np.abs(voltage), BREAK_VOLTAGE)
        y = np.conj(self.power + self.current * m / self.voltage) / m**2
        return np.asarray(voltage * (self.admittance - y))

    def slopes(self, voltage: NDArray[np.complex128]) -> NDArray[np.float64]:
        """d(real, imaginary current)/d(real, imaginary voltage), shape (n_loads, 2, 2)."""
        size = np.abs(voltage)
        m = np.maximum(size, BREAK_VOLTAGE)
        h = self.admittance - np.conj(self.power + self.current * m / self.voltage) / m**2
        rate = 2 * np.conj(self.power) / m**3 + np.conj(self.current) / (self.voltage * m**2)
        rate = np.where(size > BREAK_VOLTAGE, rate, 0.0)
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


def nonlinear_loads(power_flow: PowerFlowResult, model: LoadModel) -> NonlinearLoads | None:
    """The parts of all loads and dc lines in service that are no impedances; None without any."""
    case = power_flow.case
    power, current = np.zeros((2, len(case.buses)), dtype=np.complex128)
    size = np.abs(power_flow.voltage)
    if model.shares is not None:
        power, current = (share * power_flow.load_power for share in model.shares[:2])
    else:
        for load in case.loads:
            if load.in_service:
                at = case.bus_index[load.bus]
                power[at] += complex(load.active_mw, load.reactive_mvar) / case.base_mva
                steady = complex(load.current_active_mw, load.current_reactive_mvar)
                current[at] += steady / case.base_mva * size[at]
    for flow in power_flow.dc_flows:
        part = current if flow.line.holds_current else power
        part += dc_power(case, [flow])
    some = np.flatnonzero((power != 0) | (current != 0))
    if not len(some):
        return None
    buses = tuple(case.buses[k].number for k in some)
    return NonlinearLoads(buses, power[some], current[some], size[some])


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
    y = loads.admittance
    rows = [
        y.real, y.imag, loads.power.real, loads.power.imag,
        (loads.current / loads.voltage).real, (loads.current / loads.voltage).imag,
        *slopes.reshape(-1, 4).T,
    ]  # fmt: skip
    header = [n, len(at), linear.address, linear.integers.size, linear.reals.size]
    return CompiledNetwork(
        _compiled().address,
        np.concatenate([header, at, linear.integers]).astype(np.int64),
        np.concatenate([np.stack(rows, axis=1).ravel(), near.real, near.imag, linear.reals]),
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
    n, near = integers[0], 10 * integers[1]
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
    n, count = integers[0], integers[1]
    inner_integers = integers[5 + count : 5 + count + integers[3]]
    inner_at = 10 * count + 2 * n
    inner_reals = reals[inner_at : inner_at + integers[4]]
    total, before, rest = scratch[: 2 * n], scratch[2 * n : 4 * n], scratch[4 * n :]
    break_squared = BREAK_VOLTAGE * BREAK_VOLTAGE
    for _ in range(int(_ITERATIONS / part)):
        for t in range(2 * n):
            total[t] = currents[t]
            before[t] = voltages[t]
        for k in range(count):
            t, at = integers[5 + k], 10 * k
            v_r, v_i = voltages[t], voltages[n + t]
            squared = max(v_r * v_r + v_i * v_i, break_squared)
            size = np.sqrt(squared)
            h_r = reals[at] - (reals[at + 2] + reals[at + 4] * size) / squared
            h_i = reals[at + 1] + (reals[at + 3] + reals[at + 5] * size) / squared
            total[t] += h_r * v_r - h_i * v_i - reals[at + 6] * v_r - reals[at + 7] * v_i
            total[n + t] += h_r * v_i + h_i * v_r - reals[at + 8] * v_r - reals[at + 9] * v_i
        invoke(integers[2], (inner_integers, inner_reals, total, voltages, rest))
        change = 0.0
        for t in range(2 * n):
            change = max(change, abs(voltages[t] - before[t]))
        if change <= _TOLERANCE:
            return True
        if not change < 1e3:
            return False
        for t in range(2 * n):
            voltages[t] = before[t] + part * (voltages[t] - before[t])
    return False


@cache
def _compiled() -> Any:
    return compile_callback(_solve, NETWORK_SIGNATURE)
