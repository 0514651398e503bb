"""One line where a program waits for its code to be compiled."""

from __future__ import annotations

import logging
import multiprocessing
import time
from threading import Lock

#: Seconds of compiling after which it is told: what takes less is not noticed.
_PATIENCE = 0.5
_TEXT = "gridfold: compiling, once, about 15 s (gridfold warm-up does it beforehand)"

#: Where it is told.
LOGGER = "gridfold.compiling"


class CompileNotice:
    """Adds up what this process compiles, and tells it once; workers of another process are silent.

    It is a warning of :data:`LOGGER`, and so goes to standard error if nothing else is set up.
    """

    def __init__(self) -> None:
        self._seconds = 0.0
        self._running: tuple[object, float] | None = None
        self._told = multiprocessing.parent_process() is not None
        self._lock = Lock()

    def begin(self, what: object) -> None:
        """Something is going to be compiled; what is compiled within it counts with it."""
        with self._lock:
            if not self._told and self._seconds + self._since() > _PATIENCE:
                self._told = True
                logging.getLogger(LOGGER).warning(_TEXT)
            if self._running is None:
                self._running = what, time.perf_counter()

    def end(self, what: object) -> None:
        """It is compiled."""
        with self._lock:
            if self._running is not None and self._running[0] == what:
                self._seconds += self._since()
                self._running = None

    def _since(self) -> float:
        return 0.0 if self._running is None else time.perf_counter() - self._running[1]


#: That of this process.
NOTICE = CompileNotice()
