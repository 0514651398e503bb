"""The command that compiles beforehand."""

from __future__ import annotations

import logging
from dataclasses import asdict

from gridfold.cli.console import err, out, speaks_to_people, stage_bars, write_json_option
from gridfold.cli.options import JsonOption
from gridfold.equivalents.warm_up import warm_up as run_warm_up
from gridfold.numerics.compile_notice import LOGGER
from gridfold.report.tables import facts_table


def warm_up(json: JsonOption = None) -> None:
    """Compile once what runs need, so that the first one starts at once.

    The code is kept for each version of gridfold, in NUMBA_CACHE_DIR or else in the user's cache.

    Example: gridfold warm-up
    """
    logging.getLogger(LOGGER).setLevel(logging.ERROR)  # nobody has to be told that it compiles
    with stage_bars() as bars:
        done = run_warm_up(lambda step, total: bars.show("compiling", step, total))
    write_json_option(json, asdict(done))
    if speaks_to_people(json):
        facts = {
            "Compiled functions": str(done.functions),
            "Kept in": done.folder,
            "Took": f"{done.seconds:.1f} s",
        }
        out.print(facts_table(facts))
    if done.temporary:
        err.print(
            "warning: no folder for compiled code can be written, so it is gone when this command "
            "ends; set NUMBA_CACHE_DIR to one that can",
            style="yellow",
        )
