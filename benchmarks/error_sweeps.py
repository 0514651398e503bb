"""Error in the time domain along the order of the external area and the number of kept machines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from report import GENERATED, Section, Table, machine, one_thread, write

from gridfold import (
    BalancedTruncation,
    BusFault,
    DetailedModel,
    Partition,
    Status,
    SwitchingRule,
    Trajectory,
    build_model,
    compare,
    critical_clearing_time,
    load_case,
    partition,
    simulate,
    simulate_adaptive,
)
from gridfold.equivalents.families import ReducedExternal, reduce_external
from gridfold.partition import linearize_external
from gridfold.report.sweeps import Curve, Panel, plot_panels

T_END = 16.0
STUDY_AREA = range(1, 37)
BUSES, SHARE = (3, 23), 0.9

ORDERS = tuple(range(20, 201, 20))
KEPT = (0, 1, 2, 3, 5, 8, 12, 20, 30, 39)
#: Order while the number of kept machines changes: that of the paper's bound of 1e-5.
ORDER = 149

#: Rules by model: while the order changes, and while the number of kept machines does. To look for a
#: new operating point changes nothing here, and would add a sample to the run.
ADAPTIVE = SwitchingRule(67.0, longest_above=math.inf)
BY_ORDER = {"linear": SwitchingRule(math.inf, longest_above=math.inf), "adaptive": ADAPTIVE}
BY_KEPT = {"hybrid": SwitchingRule(0.0, longest_above=math.inf), "adaptive": ADAPTIVE}

#: In rad/s, where the transfer functions are compared.
FREQUENCIES = np.concatenate([[0.0], np.logspace(-3, 3, 240)])

#: Order from which on the measured error of the transfer matrix is below 1e-3 of its first value.
SETTLED = 100

#: A change of less than this share of the error before counts as none.
EVEN = 0.01

#: Error in degrees by fault and model; NaN for a run that did not reach the end.
Errors = dict[tuple[int, str], float]


@dataclass(frozen=True)
class Setting:
    """The partitioned system, the faults by bus, and their detailed runs."""

    parts: Partition
    faults: dict[int, BusFault]
    detailed: dict[int, Trajectory]

    @property
    def model(self) -> DetailedModel:
        """The detailed model."""
        return self.parts.model


def prepare() -> Setting:
    """Find the clearing times and simulate the detailed model."""
    model = build_model(load_case("npcc"))
    faults = {}
    for bus in BUSES:
        seconds = critical_clearing_time(model, BusFault(bus), t_end=T_END).seconds
        faults[bus] = BusFault(bus, duration=round(SHARE * seconds, 6))
    detailed = {bus: simulate(model, [fault], T_END) for bus, fault in faults.items()}
    return Setting(partition(model, STUDY_AREA), faults, detailed)


def errors(setting: Setting, family: ReducedExternal, rules: Mapping[str, SwitchingRule]) -> Errors:
    """Error (19) of the worst study-area machine after each fault, by model."""
    found = {}
    for bus, fault in setting.faults.items():
        for name, rule in rules.items():
            run = simulate_adaptive(setting.model, family, rule, [fault], T_END).trajectory
            found[bus, name] = math.nan
            if run.status is Status.COMPLETED:
                compared = compare(setting.detailed[bus], run, setting.parts.study_units)
                found[bus, name] = compared.worst.rms_deg
    return found


@dataclass(frozen=True)
class OrderPoint:
    """A reduced model of one order: bound (6), measured error of the transfer matrix, and errors."""

    order: int
    bound: float
    measured: float
    errors: Errors


def by_order(setting: Setting) -> list[OrderPoint]:
    """Reduce to each order."""
    linear = linearize_external(setting.parts, setting.model, setting.model.x0)
    full = linear.system.transfer(1j * FREQUENCIES)
    points = []
    for order in ORDERS:
        family = reduce_external(setting.parts, BalancedTruncation(order=order))
        measured = _largest_gain(full - family.reduction.system.transfer(1j * FREQUENCIES))
        bound = family.reduction.bound
        assert bound is not None
        points.append(OrderPoint(order, bound, measured, errors(setting, family, BY_ORDER)))
    return points


def _largest_gain(response: NDArray[np.complex128]) -> float:
    """Largest singular value over all frequencies, of a response (n_frequencies, p, m)."""
    return float(np.linalg.norm(response, 2, axis=(1, 2)).max())


@dataclass(frozen=True)
class KeptPoint:
    """A number of kept machines, the smallest column norm (p.u.) of one kept, and the errors."""

    count: int
    norm: float
    errors: Errors


def by_kept(setting: Setting) -> list[KeptPoint]:
    """Keep more and more machines, the nearest first."""
    family = reduce_external(setting.parts, BalancedTruncation(order=ORDER))
    coupling = family.coupling
    nearest = np.argsort(-coupling.norms)
    points = []
    for count in KEPT:
        kept = tuple(coupling.units[k] for k in nearest[:count])
        norm = float(coupling.norms[nearest[:count]].min(initial=math.inf))
        found = errors(setting, replace(family, kept=kept), BY_KEPT)
        points.append(KeptPoint(count, norm, found))
    return points


def order_table(points: Sequence[OrderPoint]) -> Table:
    """Bound, measured error and errors in the time domain by order."""
    heads = ("r", "bound (6)", "measured", *_names(points[0].errors))
    rows = [
        (str(p.order), f"{p.bound:.2e}", f"{p.measured:.2e}", *_texts(p.errors)) for p in points
    ]
    caption = "By the order r of the external area; adaptive with the machines of 1 p.u. kept."
    return Table(caption, heads, rows)


def kept_table(points: Sequence[KeptPoint]) -> Table:
    """Errors in the time domain by number of kept machines."""
    heads = ("kept", "column norm of the last, p.u.", *_names(points[0].errors))
    rows = [(str(p.count), f"{p.norm:.3f}" if p.count else "-", *_texts(p.errors)) for p in points]
    caption = f"By the number of kept machines, the largest column norm first; order {ORDER}."
    return Table(caption, heads, rows)


def _names(found: Errors) -> list[str]:
    return [f"bus {bus}, {name}" for bus, name in found]


def _texts(found: Errors) -> list[str]:
    return ["lost" if math.isnan(value) else f"{value:.3f}" for value in found.values()]


def rises(what: str, curves: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """A sentence that tells between which points of `curves` the error rises."""
    found = {name: _steps_up(points) for name, points in curves.items()}
    told = [f"{name} ({', '.join(steps)})" for name, steps in found.items() if steps]
    even = [name for name, steps in found.items() if not steps]
    size = f"{100 * EVEN:g} % or more with {what}"
    if not told:
        return f"Nowhere does the error rise by {size}."
    rest = f" Nowhere does it in: {'; '.join(even)}." if even else ""
    return f"The error rises by {size} in: {'; '.join(told)}.{rest}"


def _steps_up(points: Iterable[tuple[float, float]]) -> list[str]:
    """Steps that go up, the ends of each; beside a run that was lost nothing is said."""
    return [
        f"{x:g} to {further:g} by {100 * (after / before - 1):.0f} %"
        for (x, before), (further, after) in pairwise(points)
        if after >= (1 + EVEN) * before
    ]


def _curves(points: Sequence[tuple[int, Errors]]) -> dict[str, list[tuple[float, float]]]:
    keys = zip(points[0][1], _names(points[0][1]), strict=True)
    return {name: [(float(x), found[key]) for x, found in points] for key, name in keys}


def _spread(points: Sequence[OrderPoint], name: str) -> float:
    """Largest less smallest error of a model from order SETTLED on, the larger of all faults."""
    late = [p.errors for p in points if p.order >= SETTLED]
    values = np.array([[found[bus, name] for bus in BUSES] for found in late])
    return float(np.ptp(values, axis=0).max())


def draw(orders: Sequence[OrderPoint], kept: Sequence[KeptPoint]) -> None:
    """The figure beside the page."""
    transfer = [
        Curve("bound (6)", [(p.order, p.bound) for p in orders], 2),
        Curve("measured", [(p.order, p.measured) for p in orders], 3),
    ]
    degrees = "Worst RMS rotor-angle\nerror (degrees)"
    panels = [
        Panel("Transfer function", "Order r", "Largest singular value", transfer, True),
        Panel(
            "Time domain, by order",
            "Order r",
            degrees,
            _lines(_curves([(p.order, p.errors) for p in orders])),
        ),
        Panel(
            f"Time domain, by kept machines (order {ORDER})",
            "Kept machines",
            degrees,
            _lines(_curves([(p.count, p.errors) for p in kept])),
            True,
        ),
    ]
    plot_panels(panels, GENERATED / "error_sweeps.png")


def _lines(curves: Mapping[str, Sequence[tuple[float, float]]]) -> list[Curve]:
    """One colour for each bus; the adaptive model dashed."""
    return [
        Curve(f"fault at {name}", points, color=k // 2, dashed="adaptive" in name)
        for k, (name, points) in enumerate(curves.items())
    ]


def measure() -> Section:
    """Run everything and draw the figure."""
    setting = prepare()
    orders, kept = by_order(setting), by_kept(setting)
    draw(orders, kept)
    obeyed = sum(p.measured <= p.bound for p in orders)
    faults = ", ".join(f"{f.duration:g} s at bus {bus}" for bus, f in setting.faults.items())
    measured = {"the measured transfer function": [(float(p.order), p.measured) for p in orders]}
    in_time = _curves([(p.order, p.errors) for p in orders])
    remarks = (
        f"Faults: {faults}, {100 * SHARE:g} % of the critical clearing time on a grid of 0.01 s. "
        f"Runs of {T_END:g} s. Error (19) of the worst study-area machine in degrees; *adaptive* "
        f"switches at {ADAPTIVE.angle_deg:g} degrees, *hybrid* is hybrid all the time, *lost* is a "
        "run that did not reach the end.",
        f"Measured: the largest singular value of the error of the transfer matrix at "
        f"{len(FREQUENCIES)} frequencies from 0 to {FREQUENCIES[-1]:g} rad/s. It obeys the bound "
        f"at {obeyed} of {len(orders)} orders.",
        rises("the order", measured | in_time),
        rises("the number of kept machines", _curves([(p.count, p.errors) for p in kept])),
        f"From order {SETTLED} on errors in time still move by up to {_spread(orders, 'linear'):.3f} "
        f"degrees (linear) and {_spread(orders, 'adaptive'):.3f} degrees (adaptive). The bound is one "
        "of the linear response to the boundary voltages from rest. In the hybrid model the kept "
        "machines also act from within the external area, and where the detailed model ends its "
        "state is projected; the bound covers neither.",
    )
    return Section(
        "Errors along order and kept machines",
        "error_sweeps.py",
        (order_table(orders), kept_table(kept)),
        remarks,
    )


def main() -> Section:
    """Measure, and write the page."""
    section = measure()
    write("error_sweeps.md", "# Error sweeps", section, machine())
    return section


if __name__ == "__main__":
    one_thread()
    print(main(), machine(), sep="\n\n")
