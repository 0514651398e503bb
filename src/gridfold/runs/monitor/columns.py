"""From a monitor to the columns of a table: names become positions in arrays."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gridfold.dynamics.model import DetailedModel
from gridfold.dynamics.network.flows import BranchEnds, End, joined
from gridfold.errors import OptionError
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.selection import (
    LineEnd,
    line_name,
    select_buses,
    select_lines,
    select_machines,
    select_numbers,
)
from gridfold.runs.monitor.buses import Frequencies, Loads, VoltageAngles, Voltages
from gridfold.runs.monitor.lines import Currents, Flows, GroupSums, Interface
from gridfold.runs.monitor.machines import Generation, RelativeAngles, Signals
from gridfold.runs.monitor.text import (
    BUS_KINDS,
    DEFAULT_MONITOR,
    GROUP_KINDS,
    LINE_KINDS,
    MACHINE_KINDS,
    Monitor,
    Statement,
    parse_monitor,
)
from gridfold.runs.monitor.view import Quantity, Reader, View
from gridfold.runs.parts import Part

#: Name of the first column.
TIME = "time"


@dataclass(frozen=True)
class Columns:
    """What a table of a run shows beside the time.

    Parameters
    ----------
    quantities : tuple of Quantity
        What is computed.
    every : int
        Each how many-th step is shown, from the first one on.
    kept : ndarray of int
        Positions of the columns that are shown among those of all quantities.
    """

    quantities: tuple[Quantity, ...]
    every: int
    kept: NDArray[np.int64]

    @classmethod
    def of(cls, quantities: Sequence[Quantity], every: int = 1) -> Columns:
        """All columns of some quantities, those of one name once."""
        first: dict[str, int] = {}
        for k, name in enumerate(name for item in quantities for name in item.names):
            first.setdefault(name, k)
        return cls(tuple(quantities), every, np.array(list(first.values()), dtype=np.int64))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns beside the time."""
        names = [name for item in self.quantities for name in item.names]
        return tuple(names[k] for k in self.kept)

    @property
    def buses(self) -> tuple[tuple[int, ...], ...]:
        """Bus numbers that each column is about."""
        buses = [numbers for item in self.quantities for numbers in item.buses]
        return tuple(buses[k] for k in self.kept)

    @property
    def header(self) -> tuple[str, ...]:
        """Names of all columns of the table."""
        return (TIME, *self.names)

    def reader(self) -> RowReader:
        """What makes the rows of one run."""
        slots = [
            item.slots for item in self.quantities if isinstance(item, Signals | RelativeAngles)
        ]
        wanted = np.unique(np.concatenate(slots)) if slots else np.zeros(0, dtype=np.int64)
        return RowReader(self, wanted, [item.reader() for item in self.quantities])

    def only(self, patterns: Sequence[str]) -> Columns:
        """The columns that patterns such as ``speed_pu:*`` name, in their order.

        Raises
        ------
        OptionError
            A pattern fits no column.
        """
        at = {name: k for k, name in zip(self.kept.tolist(), self.names, strict=True)}
        found: dict[int, None] = {}
        for pattern in patterns:
            fits = [pattern] if pattern in at else [n for n in at if fnmatchcase(n, pattern)]
            if not fits:
                raise OptionError(f"there is no column {pattern!r}{_nearest(pattern, at)}")
            found |= dict.fromkeys(at[name] for name in fits)
        return replace(self, kept=np.array(list(found), dtype=np.int64))


@dataclass
class RowReader:
    """Makes the rows of a table from the parts of one run, in order of time."""

    columns: Columns
    wanted: NDArray[np.int64]
    readers: Sequence[Reader]
    _seen: int = field(default=0)

    def take(self, part: Part) -> NDArray[np.float64]:
        """Rows of the next part, shape (n_rows, 1 + n_columns)."""
        if not len(part):
            return np.zeros((0, len(self.columns.header)))
        view = View(part, self.wanted)
        values = [read(view) for read in self.readers]
        every = self.columns.every
        rows = np.arange(-self._seen % every, len(part), every)
        self._seen += len(part)
        table = np.hstack(values)[np.ix_(rows, self.columns.kept)]
        return np.column_stack([part.times[rows], table])


def monitored(
    model: DetailedModel,
    monitor: str | Monitor = DEFAULT_MONITOR,
    study: Collection[int] | None = None,
    what: str = "monitor",
) -> Columns:
    """The columns that a monitor asks for.

    Parameters
    ----------
    model : DetailedModel
        The model of the intact network.
    monitor : str or Monitor
        For example ``"flow 101-103, voltage 1001-1050, every 5"``.
    study : collection of int, optional
        Buses of the study area, if there is one.
    what : str
        Where the monitor is from, for messages.

    Raises
    ------
    OptionError
        A part of the text has no meaning, or names what is not there: all such parts.
    """
    parsed = monitor if isinstance(monitor, Monitor) else parse_monitor(monitor, what)
    builder = _Builder(model, study)
    quantities: list[Quantity] = []
    faults: list[str] = []
    for statement in parsed.statements or parse_monitor(DEFAULT_MONITOR).statements:
        try:
            quantities += builder.quantities(statement)
        except OptionError as error:
            faults.append(str(error))
    if faults:
        raise OptionError(f"{what}: {'; '.join(faults)}")
    columns = Columns.of(quantities, parsed.every)
    if not columns.names:
        raise OptionError(f"{what}: nothing is chosen to be watched")
    return columns


