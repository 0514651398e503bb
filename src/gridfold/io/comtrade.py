"""Records in COMTRADE, IEEE C37.111-1999 (IEC 60255-24): a ``.cfg`` and an ASCII ``.dat`` file.

Samples are whole numbers of five digits with a factor and an offset a channel, so that each is exact to
a part in 200,000 of its channel's range; a missing sample is 99999. Times are in microseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gridfold.errors import OptionError
from gridfold.io.results import replacing

#: The largest sample either way, and what stands for a missing one.
_LARGEST, _MISSING = 99998, 99999
#: The largest time in a record, of ten digits.
_LAST_TIME = 9_999_999_999
#: Letters of a name of a channel.
_NAME = 64
#: When the record of a simulation begins: it has no date of its own.
_DATE = "01/01/2000"
_TIME_STEP = 1e-6


@dataclass(frozen=True)
class Channel:
    """An analog channel: its name, its unit, and its samples (n,), NaN where they are missing."""

    name: str
    unit: str
    samples: NDArray[np.float64]


def write_comtrade(
    path: Path,
    station: str,
    device: str,
    times: NDArray[np.float64],
    channels: Sequence[Channel],
    frequency_hz: float,
    trigger: float = 0.0,
) -> None:
    """Write a record; its data go into a file of the same name that ends in ``.dat``.

    Parameters
    ----------
    path : Path
        The configuration file; its name ends in ``.cfg``.
    station, device : str
        Where the record is from.
    times : ndarray, shape (n,)
        In seconds, from the start of the record.
    channels : sequence of Channel
        The curves.
    frequency_hz : float
        Nominal frequency.
    trigger : float
        When something happens first, in seconds.

    Raises
    ------
    OptionError
        The name does not end in ``.cfg``.
    OutputError
        A file cannot be written.
    """
    check_name(path)
    multiplier = 10 ** max(0, len(str(int(times[-1] / _TIME_STEP))) - len(str(_LAST_TIME)))
    scales = [_scale(channel.samples) for channel in channels]
    lines = [
        f"{_text(station)},{_text(device)},1999",
        f"{len(channels)},{len(channels)}A,0D",
        *(
            f"{k},{_text(channel.name)},,,{_text(channel.unit)},{a!r},{b!r},0,{-_LARGEST},{_LARGEST},1,1,P"
            for k, (channel, (a, b)) in enumerate(zip(channels, scales, strict=True), start=1)
        ),
        f"{frequency_hz:g}",
        *_rates(times),
        f"{_DATE},{_clock(0.0)}",
        f"{_DATE},{_clock(trigger)}",
        "ASCII",
        f"{multiplier}",
    ]
    with replacing(path) as cfg, replacing(path.with_suffix(_data_suffix(path))) as dat:
        cfg.write_bytes(("\r\n".join(lines) + "\r\n").encode("ascii"))
        np.savetxt(
            dat, _rows(times, channels, scales, multiplier), fmt="%d", delimiter=",", newline="\r\n"
        )


def check_name(path: Path) -> None:
    """Raise :class:`OptionError` unless a record may have this name."""
    if path.suffix.lower() != ".cfg":
        raise OptionError(f"{path}: a record in COMTRADE ends in .cfg, not {path.suffix!r}")


def _data_suffix(path: Path) -> str:
    return ".DAT" if path.suffix == ".CFG" else ".dat"


def _scale(samples: NDArray[np.float64]) -> tuple[float, float]:
    """Factor and offset of a channel: value = factor * number + offset."""
    there = samples[np.isfinite(samples)]
    if not len(there):
        return 1.0, 0.0
    low, high = float(there.min()), float(there.max())
    middle = low + (high - low) / 2
    return (high - low) / (2 * _LARGEST) or 1.0, middle


def _rows(
    times: NDArray[np.float64],
    channels: Sequence[Channel],
    scales: Sequence[tuple[float, float]],
    multiplier: int,
) -> NDArray[np.int64]:
    columns = [np.arange(1, len(times) + 1), np.round(times / _TIME_STEP / multiplier)]
    for channel, (a, b) in zip(channels, scales, strict=True):
        there = np.isfinite(channel.samples)
        steps = np.round((np.where(there, channel.samples, b) - b) / a)
        columns.append(np.where(there, np.clip(steps, -_LARGEST, _LARGEST), _MISSING))
    return np.stack(columns, axis=1).astype(np.int64)


def _rates(times: NDArray[np.float64]) -> list[str]:
    """One sampling rate, or none where steps differ: then the times in the record count."""
    steps = np.diff(times)
    if len(steps) and np.allclose(steps, steps[0], rtol=1e-6, atol=_TIME_STEP / 2):
        return ["1", f"{1 / float(steps.mean()):.9g},{len(times)}"]
    return ["0", f"0,{len(times)}"]


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds / _TIME_STEP), 60_000_000)
    hours, minutes = divmod(minutes, 60)
    return f"{hours % 24:02d}:{minutes:02d}:{rest // 1_000_000:02d}.{rest % 1_000_000:06d}"


def _text(text: str) -> str:
    """A text as the format allows it: ASCII without commas, of limited length."""
    plain = text.encode("ascii", "replace").decode("ascii").replace(",", ";")
    return "".join(char if char.isprintable() else "?" for char in plain)[:_NAME]
