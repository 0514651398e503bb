"""Speed of the reduced models on NPCC: whole runs, the cost of a step, and when reduction pays."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from folded_rows import LADDER, LINEAR, RETAINED, by_norm, error_texts, ready
from report import Section, Table, machine, one_thread
from timing import interleave, rhs_calls

from gridfold import (
    BalancedTruncation,
    BusFault,
    DetailedModel,
    Ladder,
    Partition,
    SmallModels,
    SwitchingRule,
    build_model,
    fold,
    load_case,
    partition,
    simulate,
    simulate_adaptive,
    whole_system,
)
from gridfold import reduce as printed
from gridfold.equivalents.adaptive import AdaptiveRun
from gridfold.equivalents.families import COLUMN_NORM, Mode, ModelFamily, SmallModel
from gridfold.equivalents.ranking import rank_retained
from gridfold.equivalents.swings import sample_swings
from gridfold.partition import couple
from gridfold.runs.simulate import ModelStore

T_END = 16.0
FAULTS = {
    "0.39 s at bus 3": (BusFault(3, duration=0.39),),
    "0.03 s at bus 17": (BusFault(17, duration=0.03),),
}
STUDY_AREA = range(1, 37)

#: Thresholds of the angle deviation in degrees, as in the paper.
PARTITIONED, WHOLE = SwitchingRule(67.0), SwitchingRule(6.0)

ORDERS = (10, 20, 30, 40, 60, 80, 120)
KEPT = (0, 1, 2, 5, 10, 20)

_CALLS, _ROUNDS = 200, 15


@dataclass(frozen=True)
class Choice:
    """A model: its small models, when it switches, and the seconds that they took."""

    small: SmallModels
    rule: SwitchingRule
    seconds: float


def prepare(parts: Partition) -> dict[str, Choice]:
    """Every model; the second of two rounds is timed, with compiled code."""
    kept = couple(parts).kept(COLUMN_NORM)

    def ladder() -> Ladder:
        swings = sample_swings(parts)
        areas = fold(parts, kept, swings=swings), fold(parts, swings=swings)
        return Ladder(areas, whole=True).measured()

    builders: dict[str, tuple[Callable[[], ModelFamily], SwitchingRule]] = {
        "linear": (lambda: Ladder((fold(parts),)), LINEAR),
        "retained": (lambda: Ladder((fold(parts, kept),)), RETAINED),
        "ladder": (ladder, LADDER),
        "printed, linear": (lambda: printed(parts), LINEAR),
        "printed, adaptive": (lambda: printed(parts), PARTITIONED),
        "printed, adaptive whole": (lambda: whole_system(parts), WHOLE),
    }
    return {name: _built(parts, *wanted) for name, wanted in builders.items()}


def _built(parts: Partition, build: Callable[[], ModelFamily], rule: SwitchingRule) -> Choice:
    for _ in range(2):
        began = time.process_time()
        small = ready(build(), parts)
        seconds = time.process_time() - began
    return Choice(small, rule, seconds)


def run_table(
    title: str, parts: Partition, chosen: dict[str, Choice], events: tuple[BusFault, ...]
) -> Table:
    """Times, ratios, errors and pay-back of every model for one fault."""
    model = parts.model
    store: ModelStore = {}

    def reduced(one: Choice) -> Callable[[], AdaptiveRun]:
        return lambda: simulate_adaptive(model, one.small, one.rule, events, T_END, store=store)

    runs = {name: reduced(one) for name, one in chosen.items()}
    actions: dict[str, Callable[[], object]] = {
        "detailed": lambda: simulate(model, events, T_END, store=store)
    }
    times = interleave(actions | runs, _ROUNDS)
    detailed = simulate(model, events, T_END)
    rows = [("detailed", times.scaled("detailed", 1e-3), *5 * [""])]
    for name, one in chosen.items():
        errors = error_texts(detailed, runs[name]().trajectory, parts.study_units)
        paid = pay_back(one.seconds, times.median("detailed"), times.median(name))
        spent = times.scaled(name, 1e-3), str(times.ratio(name, "detailed"))
        rows.append((name, *spent, *errors, f"{one.seconds:.2f}", paid))
    caption = f"16 s with a fault of {title}: milliseconds, ratios and angle errors in degrees:"
    heads = (
        "model", "min / median", "/ detailed", "RMS, COI", "RMS, unshifted", "off line, s",
        "paid after",
    )  # fmt: skip
    return Table(caption, heads, rows)


def pay_back(off_line: float, detailed: float, reduced: float) -> str:
    """Number of runs after which `off_line` seconds have been won back, or never."""
    gain = detailed - reduced
    return f"{int(np.ceil(off_line / gain))} runs" if gain > 0 else "never"


def step_table(
    caption: str, head: str, model: DetailedModel, systems: dict[str, SmallModel]
) -> Table:
    """Microseconds of one right-hand side at the equilibrium."""
    calls = {
        name: rhs_calls(small.system.compiled, small.coordinates.restrict(model.x0), _CALLS)
        for name, small in systems.items()
    }
    calls["detailed model"] = rhs_calls(model.compiled, model.x0, _CALLS)
    times = interleave(calls, 40)
    rows = [(name, times.scaled(name, 1e-6 * _CALLS)) for name in calls]
    return Table(caption, (head, "microseconds"), rows)


def by_order(parts: Partition) -> dict[str, SmallModel]:
    """The linear model by order of the folded area."""
    swings, model = sample_swings(parts), parts.model
    areas = {
        order: fold(parts, reducer=BalancedTruncation(order=order), swings=swings)
        for order in ORDERS
    }
    return {str(order): area.build(Mode.LINEAR, model) for order, area in areas.items()}


def by_kept(parts: Partition) -> dict[str, SmallModel]:
    """The folded model by number of retained machines, those of largest column norm."""
    swings, model = sample_swings(parts), parts.model
    ranking = rank_retained(parts, swings)
    found = {}
    for count in KEPT:
        area = fold(parts, by_norm(ranking, count), swings=swings)
        name = f"{count}: {len(area.ports.buses)} ports, order {area.bases.order}"
        found[name] = area.build(area.mode, model)
    return found


def measure() -> Section:
    """Measure everything."""
    model = build_model(load_case("npcc"))
    parts = partition(model, STUDY_AREA)
    chosen = prepare(parts)
    tables = [run_table(title, parts, chosen, events) for title, events in FAULTS.items()]
    caption = (
        "One right-hand side of the linear model by order of the external area, in microseconds, "
        "minimum / median:"
    )
    tables.append(step_table(caption, "order", model, by_order(parts)))
    caption = "The same by number of retained machines, those of largest column norm:"
    tables.append(step_table(caption, "retained", model, by_kept(parts)))
    remarks = (
        "One thread, everything compiled before; all lines of a table are measured in turn, ratios "
        "as above. *retained* and *ladder* retain the machines whose column norm is 1 p.u. or more. "
        "*printed*: as in the paper, with the states of linear machines formed; thresholds of 1 "
        "p.u., 67 and 6 degrees. The fault is simulated with the detailed model in every run. A step "
        "of Runge-Kutta takes four right-hand sides. *paid after* is the number of such runs whose "
        "gain makes up for the time off line.",
    )
    title = "Reduced models of NPCC"
    return Section(title, "reduced_models.py", tuple(tables), remarks)


if __name__ == "__main__":
    one_thread()
    print(measure(), machine(), sep="\n\n")