@dataclass(frozen=True)
class _Builder:
    """Makes the quantities of statements."""

    model: DetailedModel
    study: Collection[int] | None

    @property
    def case(self) -> Case:
        return self.model.case

    def quantities(self, asked: Statement) -> list[Quantity]:
        if asked.kind in BUS_KINDS:
            return [self._of_buses(asked)]
        if asked.kind in LINE_KINDS:
            return [self._of_lines(asked)]
        if asked.kind in GROUP_KINDS:
            return self._of_groups(asked)
        return [self._of_machines(asked)]

    def _of_buses(self, asked: Statement) -> Quantity:
        numbers = select_buses(asked.places, self.case, asked.kind, self.study)
        if asked.kind == "load":
            loaded = {load.bus for load in self.case.loads if load.in_service}
            numbers = tuple(number for number in numbers if number in loaded) or numbers
        columns = self._positions(numbers)
        if asked.kind == "frequency":
            return Frequencies(numbers, columns, self.case.frequency_hz)
        if asked.kind == "load":
            return Loads(numbers, columns, self.case.base_mva)
        if asked.kind == "voltage_angle":
            return VoltageAngles(numbers, columns)
        return Voltages(numbers, columns)

    def _of_lines(self, asked: Statement) -> Quantity:
        lines = select_lines(asked.places, self.case, asked.kind, self.study)
        if not lines:
            raise OptionError(f"{asked.kind}: no line is chosen by {asked.places!r}")
        ends = BranchEnds(self.case, tuple(self._end(line) for line in lines))
        if asked.kind == "interface":
            return Interface(asked.label or asked.places, ends)
        labels = tuple(line_name(self.case, line) for line in lines)
        return Flows(labels, ends) if asked.kind == "flow" else Currents(labels, ends)

    def _end(self, line: LineEnd) -> End:
        return End(line.position, self.case.branches[line.position].from_bus != line.bus)

    def _of_groups(self, asked: Statement) -> list[Quantity]:
        numbers = select_numbers(asked.places, self.case, asked.kind, asked.word)
        return [self._group(asked.kind, number) for number in numbers]

    def _group(self, kind: str, number: int) -> Quantity:
        members = tuple(bus.number for bus in self.case.buses if getattr(bus, kind) == number)
        inside = set(members)
        units = [k for k, unit in enumerate(self.case.generators) if unit.bus in inside]
        return GroupSums(
            kind,
            number,
            members,
            self._positions(members),
            np.array(units, dtype=np.int64),
            BranchEnds(self.case, joined(self.case, members)),
        )

    def _of_machines(self, asked: Statement) -> Quantity:
        model, kind = self.model, asked.kind
        if kind == "generation":
            column = {unit.key: k for k, unit in enumerate(self.case.generators)}
            live = [unit.key for unit in self.case.generators if unit.in_service]
            units = self._machines(asked, live)
            at = np.array([column[unit] for unit in units], dtype=np.int64)
            return Generation(units, at, self.case.base_mva)
        signal = {"angle": "rotor_angle", "angle_coi": "rotor_angle"}.get(kind, kind)
        having = [u for u in self._sources if (u, signal) in model.layout.signal_slots]
        if kind in MACHINE_KINDS:
            having = list(model.machines)
        if not having:
            raise OptionError(self._no_signal(kind))
        units = self._machines(asked, having)
        slots = model.slots(signal, units)
        if kind == "angle_coi":
            at = np.array([model.machines.index(unit) for unit in units], dtype=np.int64)
            return RelativeAngles(units, slots, at)
        prefix = {"angle": "angle_deg", "speed": "speed_pu"}.get(kind, kind)
        return Signals(prefix, units, slots, 180 / np.pi if kind == "angle" else 1.0)

    def _machines(self, asked: Statement, among: Sequence[UnitKey]) -> tuple[UnitKey, ...]:
        return select_machines(asked.places, self.case, asked.kind, self.study, among)

    @property
    def _sources(self) -> list[UnitKey]:
        present = set(self.model.layout.source_units)
        return [unit.key for unit in self.case.generators if unit.key in present]

    def _no_signal(self, kind: str) -> str:
        signals = {signal for _, signal in self.model.layout.signal_slots}
        known = (*BUS_KINDS, *LINE_KINDS, *GROUP_KINDS, *MACHINE_KINDS)
        close = difflib.get_close_matches(kind, [*known, *sorted(signals)], n=1)
        if close:
            return f"there is no quantity {kind!r}; did you mean {close[0]!r}?"
        return (
            f"there is no quantity {kind!r}; known: {', '.join(known)}, and of the machines of this "
            f"case: {', '.join(sorted(signals))}"
        )

    def _positions(self, numbers: Sequence[int]) -> NDArray[np.int64]:
        return np.array([self.case.bus_index[number] for number in numbers], dtype=np.int64)


def column_filter(model: DetailedModel, patterns: Sequence[str]) -> Columns:
    """The columns that patterns of names choose, such as ``speed_pu:*``, of all that there could be."""
    prefixes = {"angle_deg": "angle", "speed_pu": "speed", "voltage_pu": "voltage"}
    signals = dict.fromkeys(signal for _, signal in model.layout.signal_slots)
    known = {name: prefixes.get(name, name) for name in (*prefixes, *signals)}
    heads = [pattern.partition(":")[0] for pattern in patterns]
    kinds = [known[name] for name in known if any(fnmatchcase(name, head) for head in heads)]
    if not kinds:
        raise OptionError(f"there is no column {patterns[0]!r}{_nearest(patterns[0], known)}")
    return monitored(model, ", ".join(kinds)).only(patterns)


def _nearest(name: str, known: Collection[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    if close:
        return f"; did you mean {close[0]!r}?"
    kinds = ", ".join(dict.fromkeys(item.partition(":")[0] for item in known))
    return f"; known: {kinds}, each with what it is of"
