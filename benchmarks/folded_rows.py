"""Folded areas beside the detailed run: what is shared by the benchmarks of several grids."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from report import Table
from timing import interleave

from gridfold import (
    BusFault,
    Ladder,
    Partition,
    SmallModels,
    Status,
    SwitchingRule,
    Trajectory,
    UnitKey,
    build_model,
    compare,
    fold,
    load_case,
    partition,
    simulate,
    simulate_adaptive,
)
from gridfold.equivalents.families import Mode, ModelFamily
from gridfold.equivalents.folded import FoldedArea
from gridfold.equivalents.ranking import Ranking, rank_retained
from gridfold.equivalents.swings import sample_swings
from gridfold.runs.simulate import ModelStore

#: Thresholds of the ladder in degrees.
ANGLE_DEG, WHOLE_DEG = 67.0, 10.0
LINEAR = SwitchingRule(inf)
RETAINED = SwitchingRule(0.0, longest_above=inf)
LADDER = SwitchingRule(ANGLE_DEG, whole_deg=WHOLE_DEG)

HEADS = (
    "fault", "model", "ports", "order", "off line, s", "ms, median", "/ detailed",
    "RMS, COI", "RMS, unshifted", "models, %",
)  # fmt: skip


@dataclass(frozen=True)
class Candidate:
    """A model that is measured: the ports and the order of its linear area, seconds off line."""

    name: str
    small: SmallModels
    rule: SwitchingRule
    ports: str = ""
    order: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Candidates:
    """The models of one study area, and how its machines were ranked."""

    parts: Partition
    ranking: Ranking
    models: tuple[Candidate, ...]


def ready(family: ModelFamily, parts: Partition) -> SmallModels:
    """Small models with those of the intact network built."""
    small, model = SmallModels(family), parts.model
    for mode in set(family.modes) - {Mode.DETAILED}:
        small.get(model, mode)
        small.limits(model, mode)
    return small


def warm_up() -> None:
    """Compile what all grids need, so that seconds off line are those of the work."""
    candidates(partition(build_model(load_case("npcc")), range(1, 37)), 3)


def candidates(parts: Partition, count: int, norms: bool = True) -> Candidates:
    """Linear, `count` machines retained, the ladder of both; if wanted, retained by column norm."""
    clock = _Clock()
    swings = sample_swings(parts)
    swung = clock.lap()
    ranking = rank_retained(parts, swings)
    ranked = swung + clock.lap()
    far = fold(parts, swings=swings)
    linear = ready(Ladder((far,)), parts)
    folded = swung + clock.lap()
    near = fold(parts, ranking.first(count), swings=swings)
    retained = ready(Ladder((near,)), parts)
    refolded = clock.lap()
    ladder = ready(Ladder((near, far), whole=True).measured(), parts)
    whole = ranked + folded - swung + refolded + clock.lap()
    models = [
        _candidate("linear", linear, LINEAR, (far,), folded),
        _candidate("retained", retained, RETAINED, (near,), ranked + refolded),
        _candidate("ladder", ladder, LADDER, (near, far), whole),
    ]
    if norms:
        clock = _Clock()
        other = fold(parts, by_norm(ranking, count), swings=swings)
        nearest = ready(Ladder((other,)), parts)
        seconds = swung + clock.lap()
        models.append(_candidate("retained by norm", nearest, RETAINED, (other,), seconds))
    return Candidates(parts, ranking, tuple(models))


def _candidate(
    name: str,
    small: SmallModels,
    rule: SwitchingRule,
    areas: Sequence[FoldedArea],
    seconds: float,
) -> Candidate:
    ports = ", ".join(str(len(area.ports.buses)) for area in areas)
    order = ", ".join(str(area.bases.order) for area in areas)
    return Candidate(name, small, rule, ports, order, seconds)


class _Clock:
    """CPU seconds from one lap to the next."""

    def __init__(self) -> None:
        self._last = time.process_time()

    def lap(self) -> float:
        """Seconds since the last lap."""
        before, self._last = self._last, time.process_time()
        return self._last - before


def by_norm(ranking: Ranking, count: int) -> tuple[UnitKey, ...]:
    """The `count` machines of largest column norm."""
    pairs = zip(ranking.norms, ranking.units, strict=True)
    return tuple(unit for _, unit in sorted(pairs, key=lambda pair: -pair[0])[:count])


def fault_rows(
    found: Candidates, fault: BusFault, t_end: float, repetitions: int, store: ModelStore
) -> list[tuple[str, ...]]:
    """The detailed run and every model after one fault: times and errors."""
    model = found.parts.model
    runs: dict[str, Trajectory] = {}
    uses: dict[str, str] = {}

    def detailed() -> None:
        runs["detailed"] = simulate(model, (fault,), t_end, store=store)

    def reduced(one: Candidate) -> Callable[[], None]:
        def run() -> None:
            done = simulate_adaptive(model, one.small, one.rule, (fault,), t_end, store=store)
            runs[one.name], uses[one.name] = done.trajectory, shares(done.trajectory, done.modes)

        return run

    actions: dict[str, Callable[[], object]] = {"detailed": detailed}
    actions |= {one.name: reduced(one) for one in found.models}
    times = interleave(actions, repetitions)
    where = f"bus {fault.bus}, {fault.duration:g} s"
    exact = runs["detailed"]
    spent = _ms(times.median("detailed"))
    rows = [(where, _told(exact, "detailed"), "", "", "", spent, "", "", "", "")]
    for one in found.models:
        errors = error_texts(exact, runs[one.name], found.parts.study_units)
        ratio = f"{times.ratio(one.name, 'detailed').median:.2f}"
        about = where, one.name, one.ports, one.order, f"{one.seconds:.1f}"
        rows.append((*about, _ms(times.median(one.name)), ratio, *errors, uses[one.name]))
    return rows


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


def _told(run: Trajectory, name: str) -> str:
    return name if run.status is Status.COMPLETED else f"{name}: {run.status.value}"


def error_texts(
    detailed: Trajectory, run: Trajectory, units: tuple[UnitKey, ...]
) -> tuple[str, str]:
    """Worst RMS error against the centre of inertia, and unshifted, in degrees."""
    if run.status is not Status.COMPLETED or detailed.status is not Status.COMPLETED:
        return f"{run.status.value} at {run.times[-1]:.2f} s", ""
    errors = compare(detailed, run, units)
    relative = max(error.relative_rms_deg for error in errors.units)
    return f"{relative:.3f}", f"{errors.worst.rms_deg:.3f}"


def shares(run: Trajectory, modes: Iterable[Mode]) -> str:
    """Share of the simulated time with each model that was used, in percent."""
    spent: dict[Mode, float] = {}
    for piece, mode in zip(run.run.pieces, modes, strict=False):
        spent[mode] = spent.get(mode, 0.0) + float(piece.times[-1] - piece.times[0])
    whole = sum(spent.values())
    return ", ".join(
        f"{mode.value} {100 * spent[mode] / whole:.0f}" for mode in Mode if mode in spent
    )


def fault_table(
    found: Candidates, faults: Iterable[BusFault], t_end: float, repetitions: int
) -> Table:
    """All faults of one study area; runs share the networks of their stages."""
    store: ModelStore = {}
    rows = [row for fault in faults for row in fault_rows(found, fault, t_end, repetitions, store)]
    caption = f"{t_end:g} s, worst study-area machine, errors in degrees:"
    return Table(caption, HEADS, rows)


def steps(found: Candidates) -> Mapping[Mode, float]:
    """Seconds of a step with each rung of the ladder, as they were measured off line."""
    family = next(one.small.family for one in found.models if one.name == "ladder")
    assert isinstance(family, Ladder)
    return family.step_seconds


def step_table(found: Candidates) -> Table:
    """What a step takes with each rung of the ladder."""
    spent = steps(found)
    rows = [
        (mode.value, f"{1e6 * seconds:.1f}", f"{seconds / spent[Mode.DETAILED]:.2f}")
        for mode, seconds in spent.items()
    ]
    return Table(
        "A step of each rung of the ladder:", ("model", "microseconds", "/ detailed"), rows
    )


def score_table(ranking: Ranking, count: int) -> Table:
    """The machines of the highest scores, with their column norms."""
    return Table(
        f"The {count} machines of largest score, with their place by column norm:",
        ("machine", "score", "power defect, p.u.", "column norm, p.u.", "place by norm"),
        list(_score_rows(ranking, count)),
    )


def _score_rows(ranking: Ranking, count: int) -> Iterator[tuple[str, ...]]:
    place = {unit: k + 1 for k, unit in enumerate(by_norm(ranking, len(ranking.units)))}
    columns = zip(ranking.units, ranking.scores, ranking.power_defects, ranking.norms, strict=True)
    for unit, score, power, norm in list(columns)[:count]:
        yield str(unit), f"{score:.3f}", f"{power:.3f}", f"{norm:.3f}", str(place[unit])
