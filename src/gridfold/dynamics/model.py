"""The detailed model: every device and the whole network, for one network state."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gridfold.cards import Card
from gridfold.dynamics.assemble import assemble, load_characteristics, negative_loads
from gridfold.dynamics.device import Device, Role
from gridfold.dynamics.device_functions import norton_admittance
from gridfold.dynamics.fast_modes import JOINED, FastModes, find_fast_modes
from gridfold.dynamics.initialize import OnLimit, Start, initialize
from gridfold.dynamics.jacobian import Partials, joined_partials
from gridfold.dynamics.layout import ROTOR_ANGLE, Block, Group, Layout, build_layout
from gridfold.dynamics.network import (
    Injections,
    NetworkBackend,
    NetworkEquations,
    build_equations,
    compile_with_loads,
    real_form,
)
from gridfold.dynamics.network.dc_ends import without_dead_lines
from gridfold.dynamics.network.loads import (
    LoadModel,
    NonlinearLoads,
    closed_with_loads,
    nonlinear_loads,
)
from gridfold.dynamics.network.shedding import without_shed
from gridfold.dynamics.own_kernels import try_once
from gridfold.dynamics.own_models import Devices, device_models, telling_own_errors
from gridfold.dynamics.plausible import model_doubts, naming_doubts
from gridfold.dynamics.registry import DEVICES
from gridfold.dynamics.rhs import pack_rhs
from gridfold.dynamics.settings import settled
from gridfold.dynamics.shedding import shed_devices
from gridfold.dynamics.unit_partials import UnitKernels
from gridfold.dynamics.unit_solver import UnitSolvers
from gridfold.errors import InitializationError, PowerFlowError
from gridfold.grid.admittance import bus_admittance
from gridfold.grid.case import Case, UnitKey
from gridfold.grid.doubts import Doubt
from gridfold.grid.islands import find_islands
from gridfold.grid.network_state import NetworkState
from gridfold.grid.nodes import joined, node_of_buses
from gridfold.grid.redispatch import redispatched
from gridfold.grid.timeline import initial_state
from gridfold.numerics.rhs import CompiledRhs
from gridfold.powerflow.newton import solve_power_flow
from gridfold.powerflow.result import PowerFlowResult
from gridfold.powerflow.rounding import rounding_power

#: Residual of the equilibrium below which nothing is said, and above which the model is refused; what
#: rounding in the network may leave is allowed besides (:func:`good_residual`).
RESIDUAL_GOOD, RESIDUAL_LIMIT = 1e-8, 1e-6
_LIMIT_MOVED = "limit moved to the start: "


class StartData(NamedTuple):
    """Layout and injections of a model as its case has them."""

    layout: Layout
    injections: Injections


class Origin(NamedTuple):
    """What models at any operating point of a case are made from.

    `devices` are all models by name, `layout` has the parameters as the case has them, `apart` are
    loads that are sources and nothing besides.
    """

    devices: Mapping[str, Device]
    layout: Layout
    apart: frozenset[UnitKey]


@dataclass(frozen=True, repr=False)
class DetailedModel(Card):
    """All dynamic devices of a case on its network in one state: x' = f(x).

    Build it with :func:`build_model`; :meth:`for_state` gives the same devices on another network.

    Parameters
    ----------
    power_flow : PowerFlowResult
        The operating point.
    layout : Layout
        Device blocks and the positions of all states and signals.
    x0 : ndarray, shape (n_states,)
        The equilibrium of the intact network.
    constants : ndarray
        Inputs that no device provides.
    injections : Injections
        Admittances of loads and machines.
    backend : NetworkBackend
        How the network equations are solved.
    state : NetworkState
        The network state.
    equations : NetworkEquations
        The network equations in that state.
    warnings : tuple of str
        What was noticed while building.
    doubts : tuple of Doubt
        Data of the case that are hardly meant.
    loads : LoadModel
        How loads depend on voltage.
    on_limit : OnLimit
        What was done where the operating point is beyond a limit of a device.
    start : StartData, optional
        Layout and injections before the network state changed them.
    origin : Origin, optional
        What the model was made from, before the start filled in set points.
    """

    power_flow: PowerFlowResult
    layout: Layout
    x0: NDArray[np.float64]
    constants: NDArray[np.float64]
    injections: Injections
    backend: NetworkBackend
    state: NetworkState
    equations: NetworkEquations
    warnings: tuple[str, ...] = ()
    loads: LoadModel = field(default_factory=LoadModel)
    doubts: tuple[Doubt, ...] = ()
    on_limit: OnLimit = OnLimit.ERROR
    start: StartData | None = field(default=None, repr=False)
    origin: Origin | None = field(default=None, repr=False)

    @cached_property
    def compiled(self) -> CompiledRhs:
        """The right-hand side, with its own solver for implicit steppers; made once it is asked for."""
        network = compile_with_loads(
            self.equations, self.backend, self.layout.terminals, self.injections
        )
        out = self.state.units_out
        rhs = pack_rhs(self.layout, self.constants, network, out)
        solver = UnitSolvers(self.layout, self.equations, self.injections.nonlinear, out, rhs)
        return replace(rhs, solver=solver)

    def _facts(self) -> dict[str, object]:
        return {
            "case": self.case.name,
            "machines": len(self.machines),
            "states": self.n_states,
            "loads": self.loads,
            "network": "intact" if self.state == NetworkState() else "changed",
            "warnings": len(self.warnings),
        }

    @property
    def case(self) -> Case:
        """The case."""
        return self.power_flow.case

    @property
    def state_names(self) -> tuple[str, ...]:
        """``name:BUS:ID`` of each state."""
        return self.layout.state_names

    @property
    def n_states(self) -> int:
        """Length of the state vector."""
        return self.layout.n_states

    @property
    def residual(self) -> float:
        """The largest derivative at the start, which should be zero."""
        return float(np.abs(self.compiled(self.x0)).max(initial=0.0))

    @property
    def own_devices(self) -> dict[str, str]:
        """SHA-256 of the code of each device model that is none of the package's, by its name."""
        devices = (block.device for block in self.layout.blocks)
        return {d.model: digest for d in devices if (digest := d.own_digest) is not None}

    @property
    def limits_moved(self) -> tuple[str, ...]:
        """Limits of devices that were moved to the start, in words."""
        moved = (line for line in self.warnings if line.startswith(_LIMIT_MOVED))
        return tuple(line.removeprefix(_LIMIT_MOVED) for line in moved)

    @cached_property
    def machines(self) -> tuple[UnitKey, ...]:
        """Units that have a rotor, in order of the case's generators."""
        return tuple(u for u in self.units if (u, ROTOR_ANGLE) in self.layout.signal_slots)

    @cached_property
    def units(self) -> tuple[UnitKey, ...]:
        """Units that feed a current into the network, in order of the case: generators, then loads."""
        present = set(self.layout.source_units)
        keys = [*(g.key for g in self.case.generators), *(load.key for load in self.case.loads)]
        return tuple(key for key in keys if key in present)

    def slots(self, name: str, units: tuple[UnitKey, ...]) -> NDArray[np.int64]:
        """Position in the signal vector (states come first) of signal `name` of `units`."""
        return np.array([self.layout.signal_slots[unit, name] for unit in units], dtype=np.int64)

    def inertia(self, units: tuple[UnitKey, ...]) -> NDArray[np.float64]:
        """Inertia constant H of `units` in s on the system base, shape (n_units,)."""
        found: dict[UnitKey, float] = {}
        for block in self.layout.blocks:
            if "inertia" in block.device.parameter_rows:
                row = block.parameters[block.device.parameter_rows.index("inertia")]
                found |= dict(zip(block.units, row, strict=True))
        return np.array([found[unit] for unit in units])

    def for_state(self, state: NetworkState) -> DetailedModel:
        """The same devices on the network in another state, with the settings of that.

        Another dispatch is solved for anew: the equilibrium `x0` is then another one.

        Raises
        ------
        EventError
            A setting names something that no device has, or gives an impossible value.
        PowerFlowError, InitializationError
            There is no equilibrium with another dispatch.
        """
        if state == self.state:
            return self
        if state.dispatch != self.state.dispatch:
            return self._redispatched(state.dispatch).for_state(state)
        start = self.start or StartData(self.layout, self.injections)
        layout, injections = (
            start.layout,
            without_shed(self.power_flow, start.injections, state.load_shed),
        )
        if state.settings:
            layout = settled(layout, state.settings, self.power_flow)
        layout = shed_devices(layout, state.load_shed)
        if layout is not start.layout:
            injections = replace(injections, machine=_machine_admittances(layout))
        injections = _in_state(self.power_flow, injections, state)
        equations = build_equations(self.power_flow, injections, layout.terminals, state)
        return replace(
            self,
            state=state,
            equations=equations,
            layout=layout,
            injections=injections,
            start=start,
        )

    def _redispatched(self, dispatch: Sequence[tuple[UnitKey, float]]) -> DetailedModel:
        """The model at the equilibrium of another dispatch, in the state of the case."""
        before = dict(self.state.dispatch)
        steps = {unit: -power for unit, power in before.items()}
        for unit, power in dispatch:
            steps[unit] = steps.get(unit, 0.0) + power
        try:
            model = self.at(solve_power_flow(redispatched(self.case, steps)))
        except (PowerFlowError, InitializationError) as error:
            raise type(error)(f"after the redispatch: {error}") from None
        return replace(model, state=replace(model.state, dispatch=tuple(dispatch)))

    def at(self, power_flow: PowerFlowResult) -> DetailedModel:
        """The model of the same network at another operating point, in the state of the case.

        The same as :func:`build_model` gives, at a fraction of its time: devices and places are known.

        Parameters
        ----------
        power_flow : PowerFlowResult
            Of a case that differs in powers, voltages and device parameters alone
            (:func:`gridfold.grid.operating_point.at_operating_point`); its data are not looked at for
            values that are hardly meant.

        Raises
        ------
        CaseError
            Parameters of devices are wrong; lists every fault.
        InitializationError
            A device has no equilibrium there, or is beyond a limit.
        """
        assert self.origin is not None
        devices, layout, apart = self.origin
        case, before = power_flow.case, self.injections.nonlinear
        nonlinear = _nonlinear(power_flow, self.loads, devices, apart)
        ports, known = (() if loads is None else loads.buses for loads in (nonlinear, before))
        rated = any(block.device.role is Role.LOAD for block in layout.blocks)
        if case.devices is not self.case.devices or ports != known or rated:
            groups = assemble(case, devices, self.case.devices)
            same = ports == known and layout.holds(groups)
            layout = layout.with_parameters(groups) if same else build_layout(groups, ports)
        rest = (self.backend, self.on_limit, self.loads, self.doubts)
        return _started(Origin(devices, layout, apart), power_flow, nonlinear, *rest)

    def with_blocks(self, blocks: Sequence[Block]) -> DetailedModel:
        """The same devices with other parameters, in this network state."""
        return replace(self, layout=replace(self.layout, blocks=tuple(blocks)))

    def signals(
        self, states: NDArray[np.float64], slots: NDArray[np.int64] | None = None
    ) -> NDArray[np.float64]:
        """Signal vectors at the states (n_times, n_states), or those at `slots` (m,) of them.

        Returns
        -------
        ndarray, shape (n_times, n_signals) or (n_times, m)
        """
        every = np.arange(self.layout.n_signals) if slots is None else slots
        return self.compiled.work_along(states, every)

    def bus_voltages(
        self, states: NDArray[np.float64], at: NDArray[np.int64] | None = None
    ) -> NDArray[np.complex128]:
        """Voltage phasor of every bus in per unit at the states: shape (n_times, n_buses).

        With `at` (m,) those of the buses at these positions of the case alone, (n_times, m).
        """
        live = [unit not in self.state.units_out for unit in self.layout.source_units]
        real, imag, terminal = self.layout.sources[live].T
        slots = np.concatenate([real, imag, self.layout.voltage_slots])
        injected, voltages = np.split(self.signals(states, slots), [2 * len(real)], axis=1)
        currents = np.zeros((len(self.layout.terminals), len(states)), dtype=np.complex128)
        for place, current in zip(terminal, _phasors(injected).T, strict=True):
            currents[place] += current
        loads = self.injections.nonlinear
        if loads is not None:
            places = loads.places(self.layout.terminals)
            currents[places] += loads.currents(_phasors(voltages)[:, places]).T
        return self.equations.bus_voltages(currents, at).T

    @cached_property
    def source_states(self) -> NDArray[np.int64]:
        """Positions of the states on which currents into the network, and so all voltages, depend."""
        blocks = [block for block in self.layout.blocks if block.device.sources]
        found = [np.zeros(0, dtype=np.int64), *(block.state_index.ravel() for block in blocks)]
        return np.concatenate(found)

    def terminal_voltages(self, states: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Voltages of the terminals in per unit at the states: shape (n_times, n_terminals)."""
        return _phasors(self.signals(states, self.layout.voltage_slots))

    def jacobian(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """df/dx at the state `x`, shape (n_states, n_states); exact to rounding."""
        x = np.asarray(x, dtype=float)
        return self.partials(x).close(self.network_response(x))

    def network_response(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slopes of the terminal voltages in the machines' currents, (2 n_terminals,) * 2."""
        voltages = self.terminal_voltages(x[None, :])[0]
        network = real_form(self.equations.terminal_impedance())
        return closed_with_loads(
            network, self.injections.nonlinear, voltages, self.layout.terminals
        )

    def partials(self, x: NDArray[np.float64]) -> Partials:
        """Partial derivatives of the devices at the state `x`, with the network left open."""
        x = np.asarray(x, dtype=float)
        voltages = self.signals(x[None, :], self.layout.voltage_slots)[0]
        slopes = self._kernels.slopes(x, voltages)
        return joined_partials(self._kernels.places, slopes, len(self.layout.terminals))

    @cached_property
    def fast_modes(self) -> FastModes:
        """The fastest modes and the fastest swing at the equilibrium."""
        network = self.network_response(self.x0) if self.n_states <= JOINED else None
        return find_fast_modes(self.partials(self.x0), network, self.layout)

    @property
    def _kernels(self) -> UnitKernels:
        """The devices on complex numbers."""
        assert isinstance(self.compiled.solver, UnitSolvers)
        return self.compiled.solver.kernels


def build_model(
    case: Case,
    power_flow: PowerFlowResult | None = None,
    backend: NetworkBackend = NetworkBackend.AUTO,
    devices: Devices = DEVICES,
    on_limit: OnLimit = OnLimit.ERROR,
    loads: LoadModel | None = None,
) -> DetailedModel:
    """Build the detailed model of a case at the equilibrium of its power flow.

    Parameters
    ----------
    case : Case
        The case, with device records.
    power_flow : PowerFlowResult, optional
        Its solution; solved here if not given.
    backend : NetworkBackend
        How the network equations are solved.
    devices : Device, iterable of Device, or mapping
        Device models of your own beside those of the package (:func:`gridfold.load_devices` reads
        them from files), or all models by name. The kernels of one that is none of the package's are
        tried once in plain Python before they are compiled.
    on_limit : OnLimit
        What to do where the operating point is beyond a limit of a device; limits that are moved are
        told in `warnings`.
    loads : LoadModel
        How loads depend on voltage; constant impedances at the solved voltage by default.

    Raises
    ------
    CaseError
        The case or its device records are wrong; lists every fault.
    PowerFlowError
        The power flow has no solution.
    InitializationError
        A device has no equilibrium there, or is beyond a limit: names device and equation.
    DeviceError
        A device model of your own is wrong: names file, device, kernel and row.

    Those of power flow and start name data that are hardly meant beside.
    """
    models = device_models(devices)
    with telling_own_errors(models.values()), naming_doubts(case, models):
        solved = solve_power_flow(case) if power_flow is None else power_flow
        return _built(solved, backend, models, on_limit, loads or LoadModel())


def _built(
    solved: PowerFlowResult,
    backend: NetworkBackend,
    devices: Mapping[str, Device],
    on_limit: OnLimit,
    loads: LoadModel,
) -> DetailedModel:
    groups = assemble(solved.case, devices)
    for device, _, parameters in groups:
        try_once(device, parameters)
    apart = _standing_apart(groups, load_characteristics(solved.case, devices))
    nonlinear = _nonlinear(solved, loads, devices, apart)
    layout = build_layout(groups, () if nonlinear is None else nonlinear.buses)
    doubts = model_doubts(solved, devices)
    origin = Origin(devices, layout, apart)
    return _started(origin, solved, nonlinear, backend, on_limit, loads, doubts)


def _standing_apart(
    groups: Sequence[Group], characteristics: Collection[UnitKey]
) -> frozenset[UnitKey]:
    """Loads that are sources, and nothing besides."""
    sources = {unit for device, units, _ in groups if device.role is Role.LOAD for unit in units}
    return frozenset(sources - set(characteristics))


def _nonlinear(
    solved: PowerFlowResult,
    loads: LoadModel,
    devices: Mapping[str, Device],
    apart: Collection[UnitKey],
) -> NonlinearLoads | None:
    """Parts of loads that are no impedances."""
    return nonlinear_loads(solved, loads, load_characteristics(solved.case, devices), apart)


def _started(
    origin: Origin,
    solved: PowerFlowResult,
    nonlinear: NonlinearLoads | None,
    backend: NetworkBackend,
    on_limit: OnLimit,
    loads: LoadModel,
    doubts: tuple[Doubt, ...],
) -> DetailedModel:
    """The model at its equilibrium, from a layout with the parameters of the case."""
    layout = origin.layout
    start = initialize(layout, solved, on_limit)
    state = initial_state(solved.case)
    injections = _in_state(solved, _injections(solved, start, nonlinear, origin.apart), state)
    equations = build_equations(solved, injections, layout.terminals, state)
    _require_voltage(layout, equations, solved.case)
    model = DetailedModel(
        solved,
        start.layout,
        start.x0,
        start.constants,
        injections,
        backend,
        state,
        equations,
        loads=loads,
        doubts=doubts,
        on_limit=on_limit,
        origin=origin,
    )
    moved = (_LIMIT_MOVED + line for line in start.adjusted)
    warnings = (*moved, *_check_equilibrium(start, model.compiled, solved))
    built = replace(model, warnings=warnings)
    vars(built)["compiled"] = model.compiled
    return built


def _require_voltage(layout: Layout, equations: NetworkEquations, case: Case) -> None:
    """Converters and devices of loads follow a voltage: a machine has to make it."""
    on = equations.islands.energized
    dead = [str(unit) for unit in layout.source_units if not on[case.bus_index[unit.bus]]]
    if dead:
        raise InitializationError(
            f"units that no machine in their island gives a voltage to follow: {', '.join(dead)}"
        )


def _phasors(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Complex numbers (n, k) from real and imaginary parts side by side (n, 2 k)."""
    real, imag = np.split(parts, 2, axis=1)
    return np.asarray(real + 1j * imag)


def _injections(
    power_flow: PowerFlowResult,
    start: Start,
    nonlinear: NonlinearLoads | None,
    apart: Collection[UnitKey],
) -> Injections:
    """What stands at the buses; loads that stand `apart` are sources, and nothing besides."""
    case, layout = power_flow.case, start.layout
    squared = np.abs(power_flow.voltage) ** 2
    absorbed = negative_loads(case)
    negative = {
        g.key: -complex(np.conj(power) / squared[case.bus_index[g.bus]])
        for g, power in zip(case.generators, power_flow.unit_power, strict=True)
        if g.key in absorbed and g.in_service
    }
    machine = _machine_admittances(layout)
    power = power_flow.load_power + power_flow.converter_power
    for load, drawn in power_flow.drawn_by_loads():
        if load.key in apart:
            power[case.bus_index[load.bus]] -= drawn
    norton = dict(zip(layout.source_units, start.currents.tolist(), strict=True))
    leading = frozenset(
        unit for block in layout.blocks if block.device.leads for unit in block.units
    )
    return Injections(np.conj(power) / squared, negative, machine, norton, leading, nonlinear)


def _machine_admittances(layout: Layout) -> dict[UnitKey, complex]:
    """Norton admittance of each machine."""
    machine: dict[UnitKey, complex] = {}
    for block in layout.blocks:
        if block.device.admittance is not None:
            rows = dict(zip(block.device.parameter_rows, block.parameters, strict=True))
            values = norton_admittance(block.device, rows, len(block.units))
            machine |= dict(zip(block.units, values.tolist(), strict=True))
    return machine


def _in_state(power_flow: PowerFlowResult, whole: Injections, state: NetworkState) -> Injections:
    """The injections in a network state: without dc lines of which an end is de-energized."""
    if not power_flow.case.dc_lines:
        return whole
    sources = (unit.bus for unit in whole.leading if unit not in state.units_out)
    islands = find_islands(power_flow.case, state.severed, sources)
    return without_dead_lines(power_flow, whole, islands)


def good_residual(power_flow: PowerFlowResult) -> float:
    """Residual below which an equilibrium is exact; more where branches have hardly an impedance."""
    case = power_flow.case
    admittance = joined(bus_admittance(case), node_of_buses(case))
    rounding = rounding_power(admittance, power_flow.voltage)
    return max(RESIDUAL_GOOD, float(rounding.max()))


def _check_equilibrium(
    start: Start, rhs: CompiledRhs, power_flow: PowerFlowResult
) -> tuple[str, ...]:
    residual = np.abs(rhs(start.x0)) if rhs.n_states else np.zeros(1)
    worst = int(np.argmax(np.nan_to_num(residual, nan=np.inf)))
    if residual[worst] < RESIDUAL_GOOD:
        return ()
    good = good_residual(power_flow)
    if residual[worst] < good:
        return ()
    message = (
        f"at the start d({start.layout.state_names[worst]})/dt is {residual[worst]:.3g}, "
        f"not 0 (below {good:.3g})"
    )
    if not residual[worst] < max(RESIDUAL_LIMIT, good):
        raise InitializationError(message)
    return (message,)
