"""What single precision on a GPU costs in accuracy: some runs of a study beside double precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gridfold.dynamics.cuda.precision import Precision
from gridfold.grid.change import Event
from gridfold.runs.cuda import simulate_on_gpu
from gridfold.runs.members import Outcome
from gridfold.runs.trajectory import Trajectory
from gridfold.study.prepare import Prepared

#: Contingencies that are run twice.
SAMPLE = 4


@dataclass(frozen=True)
class SingleError:
    """How far runs in single precision are from the same in double precision.

    Parameters
    ----------
    runs : int
        How many were compared.
    angle_deg : float
        The largest difference of a rotor angle in degrees, as long as both runs go on.
    otherwise : int
        Runs that came to another end, or to the same one at another step.
    """

    runs: int
    angle_deg: float
    otherwise: int

    def __str__(self) -> str:
        return single_words(asdict(self))


def single_words(record: Mapping[str, Any]) -> str:
    """The words for people on a record of :class:`SingleError`."""
    if not record["runs"]:
        return "not compared with double precision: no contingency runs on the GPU"
    text = (
        f"rotor angles within {record['angle_deg']:.1g} degrees of double precision, in "
        f"{record['runs']} runs that were made in both"
    )
    return f"{text}; {record['otherwise']} ended otherwise" if record["otherwise"] else text


def single_error(prepared: Prepared, disturbances: Sequence[Sequence[Event]]) -> SingleError:
    """Compare some of the disturbances, evenly spread among them.

    Raises
    ------
    GpuError
        The GPU does not take the runs.
    """
    places = np.linspace(0, len(disturbances) - 1, min(SAMPLE, len(disturbances)))
    sample = [disturbances[k] for k in np.unique(np.round(places).astype(int))]
    single, double = (
        dict(
            simulate_on_gpu(
                prepared.model,
                sample,
                prepared.study.run.t_end,
                prepared.method.stepper,
                prepared.criterion,
                dict(prepared.intact),
                precision=precision,
            )
        )
        for precision in (Precision.SINGLE, Precision.DOUBLE)
    )
    pairs = [(single[k], double[k]) for k in single]
    return compared(pairs)


def compared(pairs: Sequence[tuple[Outcome, Outcome]]) -> SingleError:
    """The differences of runs in single and in double precision; errors are not counted as runs."""
    runs, otherwise, largest = 0, 0, 0.0
    for single, double in pairs:
        if not (isinstance(single, Trajectory) and isinstance(double, Trajectory)):
            continue
        runs += 1
        rows = min(len(single.times), len(double.times))
        otherwise += (single.status, len(single.times)) != (double.status, len(double.times))
        apart = single.rotor_angle_deg()[:rows] - double.rotor_angle_deg()[:rows]
        largest = max(largest, float(np.nanmax(np.abs(apart), initial=0.0)))
    return SingleError(runs, largest, otherwise)
