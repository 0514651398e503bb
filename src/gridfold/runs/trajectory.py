"""The result of a simulation."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card, first_few
from gridfold.dynamics.model import DetailedModel
from gridfold.errors import OptionError
from gridfold.grid.case import UnitKey
from gridfold.grid.events import Event
from gridfold.io.comtrade import Channel, write_comtrade
from gridfold.io.event_records import event_record
from gridfold.io.results import write_npz
from gridfold.numerics.kernel_cache import SOURCES
from gridfold.numerics.steppers import Stepper
from gridfold.runs.basis import basis_of
from gridfold.runs.extremes import VoltageRange
from gridfold.runs.monitor import DEFAULT_MONITOR, Columns, monitored
from gridfold.runs.monitor.record import columns_record
from gridfold.runs.monitor.text import unit_of
from gridfold.runs.notices import Notice
from gridfold.runs.parts import Part
from gridfold.runs.synchronism import SynchronismCriterion, angle_frame
from gridfold.runs.table_files import ROWS, TableFile, TableFormat
from gridfold.simulation.run import Run
from gridfold.systems.status import Status
from gridfold.version import __version__

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class AngleReference(Enum):
    """What rotor angles are measured against."""

    SYNCHRONOUS = "synchronous"
    CENTRE_OF_INERTIA = "coi"


class UsedModel(NamedTuple):
    """Which model was simulated: its name, and its settings, ready for JSON."""

    name: str
    settings: Mapping[str, Any]


@dataclass(frozen=True, repr=False)
class Trajectory(Card):
    """Times, states and outputs of a run.

    There is one row a time step. At the instant of an event the row holds the values just after it
    (states are continuous, voltages and powers jump). Outputs of a unit are NaN once it has been
    disconnected.

    Parameters
    ----------
    model : DetailedModel
        The model of the intact network.
    run : Run
        The pieces that were integrated, and the status.
    models : tuple of DetailedModel
        The detailed model of each piece's network state.
    events, notices, stepper, criterion, t_end
        What was asked for and what it led to.
    setup_seconds, simulation_seconds : float
        Time spent on the networks of the stages, and on integration.
    used_model : UsedModel, optional
        Which model was simulated, for the metadata; by default told from the pieces alone.
    method_reason : str, optional
        Why this stepper, for the metadata.
    study_buses : frozenset of int, optional
        Bus numbers of the study area, where there is one.
    voltage_range : VoltageRange, optional
        Extremes of the voltages, where they were found while the run was stepped.
    """

    model: DetailedModel = field(repr=False)
    run: Run = field(repr=False)
    models: tuple[DetailedModel, ...] = field(repr=False)
    events: tuple[Event, ...]
    notices: tuple[Notice, ...]
    stepper: Stepper
    criterion: SynchronismCriterion | None
    t_end: float
    setup_seconds: float
    simulation_seconds: float
    used_model: UsedModel | None = None
    method_reason: str | None = None
    voltage_range: VoltageRange | None = None
    study_buses: frozenset[int] | None = None

    def _facts(self) -> dict[str, object]:
        return {
            "case": self.model.case.name,
            "model": self.simulated.name,
            "status": self.status.value,
            "until": f"{self.times[-1]:g} s of {self.t_end:g} s",
            "samples": len(self.times),
            "method": f"{self.stepper.name} with {self.stepper.step:g} s",
            "events": first_few(f"{notice.time:g} s {notice.text}" for notice in self.notices),
        }

    @property
    def simulated(self) -> UsedModel:
        """Which model was simulated: ``"detailed"``, ``"reduced"``, or as `used_model` says."""
        small = any(piece.segment.coordinates is not None for piece in self.run.pieces)
        return self.used_model or UsedModel("reduced" if small else "detailed", {})

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.run.status

    @property
    def culprit(self) -> str | None:
        """``state:BUS:ID`` of what ended the run early, None if it was completed."""
        if self.run.culprit is None:
            return None
        frame = angle_frame(self.models[len(self.run.pieces) - 1])
        if self.status is Status.LOST_SYNCHRONISM:
            return f"rotor_angle:{frame.units[self.run.culprit]}"
        if self.status is Status.OFF_SPEED:
            return f"speed:{frame.speed_units[self.run.culprit]}"
        return self.run.pieces[-1].segment.system.state_names[self.run.culprit]

    @cached_property
    def times(self) -> NDArray[np.float64]:
        """Sampling times in seconds, shape (n_times,)."""
        return np.concatenate([part.times for part in self.parts])

    @cached_property
    def states(self) -> NDArray[np.float64]:
        """States, shape (n_times, n_states); names in ``model.state_names``."""
        return np.concatenate([part.states for part in self.parts])

    def signal(
        self, name: str, units: Sequence[UnitKey | str] | None = None
    ) -> NDArray[np.float64]:
        """Any state or output by name along the run, in per unit (angles in rad).

        Parameters
        ----------
        name : str
            For example ``"rotor_angle"``, ``"speed"``, ``"field_voltage"``, ``"active_power"``.
        units : sequence of UnitKey or "BUS:ID", optional
            All machines by default.

        Returns
        -------
        ndarray, shape (n_times, n_units)
        """
        keys = self._units(units)
        known = self.model.layout.signal_slots
        for key in keys:
            if (key, name) not in known:
                names = ", ".join(sorted({signal for unit, signal in known if unit == key}))
                raise OptionError(f"unit {key} has no signal {name!r}; it has: {names or 'none'}")
        slots = self.model.slots(name, tuple(keys))
        result = np.concatenate([part.signals(slots) for part in self.parts])
        for rows, unit in self._rows_out:
            if unit in keys:
                result[rows, keys.index(unit)] = np.nan
        return result

    def rotor_angle_deg(
        self,
        units: Sequence[UnitKey | str] | None = None,
        reference: AngleReference | UnitKey | str = AngleReference.SYNCHRONOUS,
    ) -> NDArray[np.float64]:
        """Rotor angles in degrees, shape (n_times, n_units).

        `reference` is the synchronous frame, the centre of inertia of each machine's island, or a
        machine (``"78:1"``).
        """
        keys = self._units(units)
        if reference is AngleReference.CENTRE_OF_INERTIA:
            return np.rad2deg(self._relative_angles[:, self._columns_of(keys)])
        angles = self.signal("rotor_angle", keys)
        if reference is not AngleReference.SYNCHRONOUS:
            angles = angles - self.signal("rotor_angle", [reference])
        return np.asarray(np.rad2deg(angles))

    def bus_voltage(self, buses: Sequence[int] | None = None) -> NDArray[np.complex128]:
        """Voltage phasors in per unit, shape (n_times, n_buses); all buses by default."""
        index = self.model.case.bus_index
        for bus in buses or ():
            if bus not in index:
                raise OptionError(f"there is no bus {bus} in case {self.model.case.name}")
        voltages = self._bus_voltages
        return voltages if buses is None else voltages[:, [index[bus] for bus in buses]]

    @property
    def stages(self) -> Iterator[tuple[slice, DetailedModel]]:
        """Rows of :attr:`times` and the detailed model of the network there, piece by piece."""
        start = 0
        for part in self.parts:
            rows = slice(start, start + len(part))
            yield rows, part.model
            start = rows.stop

    def columns(self, monitor: str = DEFAULT_MONITOR) -> Columns:
        """Columns of a table of what `monitor` asks for, see :meth:`frame`."""
        return monitored(self.model, monitor, self.study_buses)

    def frame(self, monitor: str = DEFAULT_MONITOR) -> pd.DataFrame:
        """A table of what is watched: a column ``time`` in s, and one for each quantity.

        Parameters
        ----------
        monitor : str
            What is watched, such as ``"flow 101-103, voltage 1001-1050, every 5"``
            (:mod:`gridfold.runs.monitor.text`). By default rotor angles and speeds of all machines and
            the voltages of all buses.

        Returns
        -------
        pandas.DataFrame
            With columns such as ``p_mw:101-103`` and ``voltage_pu:1001``; its ``attrs`` hold the
            metadata.

        Raises
        ------
        OptionError
            A part of the text has no meaning, or names what is not there.
        """
        import pandas as pd

        columns = self.columns(monitor)
        frame = pd.DataFrame(self.table(columns), columns=list(columns.header))
        frame.attrs.update(self.metadata(columns))
        return frame

    def plot(self, monitor: str = DEFAULT_MONITOR) -> Figure:
        """A picture of what is watched, a panel for each kind of quantity.

        `monitor` is as in :meth:`frame`.

        Returns
        -------
        matplotlib.figure.Figure
            Shown by a notebook, saved by its ``savefig``.
        """
        from gridfold.report.curves import draw_curves, run_curves

        return draw_curves(run_curves(self, self.columns(monitor)))

    def table(self, columns: Columns) -> NDArray[np.float64]:
        """Rows of the time and of `columns`, shape (n_rows, 1 + n_columns)."""
        reader = columns.reader()
        blocks = (block for part in self.parts for block in part.blocks(ROWS))
        return np.concatenate([reader.take(block) for block in blocks])

    def to_csv(self, path: str | Path, monitor: str = DEFAULT_MONITOR) -> None:
        """Write :meth:`frame` as CSV, and the metadata beside it as ``NAME.meta.json``."""
        self.write_table(TableFile(Path(path), TableFormat.CSV, self.columns(monitor)))

    def to_parquet(self, path: str | Path, monitor: str = DEFAULT_MONITOR) -> None:
        """Write :meth:`frame` as Parquet with the metadata in the file's own."""
        self.write_table(TableFile(Path(path), TableFormat.PARQUET, self.columns(monitor)))

    def write_table(self, table: TableFile) -> None:
        """Write a table, and the metadata beside it or in it."""
        with table.open() as writer:
            for part in self.parts:
                writer.take(part)
            writer.file.metadata = self.metadata(table.columns)

    def to_comtrade(self, path: str | Path, monitor: str = DEFAULT_MONITOR) -> None:
        """Write :meth:`frame` in COMTRADE, ``NAME.cfg`` and ``NAME.dat`` (IEEE C37.111-1999, ASCII)."""
        self.write_comtrade(Path(path), self.columns(monitor))

    def write_comtrade(self, path: Path, columns: Columns) -> None:
        """The same of columns that are known."""
        table, case = self.table(columns), self.model.case
        channels = [
            Channel(name, unit_of(name), values)
            for name, values in zip(columns.names, table.T[1:], strict=True)
        ]
        began = next((notice.time for notice in self.notices if notice.time > 0), 0.0)
        device = f"gridfold {__version__}"
        write_comtrade(path, case.name, device, table[:, 0], channels, case.frequency_hz, began)

    def to_npz(self, path: str | Path) -> None:
        """Write times, all states with their names, and the metadata as a NumPy archive."""
        arrays = {
            "times": self.times,
            "states": self.states,
            "state_names": np.array(self.model.state_names),
        }
        write_npz(Path(path), arrays, self.metadata())

    def metadata(self, columns: Columns | None = None) -> dict[str, Any]:
        """Everything needed to repeat the run, its outcome, and what `columns` are about, for JSON."""
        case = self.model.case
        stepper: dict[str, Any] = {"name": self.stepper.name, "step": self.stepper.step}
        tolerance = getattr(self.stepper, "tolerance", None)
        if tolerance is not None:
            stepper["tolerance"] = tolerance
        return {
            "gridfold": __version__,
            "sources": SOURCES,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "own_devices": self.model.own_devices,
            "case": case.name,
            "fingerprint": case.fingerprint,
            "model": self.simulated.name,
            "model_settings": dict(self.simulated.settings),
            "network_backend": self.model.backend.value,
            "events": [event_record(event) for event in self.events],
            "t_end": self.t_end,
            "stepper": stepper,
            "method": self.stepper.name,
            "method_reason": self.method_reason,
            "criterion": None if self.criterion is None else str(self.criterion),
            "angle_limit_deg": None if self.criterion is None else self.criterion.limit_deg,
            "speed_limit": None if self.criterion is None else _finite(self.criterion.speed_limit),
            "status": self.status.value,
            "ended_at": float(self.times[-1]),
            "culprit": self.culprit,
            "steps": self.run.step_count,
            "notices": [notice._asdict() for notice in self.notices],
            **basis_of(self.model).record(),
            **({} if columns is None else {"columns": self._columns_record(columns)}),
        }

    def approximate(self, columns: Columns) -> tuple[str, ...]:
        """Columns about buses or machines outside the study area that a reduced model stands for.

        There the states are those nearest to the reduced ones, and what follows from them is no more
        exact than they are.
        """
        small = any(piece.segment.coordinates is not None for piece in self.run.pieces)
        if not small or self.study_buses is None:
            return ()
        named = zip(columns.names, columns.buses, strict=True)
        return tuple(name for name, buses in named if not self.study_buses.issuperset(buses))

    def _columns_record(self, columns: Columns) -> dict[str, Any]:
        about = {bus for buses in columns.buses for bus in buses}
        record = columns_record(self.model.case, about, self.study_buses)
        approximate = self.approximate(columns)
        return record | {"every": columns.every, "approximate": list(approximate)}

    # What the methods above share.

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Pieces with their models, the row of each event only once (after it)."""
        pieces = self.run.pieces
        return tuple(
            Part(piece, model, 0, len(piece.times) - (piece is not pieces[-1]))
            for piece, model in zip(pieces, self.models, strict=False)
        )

    @cached_property
    def _bus_voltages(self) -> NDArray[np.complex128]:
        return np.concatenate([part.bus_voltages() for part in self.parts])

    @cached_property
    def _relative_angles(self) -> NDArray[np.float64]:
        """Rotor angle of each machine in rad against its reference, shape (n_times, n_machines)."""
        return np.concatenate([part.relative_angles for part in self.parts])

    def _columns_of(self, units: Sequence[UnitKey]) -> slice | list[int]:
        """Columns of machines in a table of all of them."""
        if tuple(units) == self.model.machines:
            return slice(None)
        column = {unit: k for k, unit in enumerate(self.model.machines)}
        return [column[unit] for unit in units]

    @property
    def _rows_out(self) -> list[tuple[slice, UnitKey]]:
        """Rows in which a unit is out of service."""
        return [(rows, unit) for rows, model in self.stages for unit in model.state.units_out]

    def _units(self, units: Sequence[UnitKey | str] | None) -> list[UnitKey]:
        if units is None:
            return list(self.model.machines)
        known = {str(unit): unit for unit in self.model.layout.source_units}
        for unit in units:
            if str(unit) not in known:
                raise OptionError(f"there is no machine {unit} in case {self.model.case.name}")
        return [known[str(unit)] for unit in units]


def _finite(value: float) -> float | None:
    """A number ready for JSON."""
    return value if np.isfinite(value) else None
