"""Run all benchmarks, print them and write the pages of the documentation that show them."""

from __future__ import annotations

import time

import clearing_times
import error_sweeps
import implicit_rule
import network_backends
import psse_cases
import public_cases
import reduced_models
import retained_machines
import second_case
import speed
import start
import verdicts
from report import Section, machine, one_thread, write

COMMAND = "python benchmarks/run_all.py"


def main() -> None:
    """Run everything; what is in `pages` gets pages of its own."""
    began = time.perf_counter()
    sections: list[Section] = []
    measures = (
        speed.measure,
        network_backends.measure,
        implicit_rule.measure,
        reduced_models.measure,
        second_case.measure,
    )
    for measure in measures:
        sections.append(measure())
        print(sections[-1], end="\n\n", flush=True)
    pages = (
        clearing_times.main,
        error_sweeps.main,
        retained_machines.main,
        verdicts.main,
        psse_cases.main,
        public_cases.main,
        start.main,
    )
    for page in pages:
        print(page(), end="\n\n", flush=True)
    write("benchmarks.md", "# Benchmarks", f"{machine()} All of it: `{COMMAND}`.", *sections)
    goals = [goal for section in sections for goal in section.goals]
    missed = [goal.figure for goal in goals if not goal.met]
    print(machine(), f"Goals not met: {', '.join(missed) or 'none'}.", sep="\n\n")
    print(f"Took {time.perf_counter() - began:.0f} s.")


if __name__ == "__main__":
    one_thread()
    main()
