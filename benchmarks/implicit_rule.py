"""The implicit trapezoidal rule: its price beside Runge-Kutta, in a stiff case, and in large grids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from chain import chain
from report import Goal, Section, Table, machine, one_thread
from timing import Action, Timings, interleave, rhs_calls, solver_calls

from gridfold import (
    BusFault,
    Case,
    DetailedModel,
    RungeKutta4,
    Trajectory,
    build_model,
    load_case,
    simulate,
)
from gridfold.dynamics.network.closed import FACTORED_FROM, ClosedNetworks
from gridfold.numerics.implicit import CompiledSolver
from gridfold.numerics.steppers import ImplicitTrapezoidal, Stepper
from gridfold.runs.simulate import ModelStore

T_END = 16.0
EVENTS = (BusFault(3, start=0.0, duration=0.2),)
COPIES = (1, 2, 4, 8, 16)

#: Time constant (s) of one exciter's amplifier, for which Runge-Kutta needs steps of 1 ms.
STIFF_UNIT, STIFF_TIME = "23:1", 0.0008

#: Run that the others are measured against.
FINE = RungeKutta4(0.0005)

_GAMMA, _CALLS = 0.005, 20

STEPPERS: dict[str, Stepper] = {
    "trapezoidal, 0.01 s": ImplicitTrapezoidal(0.01),
    "trapezoidal, tolerance 1e-4": ImplicitTrapezoidal(0.01, tolerance=1e-4),
    "RK 4, 0.01 s": RungeKutta4(0.01),
    "RK 4, 0.001 s": RungeKutta4(0.001),
}


def stiff_case() -> Case:
    """NPCC with one amplifier that is far too fast for Runge-Kutta with 10 ms."""
    case = load_case("npcc")
    devices = tuple(
        replace(record, parameters={**record.parameters, "regulator_time": STIFF_TIME})
        if record.model == "ieee_type1" and str(record.key) == STIFF_UNIT
        else record
        for record in case.devices
    )
    return replace(case, devices=devices)


def time_runs(model: DetailedModel, names: Sequence[str], repetitions: int = 30) -> Timings:
    """Time whole runs."""
    store: ModelStore = {}

    def action(stepper: Stepper) -> Action:
        return lambda: simulate(model, EVENTS, T_END, stepper, store=store)

    return interleave({name: action(STEPPERS[name]) for name in names}, repetitions)


def largest_error(model: DetailedModel, name: str, reference: Trajectory) -> float:
    """Largest rotor-angle error in degrees, at every 10 ms."""
    run = simulate(model, EVENTS, T_END, STEPPERS[name])
    sampled = [np.round(trajectory.times / 0.01, 6) % 1 == 0 for trajectory in (run, reference)]
    angles = [t.rotor_angle_deg()[rows] for t, rows in zip((run, reference), sampled, strict=True)]
    return float(np.abs(angles[0] - angles[1]).max())


@dataclass(frozen=True)
class Size:
    """Timings of the solver of one chain, and how far the two ways to close the network differ."""

    terminals: int
    states: int
    timings: Timings
    difference: float

    @property
    def row(self) -> tuple[str, ...]:
        """The row of the table."""
        pairs = [
            cell
            for what, calls in (("make", 1), ("solve", _CALLS))
            for cell in (
                self.timings.scaled(f"{what} dense", 1e-6 * calls),
                self.timings.scaled(f"{what} factored", 1e-6 * calls),
                str(self.timings.ratio(f"{what} dense", f"{what} factored")),
            )
        ]
        rhs = self.timings.scaled("rhs", 1e-6 * _CALLS)
        return str(self.terminals), str(self.states), rhs, *pairs, f"{self.difference:.1e}"


def time_size(case: Case, repetitions: int = 15) -> Size:
    """Time the making of a solver and its use, with both ways to close the network."""
    model = build_model(case)
    b = np.random.default_rng(1).standard_normal(model.n_states)
    actions = {"rhs": rhs_calls(model.compiled, model.x0, _CALLS)}
    found: list[CompiledSolver] = []
    for name, start in (("dense", 10**9), ("factored", 0)):
        assert model.compiled.solver is not None
        factory = replace(model.compiled.solver)
        factory.__dict__["networks"] = ClosedNetworks(model.equations, start)
        found.append(factory(model.x0, _GAMMA))
        actions[f"make {name}"] = lambda factory=factory: factory(model.x0, _GAMMA)
        actions[f"solve {name}"] = solver_calls(found[-1], b, _CALLS)
    difference = float(np.abs(found[0](b) - found[1](b)).max())
    n_terminals = len(model.layout.terminals)
    return Size(n_terminals, model.n_states, interleave(actions, repetitions), difference)


def measure(copies: Sequence[int] = COPIES) -> Section:
    """Measure everything."""
    case = load_case("npcc")
    common = ["trapezoidal, 0.01 s", "trapezoidal, tolerance 1e-4", "RK 4, 0.01 s"]
    plain, stiff = build_model(case), build_model(stiff_case())
    tables = [
        _run_table("NPCC", plain, common),
        _run_table(
            f"NPCC with an amplifier of {STIFF_TIME * 1e3:g} ms",
            stiff,
            [*common[:2], "RK 4, 0.001 s"],
        ),
    ]
    sizes = [time_size(chain(case, count)) for count in copies]
    heads = (
        "terminals", "states", "right-hand side",
        "making, dense", "making, factored", "dense / factored",
        "use, dense", "use, factored", "dense / factored", "largest difference",
    )  # fmt: skip
    tables.append(
        Table(
            "The solver of Newton's equation on chains of NPCC copies, in microseconds:",
            heads,
            [size.row for size in sizes],
        )
    )
    ratio = time_runs(plain, [common[0], common[2]]).ratio(common[0], common[2]).median
    remarks = (
        "Angle errors are the largest of all machines at every 10 ms against RK 4 with "
        "0.5 ms. Making a solver takes the "
        "Jacobian, and the inverses of all units; the network between the terminals is closed by its "
        "impedance matrix (dense) or factored, the latter from "
        f"{FACTORED_FROM} terminals on. Each iteration of a step takes a right-hand side and a use.",
    )
    goals = (Goal("run with the trapezoidal rule / with RK 4, both 0.01 s", ratio, 3.0),)
    return Section(
        "The implicit trapezoidal rule", "implicit_rule.py", tuple(tables), remarks, goals
    )


def _run_table(title: str, model: DetailedModel, names: Sequence[str]) -> Table:
    times = time_runs(model, names)
    reference = simulate(model, EVENTS, T_END, FINE)
    rows = [
        (
            name,
            times.scaled(name, 1e-3),
            str(times.ratio(name, names[-1])),
            f"{largest_error(model, name, reference):.2g}",
        )
        for name in names
    ]
    return Table(
        f"{title}, 16 s with a fault of 0.2 s at bus 3, synchronism watched, in milliseconds:",
        ("", "min / median", f"over {names[-1]}", "largest angle error in degrees"),
        rows,
    )


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
