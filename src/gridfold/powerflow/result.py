"""The solved operating point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card
from gridfold.grid.case import Case, Control, Load
from gridfold.powerflow.dc_flow import DcFlow
from gridfold.powerflow.injections import dc_power

_FAR_MW = 1000.0


@dataclass(frozen=True, repr=False)
class PowerFlowResult(Card):
    """Solution of the power flow.

    Parameters
    ----------
    case : Case
        The case that was solved.
    voltage : ndarray of complex, shape (n_buses,)
        Bus voltages in per unit.
    unit_power : ndarray of complex, shape (n_generators,)
        Power of each generator in per unit on the system base; 0 when out of service.
    load_power : ndarray of complex, shape (n_buses,)
        Load at each bus in per unit on the system base.
    iterations : int
        Newton iterations.
    mismatch : float
        Largest remaining power mismatch in per unit.
    dc_flows : tuple of DcFlow
        Operating points of the dc lines.
    """

    case: Case
    voltage: NDArray[np.complex128]
    unit_power: NDArray[np.complex128]
    load_power: NDArray[np.complex128]
    iterations: int
    mismatch: float
    dc_flows: tuple[DcFlow, ...] = ()

    @property
    def converter_power(self) -> NDArray[np.complex128]:
        """Power that dc lines draw at each bus in per unit on the system base, shape (n_buses,)."""
        return dc_power(self.case, self.dc_flows)

    def _facts(self) -> dict[str, object]:
        generation = float(self.unit_power.sum().real) * self.case.base_mva
        return {
            "case": self.case.name,
            "generation": f"{generation:,.1f} MW",
            "losses": f"{self.losses_mw:,.1f} MW",
            "iterations": self.iterations,
            "mismatch": f"{self.mismatch:.1e} p.u.",
        }

    @property
    def losses_mw(self) -> float:
        """Active power lost in branches and shunts, in MW; that of dc lines is not among it."""
        total = self.unit_power.sum() - self.load_power.sum() - self.converter_power.sum()
        return float(total.real) * self.case.base_mva

    def drawn_by_loads(self) -> Iterator[tuple[Load, complex]]:
        """Each load in service, and the power that it draws in per unit on the system base."""
        case = self.case
        for load in case.loads:
            if load.in_service:
                size = abs(complex(self.voltage[case.bus_index[load.bus]]))
                yield load, load.power(size) / case.base_mva

    @property
    def solved_case(self) -> Case:
        """The case with this solution as its stored state: voltages, and powers of units in service."""
        buses = tuple(
            replace(bus, voltage_pu=float(abs(v)), angle_deg=float(np.degrees(np.angle(v))))
            for bus, v in zip(self.case.buses, self.voltage, strict=True)
        )
        powers = self.unit_power * self.case.base_mva
        generators = tuple(
            replace(unit, active_mw=float(s.real), reactive_mvar=float(s.imag))
            if unit.in_service
            else unit
            for unit, s in zip(self.case.generators, powers, strict=True)
        )
        return replace(self.case, buses=buses, generators=generators)

    @property
    def notices(self) -> tuple[str, ...]:
        """Units that balance far from their stored power, and the operating points of dc lines.

        The stored state is then no solution. Far is more than 1000 MW, or, where a power is stored at
        all, both more than the MVA base of the unit and more than a tenth of all load.
        """
        lines = [flow.text for flow in self.dc_flows if flow.line.in_service]
        tenth = 0.1 * abs(float(self.load_power.real.sum())) * self.case.base_mva
        for unit, power in zip(self.case.generators, self.unit_power, strict=True):
            if not unit.in_service or unit.control is not Control.SLACK:
                continue
            solved = float(power.real) * self.case.base_mva
            is_stored = unit.active_mw != 0 or unit.reactive_mvar != 0
            limit = min(max(unit.base_mva, tenth), _FAR_MW) if is_stored else _FAR_MW
            if abs(solved - unit.active_mw) > limit:
                lines.append(
                    f"{self.case.locate(unit)} balances with {solved:,.1f} MW, stored are "
                    f"{unit.active_mw:,.1f} MW: the stored state is far from the solution"
                )
        return tuple(lines)
