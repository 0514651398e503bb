"""Typical data of machines, by kind of unit and size: for generators whose data nobody has.

Constants lie within the ranges of P. Kundur, Power System Stability and Control, 1994: inertias those
of table 3.2, all others of machines those of table 4.2. For round rotors they are the values of its
two-area system (example 12.6). The temporary droop and the reset time of hydro governors follow from
the starting times of water and machine, equations (9.40) and (9.41) there. Exciters and the governors
of steam and gas turbines are the simplest models of PSS/E with values that are usual in planning cases.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gridfold.grid.case import DeviceRecord, Generator
from gridfold.grid.energy_source import EnergySource

#: Ratings in MVA from which a unit is of medium size, and from which it is large.
MEDIUM, LARGE = 100.0, 400.0
#: Least limit of a turbine's power over that of the start: units may start above their rating.
RESERVE = 1.2
#: Parameters of turbines that limit their power.
_HIGHEST = {"highest_valve", "highest_fuel", "temperature_limit", "highest_gate"}
#: Water starting time of hydro units in s.
_WATER = 1.5

_ROUND_ROTOR = {
    "d_open_circuit_time": 8.0,
    "d_subtransient_open_circuit_time": 0.03,
    "q_open_circuit_time": 0.4,
    "q_subtransient_open_circuit_time": 0.05,
    "damping": 0.0,
    "d_reactance": 1.8,
    "q_reactance": 1.7,
    "d_transient_reactance": 0.3,
    "q_transient_reactance": 0.55,
    "subtransient_reactance": 0.25,
    "leakage_reactance": 0.2,
    "saturation_10": 0.08,
    "saturation_12": 0.4,
}
_SALIENT_POLES = {
    "d_open_circuit_time": 5.0,
    "d_subtransient_open_circuit_time": 0.04,
    "q_subtransient_open_circuit_time": 0.06,
    "damping": 0.0,
    "d_reactance": 1.1,
    "q_reactance": 0.7,
    "d_transient_reactance": 0.3,
    "subtransient_reactance": 0.22,
    "leakage_reactance": 0.15,
    "saturation_10": 0.1,
    "saturation_12": 0.4,
}
_EXCITER = {
    "lead_lag_ratio": 0.1,
    "lag_time": 10.0,
    "regulator_gain": 100.0,
    "exciter_time": 0.1,
    "field_voltage_minimum": 0.0,
    "field_voltage_maximum": 5.0,
}
_STEAM_TURBINE = {
    "droop": 0.05,
    "valve_time": 0.5,
    "highest_valve": 1.0,
    "lowest_valve": 0.0,
    "reheater_lead_time": 2.1,
    "reheater_time": 7.0,
    "turbine_damping": 0.0,
}
_GAS_TURBINE = {
    "droop": 0.05,
    "fuel_time": 0.4,
    "turbine_time": 0.1,
    "exhaust_time": 3.0,
    "temperature_limit": 1.0,
    "temperature_gain": 2.0,
    "highest_fuel": 1.0,
    "lowest_fuel": 0.0,
    "turbine_damping": 0.0,
}
_HYDRO_TURBINE = {
    "droop": 0.05,
    "filter_time": 0.05,
    "servo_time": 0.5,
    "gate_velocity": 0.2,
    "highest_gate": 1.0,
    "lowest_gate": 0.0,
    "water_time": _WATER,
    "turbine_gain": 1.2,
    "turbine_damping": 0.5,
    "no_load_flow": 0.08,
}


@dataclass(frozen=True)
class TypicalSet:
    """Typical data of one kind of unit.

    Parameters
    ----------
    machine, governor : str
        Models; the exciter is SEXS.
    constants, turbine : mapping
        Their parameters, but for the inertia and what follows from it.
    inertia : tuple of float
        H in s on the unit's rating of small, medium and large units.
    """

    machine: str
    governor: str
    constants: Mapping[str, float]
    turbine: Mapping[str, float]
    inertia: tuple[float, float, float]

    def records(self, generator: Generator) -> tuple[DeviceRecord, ...]:
        """Machine, exciter and governor of a generator; ZSORCE gives the stator's resistance."""
        inertia = self.inertia[(generator.base_mva >= MEDIUM) + (generator.base_mva >= LARGE)]
        machine = {**self.constants, "inertia": inertia, "resistance": generator.source_resistance}
        turbine = dict(self.turbine)
        needed = RESERVE * generator.active_mw / generator.base_mva
        turbine |= {name: max(turbine[name], needed) for name in _HIGHEST & turbine.keys()}
        if "water_time" in turbine:
            turbine |= hydro_settings(turbine["water_time"], inertia)
        made = ((self.machine, machine), ("sexs", _EXCITER), (self.governor, turbine))
        return tuple(DeviceRecord(name, *generator.key, values) for name, values in made)


def hydro_settings(water: float, inertia: float) -> dict[str, float]:
    """Temporary droop and reset time (s) for a water starting time and an inertia H, both in s."""
    droop = (2.3 - (water - 1.0) * 0.15) * water / (2 * inertia)
    return {"temporary_droop": droop, "reset_time": (5.0 - (water - 1.0) * 0.5) * water}


#: What stands for a unit, by what drives it. Nothing synchronous stands for a converter.
TYPICAL: Mapping[EnergySource, TypicalSet] = {
    EnergySource.STEAM: TypicalSet(
        "genrou", "tgov1", _ROUND_ROTOR, _STEAM_TURBINE, (5.0, 4.0, 3.5)
    ),
    EnergySource.GAS: TypicalSet("genrou", "gast", _ROUND_ROTOR, _GAS_TURBINE, (3.0, 5.0, 5.0)),
    EnergySource.HYDRO: TypicalSet(
        "gensal", "hygov", _SALIENT_POLES, _HYDRO_TURBINE, (2.5, 3.0, 4.0)
    ),
}
#: What a unit is taken for where nothing tells: steam.
TYPICAL_DEFAULT = EnergySource.STEAM


def typical_set(generator: Generator) -> TypicalSet | None:
    """What stands for a generator; None for wind and solar plants."""
    source = generator.source
    return TYPICAL.get(TYPICAL_DEFAULT if source is EnergySource.UNKNOWN else source)
