"""Feed spoilt input to every reader for some minutes, and go on where the last time ended.

``python -m fuzz --minutes 10 --seed 1``. Input that ends in anything but a result or a refusal is put
into ``corpus``, where tests read it from then on.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from fuzz.campaign import CORPUS, Campaign, Tally
from fuzz.targets import TARGETS

STATE = Path(".fuzz.json")
_ROUND = 200


def main() -> None:
    """Fuzz in rounds over all readers until the time is over; then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--targets", default=",".join(TARGETS))
    options = parser.parse_args()
    state = _read_state(options.seed)
    end = time.monotonic() + 60 * options.minutes
    with Campaign(options.seed, end, CORPUS) as campaign:
        while time.monotonic() < end:
            for name in options.targets.split(","):
                tally = state.setdefault(name, Tally())
                size = _ROUND // 10 if name == "command" else _ROUND
                campaign.run(name, tally, tally.inputs + size)
                _write_state(options.seed, state)
    print(_table(options.seed, state))


def _table(seed: int, state: dict[str, Tally]) -> str:
    from report import Table, machine, write

    rows = [(name, *map(str, tally.figures)) for name, tally in state.items()]
    total = Tally()
    for tally in state.values():
        total.add(tally)
    rows.append(("all", *map(str, total.figures)))
    head = ("reader", "inputs", "refused", "read", "tracebacks", "hangs", "crashes", "peak MiB")
    what = (
        f"`make fuzz` (seed {seed}): sound files spoilt in their bytes, lines, tokens, numbers and "
        "fields, and command lines of any options and values. Refused: an error of gridfold's own, "
        "or exit code 2. A process of its own reads them, with 30 s (a command line 60 s) and 3 GiB."
    )
    table = str(Table(what, head, tuple(rows)))
    write("fuzz.md", table, machine())
    return table


def _read_state(seed: int) -> dict[str, Tally]:
    if not STATE.exists():
        return {}
    content = json.loads(STATE.read_text(encoding="utf-8"))
    return {name: Tally(**figures) for name, figures in content.get(str(seed), {}).items()}


def _write_state(seed: int, state: dict[str, Tally]) -> None:
    content = json.loads(STATE.read_text(encoding="utf-8")) if STATE.exists() else {}
    content[str(seed)] = {name: vars(tally) for name, tally in state.items()}
    unfinished = STATE.with_suffix(".new")
    unfinished.write_text(json.dumps(content, indent=1), encoding="utf-8")
    unfinished.replace(STATE)


if __name__ == "__main__":
    main()
