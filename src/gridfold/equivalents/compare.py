"""How far a run with a small model is from the detailed one: equation (19) of Osipov & Sun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card, first_few
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.runs.trajectory import AngleReference, Trajectory


@dataclass(frozen=True)
class UnitError:
    """Errors of one machine's rotor angle in degrees, root mean square over the run and largest.

    `relative_rms_deg` is that of the angle against the centre of inertia.
    """

    unit: UnitKey
    rms_deg: float
    largest_deg: float
    relative_rms_deg: float


@dataclass(frozen=True, repr=False)
class Comparison(Card):
    """Errors of a run against the detailed one.

    Parameters
    ----------
    units : tuple of UnitError
        Rotor-angle errors of each machine, in the order asked for.
    state_rms : mapping
        Root mean square error (19) of each state by ``name:BUS:ID``; angles in degrees.
    """

    units: tuple[UnitError, ...]
    state_rms: dict[str, float]

    def _facts(self) -> dict[str, object]:
        worst = sorted(self.units, key=lambda error: -error.rms_deg)
        return {
            "machines": f"of {len(self.units)} machines",
            "errors (RMS)": first_few(
                f"{error.unit} {error.rms_deg:.3g} degrees" for error in worst
            ),
        }

    @property
    def worst(self) -> UnitError:
        """The machine with the largest root mean square error of its rotor angle."""
        return max(self.units, key=lambda error: error.rms_deg)


def compare(
    detailed: Trajectory, other: Trajectory, units: Sequence[UnitKey] | None = None
) -> Comparison:
    """Compare two runs of one disturbance, sample by sample.

    Parameters
    ----------
    detailed, other : Trajectory
        Runs on the same model with the same events, end and time step.
    units : sequence of UnitKey, optional
        Machines to compare; all by default. Those without a rotor are left out.

    Raises
    ------
    OptionError
        The runs do not share their sampling times, or no unit has a rotor.
    """
    if detailed.times.shape != other.times.shape or not np.allclose(detailed.times, other.times):
        raise OptionError(
            f"the runs cannot be compared: one has {len(detailed.times)} samples until "
            f"{detailed.times[-1]:g} s ({detailed.status.value}), the other {len(other.times)} until "
            f"{other.times[-1]:g} s ({other.status.value})"
        )
    machines = detailed.model.machines
    keys = list(machines) if units is None else [unit for unit in units if unit in machines]
    if not keys:
        raise OptionError("the runs cannot be compared: no unit among those asked for has a rotor")
    absolute = other.rotor_angle_deg(keys) - detailed.rotor_angle_deg(keys)
    coi = AngleReference.CENTRE_OF_INERTIA
    relative = other.rotor_angle_deg(keys, coi) - detailed.rotor_angle_deg(keys, coi)
    errors = [
        UnitError(
            unit,
            float(_rms(absolute[:, k])),
            float(np.nanmax(np.abs(absolute[:, k]))),
            float(_rms(relative[:, k])),
        )
        for k, unit in enumerate(keys)
    ]
    return Comparison(tuple(errors), _state_errors(detailed, other, set(keys)))


def _rms(error: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def _state_errors(detailed: Trajectory, other: Trajectory, units: set[UnitKey]) -> dict[str, float]:
    result = {}
    for block in detailed.model.layout.blocks:
        for name, row in zip(block.device.states, block.state_index, strict=True):
            scale = 180 / np.pi if name == "rotor_angle" else 1.0
            for unit, slot in zip(block.units, row, strict=True):
                if unit in units:
                    error = other.states[:, slot] - detailed.states[:, slot]
                    result[f"{name}:{unit}"] = scale * _rms(error)
    return result
