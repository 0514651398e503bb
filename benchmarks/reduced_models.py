"""Speed of the reduced models on NPCC: whole runs, the cost of a step, and when reduction pays."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from report import Section, Table, machine, one_thread
from timing import interleave, rhs_calls

from gridfold import BusFault, DetailedModel, build_model, load_case, simulate
from gridfold.dynamics.area_model import Outputs
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.compare import compare
from gridfold.equivalents.families import ReducedExternal, SmallModel, reduce_external, whole_system
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.partition import Partition, partition
from gridfold.reduction import BalancedTruncation
from gridfold.runs.simulate import ModelStore

T_END = 16.0
FAULTS = {
    "0.39 s at bus 3": (BusFault(3, duration=0.39),),
    "0.03 s at bus 17": (BusFault(17, duration=0.03),),
}
STUDY_AREA = range(1, 37)

#: Thresholds of the angle deviation in degrees, as in the paper.
PARTITIONED, WHOLE = SwitchingRule(67.0), SwitchingRule(6.0)
HYBRID, LINEAR = SwitchingRule(0.0), SwitchingRule(float("inf"))

ORDERS = (20, 40, 60, 80, 100, 120, 149, 200)
KEPT = (0, 1, 2, 5, 10, 20, 39)

_CALLS = 200


@dataclass(frozen=True)
class Prepared:
    """Reduced models and the seconds that building them took."""

    parts: Partition
    partitioned: SmallModels
    polar: SmallModels
    whole: SmallModels
    seconds: dict[str, float]


Systems = dict[tuple[str, Outputs], SmallModel]


def prepare(model: DetailedModel) -> Prepared:
    """Partition, linearize and reduce; the second of two rounds is timed, with compiled code."""
    parts = partition(model, STUDY_AREA)
    for _ in range(2):
        began = time.perf_counter()
        partitioned = SmallModels(reduce_external(parts))
        partitioned.family.linear(model), partitioned.family.hybrid(model)
        middle = time.perf_counter()
        whole = SmallModels(whole_system(parts))
        whole.family.linear(model), whole.family.hybrid(model)
        done = time.perf_counter()
    family = partitioned.family
    assert isinstance(family, ReducedExternal)
    polar = SmallModels(replace(family, outputs=Outputs.POLAR))
    seconds = {"partitioned": middle - began, "whole": done - middle}
    return Prepared(parts, partitioned, polar, whole, seconds)


def run_actions(
    model: DetailedModel, ready: Prepared, events: tuple[BusFault, ...]
) -> dict[str, Callable[[], object]]:
    """One run with each model; all share the networks of the stages and the reduced models."""
    store: ModelStore = {}
    kinds = {
        "linear, partitioned": (ready.partitioned, LINEAR),
        "hybrid, partitioned": (ready.partitioned, HYBRID),
        "adaptive, partitioned": (ready.partitioned, PARTITIONED),
        "linear, partitioned, polar": (ready.polar, LINEAR),
        "adaptive, partitioned, polar": (ready.polar, PARTITIONED),
        "linear, whole": (ready.whole, LINEAR),
        "hybrid, whole": (ready.whole, HYBRID),
        "adaptive, whole": (ready.whole, WHOLE),
    }

    def reduced(small: SmallModels, rule: SwitchingRule) -> Callable[[], object]:
        return lambda: simulate_adaptive(model, small, rule, events, T_END, store=store)

    actions: dict[str, Callable[[], object]] = {
        "detailed": lambda: simulate(model, events, T_END, store=store)
    }
    return actions | {name: reduced(*kind) for name, kind in kinds.items()}


def run_table(
    title: str, model: DetailedModel, ready: Prepared, events: tuple[BusFault, ...]
) -> Table:
    """Times, ratios, errors and pay-back of every model for one fault."""
    actions = run_actions(model, ready, events)
    times = interleave(actions, 15)
    detailed = simulate(model, events, T_END)
    rows = []
    for name, action in actions.items():
        ratio = "" if name == "detailed" else str(times.ratio(name, "detailed"))
        error = paid = ""
        if name != "detailed":
            run = action().trajectory  # type: ignore[attr-defined]
            error = f"{compare(detailed, run, ready.parts.study_units).worst.rms_deg:.2f}"
            spent = ready.seconds["whole" if "whole" in name else "partitioned"]
            paid = pay_back(spent, times.median("detailed"), times.median(name))
        rows.append((name, times.scaled(name, 1e-3), ratio, error, paid))
    caption = f"16 s with a fault of {title}: milliseconds, ratios and angle errors (RMS, degrees):"
    heads = ("model", "min / median", "/ detailed", "worst study machine", "paid after")
    return Table(caption, heads, rows)


def pay_back(off_line: float, detailed: float, reduced: float) -> str:
    """Number of runs after which `off_line` seconds have been won back, or never."""
    gain = detailed - reduced
    return f"{int(np.ceil(off_line / gain))} runs" if gain > 0 else "never"


def step_table(caption: str, head: str, model: DetailedModel, systems: Systems) -> Table:
    """Microseconds of one right-hand side at the equilibrium, by the form of the outputs."""
    calls = {
        (name, form): rhs_calls(small.system.compiled, small.coordinates.restrict(model.x0), _CALLS)
        for (name, form), small in systems.items()
    }
    flat = {f"{name} {form.value}": action for (name, form), action in calls.items()}
    flat["detailed"] = rhs_calls(model.compiled, model.x0, _CALLS)
    times = interleave(flat, 40)
    rows = []
    for name in dict.fromkeys(name for name, _ in systems):
        cells = [times.scaled(f"{name} {form.value}", 1e-6 * _CALLS) for form in Outputs]
        rows.append((name, *cells))
    detailed = times.scaled("detailed", 1e-6 * _CALLS)
    rows.append(("detailed model", *(detailed for _ in Outputs)))
    return Table(caption, (head, *(f"outputs: {form.value}" for form in Outputs)), rows)


def by_order(model: DetailedModel, parts: Partition) -> Systems:
    """The linear partitioned model by order of the external area."""
    result = {}
    for order in ORDERS:
        family = reduce_external(parts, BalancedTruncation(order=order))
        for form in Outputs:
            result[str(order), form] = replace(family, outputs=form).linear(model)
    return result


def by_kept(model: DetailedModel, family: ReducedExternal) -> Systems:
    """The hybrid partitioned model by number of kept machines, the nearest first."""
    units = [family.coupling.units[k] for k in np.argsort(-family.coupling.norms)]
    return {
        (str(count), form): replace(family, kept=tuple(units[:count]), outputs=form).hybrid(model)
        for count in KEPT
        for form in Outputs
    }


def measure() -> Section:
    """Measure everything."""
    model = build_model(load_case("npcc"))
    ready = prepare(model)
    family = ready.partitioned.family
    assert isinstance(family, ReducedExternal)
    tables = [
        Table(
            "Off line, once for all contingencies, in seconds:",
            ("", "seconds"),
            [(name, f"{seconds:.2f}") for name, seconds in ready.seconds.items()],
        )
    ]
    tables += [run_table(title, model, ready, events) for title, events in FAULTS.items()]
    tables.append(
        step_table(
            "One right-hand side of the linear model by order of the external area, in "
            "microseconds, minimum / median:",
            "order",
            model,
            by_order(model, ready.parts),
        )
    )
    tables.append(
        step_table(
            f"The same of the hybrid model at order {family.reduction.order} by number of kept "
            "machines:",
            "kept machines",
            model,
            by_kept(model, family),
        )
    )
    remarks = (
        "One thread, everything compiled before; all lines of a table are measured in turn, ratios "
        "as above. Thresholds of the paper: 1 p.u., 67 and 6 degrees. The fault is simulated with "
        "the detailed model in every run. A step of Runge-Kutta takes four right-hand sides. *paid "
        "after* is the number of such runs whose gain makes up for the time off line. Outputs: "
        "*states* forms the states of all linear machines and their currents, as in the paper; "
        "*polar* takes the voltages they cause as linear in logarithm and angle.",
    )
    title = "Reduced models of NPCC"
    return Section(title, "reduced_models.py", tuple(tables), remarks)


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
