"""Speed of the detailed model on NPCC: the price of being modular, of a run, and of the steppers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from fused import fuse, largest_difference
from report import Goal, Section, Table, machine, one_thread
from timing import Timings, interleave, network_calls, rhs_calls

from gridfold import (
    AdamsBashforthMoulton4,
    BusFault,
    DetailedModel,
    RungeKutta4,
    ScipyReference,
    Trajectory,
    build_model,
    load_case,
    simulate,
)
from gridfold.dynamics.network import compile_network
from gridfold.numerics.steppers import Stepper
from gridfold.runs.simulate import ModelStore

T_END = 16.0
EVENTS = (BusFault(3, start=0.0, duration=0.2),)
RK4, ABM4 = RungeKutta4(0.01), AdamsBashforthMoulton4(0.02)

#: Evaluations of the right-hand side in a run: 1,600 steps of four.
EVALUATIONS = 6400

_CALLS = 500


def time_rhs(model: DetailedModel, repetitions: int = 400) -> Timings:
    """Time the modular and the fused right-hand side and the network's part of the former.

    Raises
    ------
    AssertionError
        The two right-hand sides differ.
    """
    fused = fuse(model)
    assert largest_difference(fused, model.compiled, model.x0) < 1e-10
    network = compile_network(model.equations, model.backend)
    currents = np.random.default_rng(1).standard_normal(2 * len(model.layout.terminals))
    return interleave(
        {
            "modular": rhs_calls(model.compiled, model.x0, _CALLS),
            "fused": rhs_calls(fused, model.x0, _CALLS),
            "network": network_calls(network, currents, _CALLS),
        },
        repetitions,
    )


def time_runs(model: DetailedModel, repetitions: int = 60) -> Timings:
    """Time whole runs of both steppers, and as many right-hand sides as Runge-Kutta needs."""
    store: ModelStore = {}
    return interleave(
        {
            "rk4": lambda: _run(model, RK4, store),
            "rhs": rhs_calls(model.compiled, model.x0, EVALUATIONS),
            "abm4": lambda: _run(model, ABM4, store),
            "rk4, first": lambda: _run(model, RK4),
        },
        repetitions,
    )


def largest_errors(model: DetailedModel) -> dict[str, float]:
    """Largest rotor-angle error in degrees of each stepper, against SciPy at 1e-10."""
    reference = _run(model, ScipyReference(step=0.01, relative_tolerance=1e-10))
    return {stepper.name: _error(_run(model, stepper), reference) for stepper in (RK4, ABM4)}


def measure() -> Section:
    """Measure everything."""
    model = build_model(load_case("npcc"))
    rhs, runs, errors = time_rhs(model), time_runs(model), largest_errors(model)
    goals = (
        Goal("modular / fused right-hand side", rhs.ratio("modular", "fused").median, 1.5),
        Goal("run / its 6,400 right-hand sides", runs.ratio("rk4", "rhs").median, 1.25),
        Goal("run with ABM 4, 0.02 s / with RK 4, 0.01 s", runs.ratio("abm4", "rk4").median, 1 / 3),
    )
    remarks = (
        "RK 4 is Runge-Kutta, ABM 4 is Adams-Bashforth-Moulton. One thread, everything compiled "
        "before; all lines of a table are measured in turn, and the ratios are the ratio of the "
        "minima and the median of the ratios within each turn. Goals are judged by medians. Angle "
        "errors are those of all 48 machines over the whole run against `scipy.integrate.solve_ivp` "
        "(DOP853) at tolerances of 1e-10. The first run on a model also builds the network of the "
        "fault; further runs of a study share it.",
    )
    tables = (_rhs_table(rhs), _run_table(runs, errors))
    return Section("The detailed model on NPCC", "speed.py", tables, remarks, goals)


def _rhs_table(times: Timings) -> Table:
    return Table(
        "One right-hand side, 432 states, in microseconds:",
        ("", "min / median"),
        [
            ("modular", times.scaled("modular", 1e-6 * _CALLS)),
            ("fused by hand", times.scaled("fused", 1e-6 * _CALLS)),
            ("network equations alone", times.scaled("network", 1e-6 * _CALLS)),
            ("modular / fused", str(times.ratio("modular", "fused"))),
            ("network / modular", str(times.ratio("network", "modular"))),
        ],
    )


def _run_table(times: Timings, errors: Mapping[str, float]) -> Table:
    return Table(
        "16 s with a fault of 0.2 s at bus 3, synchronism watched, in milliseconds:",
        ("", "min / median", "largest angle error in degrees"),
        [
            ("RK 4, 0.01 s", times.scaled("rk4", 1e-3), f"{errors['rk4']:.2g}"),
            ("RK 4, 0.01 s, first run", times.scaled("rk4, first", 1e-3), ""),
            ("ABM 4, 0.02 s", times.scaled("abm4", 1e-3), f"{errors['abm4']:.2g}"),
            ("6,400 right-hand sides", times.scaled("rhs", 1e-3), ""),
            ("RK 4 / right-hand sides", str(times.ratio("rk4", "rhs")), ""),
            ("RK 4, first run / right-hand sides", str(times.ratio("rk4, first", "rhs")), ""),
            ("ABM 4 / RK 4", str(times.ratio("abm4", "rk4")), ""),
        ],
    )


def _run(model: DetailedModel, stepper: Stepper, store: ModelStore | None = None) -> Trajectory:
    return simulate(model, EVENTS, T_END, stepper, store=store)


def _error(run: Trajectory, reference: Trajectory) -> float:
    """Largest rotor-angle difference at the sampling times of `run`."""
    rows = np.isin(np.round(reference.times, 6), np.round(run.times, 6))
    difference = run.rotor_angle_deg() - reference.rotor_angle_deg()[rows]
    return float(np.abs(difference).max())


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
