"""Feeds spoilt input to readers, in a process whose memory and time are limited.

Reads lines ``TARGET FIRST LAST``. For each input it writes ``start TARGET NUMBER`` and then ``end
OUTCOME PEAK MESSAGE``, so that another process knows which one it was that ended this one.
"""

from __future__ import annotations

import resource
import signal
import sys
import traceback
from pathlib import Path

from fuzz.targets import TARGETS, Target

import gridfold as gf

#: Seconds that an input may take, which may name a device model that is not compiled yet, and a command
#: line; bytes beyond what the process has at the start.
TIME_LIMIT, COMMAND_LIMIT, MEMORY = 30, 60, 3 * 2**30
#: How an input may end.
OUTCOMES = ("refused", "read", "traceback", "hang")


class TooLong(BaseException):
    """The time for an input is over."""


def outcome_of(target: Target, name: str, content: bytes) -> tuple[str, str]:
    """How reading a file ends, and what there is to tell of it."""
    signal.signal(signal.SIGALRM, _ring)
    signal.alarm(COMMAND_LIMIT if target.name == "command" else TIME_LIMIT)
    try:
        target.feed(name, content)
    except gf.GridfoldError as error:
        return "refused", str(error)[:200]
    except TooLong:
        return "hang", _place()
    except BaseException as error:
        return "traceback", f"{type(error).__name__}: {str(error)[:200]} {_place()}"
    finally:
        signal.alarm(0)
    return "read", ""


def _ring(number: int, frame: object) -> None:
    raise TooLong


def _place() -> str:
    """The last lines of gridfold in a traceback."""
    frames = traceback.extract_tb(sys.exc_info()[2])
    ours = [f"{Path(f.filename).name}:{f.lineno}" for f in frames if "gridfold" in f.filename]
    return f"at {' '.join(ours[-2:])}"


def limit_memory() -> None:
    """No more than `MEMORY` beyond what there is now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def main(seed: int) -> None:
    """Do what standard input asks for."""
    answers, sys.stdout = sys.stdout, sys.stderr
    for line in sys.stdin:
        name, first, last = line.split()
        target = TARGETS[name]
        target.warm_up(seed)
        limit_memory()
        for number in range(int(first), int(last)):
            print("start", name, number, file=answers, flush=True)
            outcome, message = outcome_of(target, *target.make(seed, number))
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            print("end", outcome, peak, repr(message), file=answers, flush=True)
        print("done", name, last, file=answers, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
