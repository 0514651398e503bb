"""Sample swings of the detailed model: what the external area is going to be driven by."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.grid.events import BusFault, Event
from gridfold.numerics.blas import one_blas_thread
from gridfold.numerics.steppers import Stepper
from gridfold.partition import Partition
from gridfold.partition.port_area import PortArea
from gridfold.runs.simulate import simulate
from gridfold.runs.trajectory import Trajectory
from gridfold.systems.status import Status

#: States (n_times, n_states) along each swing.
Swings = tuple[NDArray[np.float64], ...]

#: Sample swings follow faults of so many seconds at so many boundary buses at most.
FAULT_SECONDS, MOST_FAULTS = 0.1, 4
#: How often a fault is halved until no machine loses synchronism.
_HALVED = 4
#: Directions of the port voltages are weighed by at least this part of that of the largest swing.
FLOOR = 0.01


@one_blas_thread
def sample_swings(
    parts: Partition,
    events: Sequence[Sequence[Event]] | None = None,
    t_end: float = 3.0,
    stepper: Stepper | None = None,
) -> Swings:
    """States of the whole system along sample swings, while the network is intact again.

    Parameters
    ----------
    parts : Partition
        Study and external area.
    events : sequence of sequences of Event, optional
        One sequence for each sample swing. By default each is a fault of 0.1 s at one of up to four
        boundary buses of the study area, halved until no machine loses synchronism or a time step is
        reached.
    t_end : float
        End of each swing in seconds.
    stepper : Stepper, optional
        As in :func:`gridfold.simulate`.

    Raises
    ------
    OptionError
        There is no sample: the network is intact at no time after an event.
    """
    if events is None:
        runs = [_boundary_swing(parts, fault, t_end, stepper) for fault in sample_faults(parts)]
    else:
        runs = [simulate(parts.model, swing, t_end, stepper) for swing in events]
    samples = tuple(states for run in runs for states in _swinging(run))
    if not samples:
        raise OptionError("no sample swing has a time at which the network is intact again")
    return samples


def port_swings(area: PortArea, parts: Partition, swings: Swings) -> NDArray[np.float64]:
    """L with L L^T the mean of u u^T along the swings, (2 n_ports, 2 n_ports), symmetric.

    u are the deviations of angles (rad), then logarithms of magnitudes, of the port voltages. Ports
    swing almost together, so few directions of u matter. The others count by a hundredth of the
    largest, so that what the samples do not show is not forgotten.
    """
    index = [parts.model.case.bus_index[bus] for bus in area.ports.buses]
    rows = []
    for states in swings:
        relative = parts.model.bus_voltages(states)[:, index] / area.voltage
        rows.append(np.hstack([np.unwrap(np.angle(relative), axis=0), np.log(np.abs(relative))]))
    u = np.vstack(rows)
    values, vectors = np.linalg.eigh(u.T @ u / len(u))
    sizes = np.sqrt(np.maximum(values, 0.0))
    return np.asarray((vectors * np.maximum(sizes, FLOOR * sizes.max())) @ vectors.T)


def sample_faults(parts: Partition) -> list[BusFault]:
    """Faults at up to four boundary buses, spread over all of them."""
    buses = parts.boundary_buses
    chosen = np.linspace(0, len(buses) - 1, min(len(buses), MOST_FAULTS))
    return [BusFault(buses[k], duration=FAULT_SECONDS) for k in chosen.round().astype(int)]


def _boundary_swing(
    parts: Partition, fault: BusFault, t_end: float, stepper: Stepper | None
) -> Trajectory:
    """The swing after a fault; the last try counts even if synchronism is lost."""
    run = simulate(parts.model, [fault], t_end, stepper)
    for _ in range(_HALVED):
        if run.status is Status.COMPLETED or fault.duration / 2 < run.stepper.step:
            break
        fault = replace(fault, duration=fault.duration / 2)
        run = simulate(parts.model, [fault], t_end, stepper)
    return run


def _swinging(run: Trajectory) -> Iterator[NDArray[np.float64]]:
    """States (n_times, n_states) of the pieces after an event in which the network is intact."""
    for piece, model in zip(run.run.pieces[1:], run.models[1:], strict=False):
        if model.state == run.model.state:
            yield piece.full_states
