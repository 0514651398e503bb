"""gridfold beside ANDES on the same files: how far they agree, and their time at equal accuracy.

Run by ``make bench-peers``, which makes the environments that ANDES lives in.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import agreement
import numpy as np
import times
from both import ENVIRONMENTS, FAULTS, FINE, T_TIMED, TIGHT, TIMED, environments, run_andes
from report import Goal, Table, machine, one_thread, write

#: gridfold should take at most this part of the time of ANDES on the first case.
GOAL = 1 / 100


def measure() -> Iterator[object]:
    """Parts of the page, one after another."""
    homes = environments()
    yield "# gridfold and ANDES"
    yield f"{machine()} ANDES {' and '.join(homes)}, one thread. All of it: `make bench-peers`."
    fine = {
        (version, study): run_andes(
            home, study, T_TIMED if study in TIMED else agreement.T_COMPARED, FINE, TIGHT
        )
        for version, home in homes.items()
        for study in FAULTS
    }
    yield "## Agreement"
    yield from agreement.tables(homes, fine)
    yield "## Time"
    pairs: dict[tuple[str, float], times.Pair | None] = {}
    for study in TIMED:
        runs = times.timed_runs(study, homes)
        errors = times.own_errors(study, runs, fine)
        yield times.time_table(study, runs, errors)
        for allowed in times.ALLOWED:
            pairs[study.case, allowed] = times.best_pair(runs, errors, allowed)
    yield times.ratio_table(pairs)
    yield times.first_in_process()
    pair = pairs[TIMED[0].case, np.inf]
    if pair is not None:
        figure = f"simulation of {TIMED[0].case}, gridfold / fastest of ANDES"
        goal = Goal(figure, 1 / pair.simulation, GOAL, digits=4)
        yield Table("Goal:", ("figure", "measured", "goal", "verdict"), [goal.row])


def main() -> str:
    """Measure and write the page; a message if something is absent."""
    missing = [path for study in FAULTS for path in study.paths if not path.is_file()]
    if missing:
        return f"{missing[0]} is absent; GRIDFOLD_CASES names the folder of public cases"
    if not environments():
        return f"there is no ANDES in {ENVIRONMENTS}; `make bench-peers` installs it"
    began = time.perf_counter()
    parts = []
    for part in measure():
        parts.append(part)
        print(part, end="\n\n", flush=True)
    write("peers.md", *parts)
    return f"Took {time.perf_counter() - began:.0f} s."


if __name__ == "__main__":
    one_thread()
    print(main())
