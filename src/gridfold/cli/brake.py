"""Signals that end long work politely."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Event


@dataclass
class Brake:
    """What Ctrl-C and a polite kill (SIGTERM) do: stop the work; at once where it has not begun.

    A second one ends the process at once.
    """

    stop: Event = field(default_factory=Event)
    working: bool = False

    def pull(self, number: int, frame: object) -> None:
        """Handle a signal."""
        if self.stop.is_set() or not self.working:
            raise KeyboardInterrupt
        self.stop.set()


@contextmanager
def brake_on_signals() -> Iterator[Brake]:
    """A brake that both signals pull within the block."""
    brake, numbers = Brake(), (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, brake.pull) for number in numbers]
    try:
        yield brake
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
