"""What the parameters of dynamic devices usually are: a table of ranges, and one of orders.

A row holds for every device of its role that has a parameter of that name, those of a user too. The
values are those of textbooks and standards, widened where the public cases have sound units beyond
them: P. Kundur, Power System Stability and Control, 1994, tables 3.2 and 4.2 for machines; IEEE Std
421.5 for exciters and stabilizers; IEEE PES-TR1, Dynamic Models for Turbine-Governors in Power System
Studies, 2013, for prime movers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from gridfold.dynamics.device import Role

_INERTIA = "Kundur, table 3.2: 2 s (hydro) to 10 s (four poles)"
_MACHINE = "Kundur, table 4.2"
_EXCITER = "IEEE Std 421.5, sample data"
_MOVER = "IEEE PES-TR1"
_FLUX = "the fluxes behind them fall in this order, Kundur, section 4.2"
_WINDINGS = "a damper decays before the field, Kundur, section 4.2"
_ROOM = "limits that leave room"


@dataclass(frozen=True)
class Range:
    """The usual range of a parameter in all devices of a role, ends included."""

    role: Role
    parameter: str
    lowest: float
    highest: float
    source: str

    @property
    def name(self) -> str:
        """Name of the row."""
        return f"{self.role.name.lower()}.{self.parameter}"


@dataclass(frozen=True)
class Order:
    """A parameter that is usually no less than another one, or more where `strict`."""

    role: Role
    larger: str
    smaller: str
    source: str
    strict: bool = False

    @property
    def name(self) -> str:
        """Name of the row."""
        return f"{self.role.name.lower()}.{self.larger}>{self.smaller}"

    def holds(self, values: Mapping[str, float]) -> bool:
        """Whether it is so in a device; also where the device lacks one of the two."""
        larger, smaller = values.get(self.larger, inf), values.get(self.smaller, -inf)
        return larger > smaller if self.strict else larger >= smaller


def _ranges(role: Role, source: str, *rows: tuple[str, float, float]) -> tuple[Range, ...]:
    return tuple(Range(role, *row, source) for row in rows)


RANGES = (
    *_ranges(Role.MACHINE, _INERTIA, ("inertia", 1, 10)),
    *_ranges(
        Role.MACHINE,
        "0 to 2 of a rotor with dampers; more where it stands for them",
        ("damping", 0, 20),
    ),
    *_ranges(
        Role.MACHINE,
        "a transient reactance; 1 is what PSS/E takes where ZSORCE is blank",
        ("reactance", 0.05, 0.7),
    ),
    *_ranges(
        Role.MACHINE,
        "the public cases",
        ("saturation_10", 0, 0.6),
        ("saturation_12", 0, 2),
    ),
    *_ranges(
        Role.MACHINE,
        _MACHINE,
        ("resistance", 0, 0.05),
        ("d_reactance", 0.4, 3),
        ("q_reactance", 0.25, 3),
        ("d_transient_reactance", 0.08, 0.7),
        ("q_transient_reactance", 0.08, 1.5),
        ("transient_reactance", 0.08, 0.7),
        ("subtransient_reactance", 0.06, 0.6),
        ("leakage_reactance", 0.02, 0.4),
        ("d_open_circuit_time", 1, 15),
        ("q_open_circuit_time", 0.2, 3),
        ("d_subtransient_open_circuit_time", 0.005, 0.2),
        ("q_subtransient_open_circuit_time", 0.005, 0.3),
    ),
    *_ranges(
        Role.EXCITER,
        _EXCITER,
        ("measuring_time", 0, 0.5),
        ("regulator_gain", 1, 1000),
        ("regulator_time", 0, 1),
        ("lag_time", 0, 50),
        ("lead_time", 0, 50),
        ("lead_lag_ratio", 0, 1),
        ("exciter_gain", -1, 2),
        ("exciter_time", 0, 3),
        ("feedback_gain", 0, 1),
        ("feedback_time", 0, 5),
        ("regulator_maximum", 0.5, 100),
        ("regulator_minimum", -100, 1),
        ("field_voltage_maximum", 1, 100),
        ("field_voltage_minimum", -100, 1),
        ("error_maximum", 0, 100),
        ("error_minimum", -100, 0),
        ("saturation_1", 0, 2),
        ("saturation_2", 0, 3),
        ("saturation_voltage_1", 0, 10),
        ("saturation_voltage_2", 0, 10),
        ("saturation_a", 0, 1),
        ("saturation_b", 0, 5),
        ("rectifier_loading", 0, 1),
        ("inner_gain", 0.1, 1000),
        ("inner_time", 0, 1),
        ("inner_feedback_gain", 0, 2),
        ("potential_gain", 0, 20),
        ("current_gain", 0, 20),
        ("source_reactance", 0, 1),
        ("potential_angle", -90, 90),
    ),
    *_ranges(
        Role.GOVERNOR,
        _MOVER + "; droops are 3 to 8 %",
        ("droop", 0.01, 0.1),
        ("governor_gain", 10, 100),
    ),
    *_ranges(
        Role.GOVERNOR,
        _MOVER,
        ("governor_time", 0, 5),
        ("valve_time", 0, 10),
        ("highest_valve", 0.5, 2),
        ("lowest_valve", -0.5, 0.9),
        ("reheater_lead_time", 0, 10),
        ("reheater_time", 0, 20),
        ("turbine_damping", 0, 2),
        ("fuel_time", 0, 1),
        ("turbine_time", 0, 1),
        ("exhaust_time", 0, 10),
        ("temperature_limit", 0.5, 1.5),
        ("temperature_gain", 0, 10),
        ("highest_fuel", 0.5, 2),
        ("lowest_fuel", -0.5, 0.9),
        ("temporary_droop", 0.02, 2),
        ("reset_time", 1, 30),
        ("filter_time", 0, 0.5),
        ("servo_time", 0, 1),
        ("gate_velocity", 0.01, 2),
        ("highest_gate", 0.3, 2),
        ("lowest_gate", -0.5, 0.9),
        ("water_time", 0.2, 5),
        ("turbine_gain", 0.5, 2),
        ("no_load_flow", 0, 0.3),
        ("governor_lag_time", 0, 10),
        ("governor_lead_time", 0, 20),
        ("gate_time", 0.02, 1),
        ("opening_rate", 0.01, 10),
        ("closing_rate", -10, -0.01),
        ("chest_time", 0, 2),
        ("crossover_time", 0, 20),
        ("outlet_time", 0, 20),
        ("chest_fraction", 0, 1),
        ("reheater_fraction", 0, 1),
        ("crossover_fraction", 0, 1),
        ("outlet_fraction", 0, 1),
    ),
    *_ranges(Role.TURBINE, _MOVER, ("charging_time", 0.05, 5)),
    *_ranges(
        Role.STABILIZER,
        _EXCITER,
        ("stabilizer_gain", -100, 100),
        ("input_gain_1", -100, 100),
        ("input_gain_2", -100, 100),
        ("input_time_1", 0, 1),
        ("input_time_2", 0, 1),
        ("lead_time_1", 0, 15),
        ("lag_time_1", 0, 15),
        ("lead_time_2", 0, 15),
        ("lag_time_2", 0, 15),
        ("lead_time_3", 0, 15),
        ("lag_time_3", 0, 15),
        ("washout_lead_time", 0.1, 50),
        ("washout_time", 0.1, 50),
        ("highest_signal", 0.01, 0.5),
        ("lowest_signal", -0.5, 0),
    ),
)

ORDERS = (
    Order(Role.MACHINE, "d_reactance", "q_reactance", _FLUX),
    Order(Role.MACHINE, "d_reactance", "d_transient_reactance", _FLUX),
    Order(Role.MACHINE, "q_reactance", "q_transient_reactance", _FLUX),
    Order(Role.MACHINE, "q_transient_reactance", "d_transient_reactance", _FLUX),
    Order(Role.MACHINE, "d_transient_reactance", "subtransient_reactance", _FLUX),
    Order(Role.MACHINE, "q_reactance", "subtransient_reactance", _FLUX),
    Order(Role.MACHINE, "q_transient_reactance", "subtransient_reactance", _FLUX),
    Order(Role.MACHINE, "subtransient_reactance", "leakage_reactance", _FLUX),
    Order(Role.MACHINE, "d_open_circuit_time", "d_subtransient_open_circuit_time", _WINDINGS),
    Order(Role.MACHINE, "q_open_circuit_time", "q_subtransient_open_circuit_time", _WINDINGS),
    Order(Role.MACHINE, "d_open_circuit_time", "q_open_circuit_time", _MACHINE),
    Order(Role.EXCITER, "regulator_maximum", "regulator_minimum", _ROOM, strict=True),
    Order(Role.EXCITER, "field_voltage_maximum", "field_voltage_minimum", _ROOM, strict=True),
    Order(Role.EXCITER, "error_maximum", "error_minimum", _ROOM, strict=True),
    Order(Role.EXCITER, "inner_maximum", "inner_minimum", _ROOM, strict=True),
    Order(Role.GOVERNOR, "highest_valve", "lowest_valve", _ROOM, strict=True),
    Order(Role.GOVERNOR, "highest_fuel", "lowest_fuel", _ROOM, strict=True),
    Order(Role.GOVERNOR, "highest_gate", "lowest_gate", _ROOM, strict=True),
    Order(
        Role.GOVERNOR,
        "reheater_time",
        "reheater_lead_time",
        "the part before the reheater is 1 at most",
    ),
    Order(
        Role.GOVERNOR, "temporary_droop", "droop", "hydro governors need it, Kundur, section 9.1.3"
    ),
    Order(Role.STABILIZER, "highest_signal", "lowest_signal", _ROOM, strict=True),
)
