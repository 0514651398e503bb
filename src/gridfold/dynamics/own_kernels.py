"""The first call of kernels that are none of the package's: guarded, in plain Python, then compiled."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from gridfold.dynamics.device import Device, Kernel, compiled_kernel
from gridfold.dynamics.guarded import (
    GuardedMatrix,
    NoNumberError,
    SlipError,
    interpreted,
    kernel_place,
    run_guarded,
)
from gridfold.dynamics.line_watch import LineWatch
from gridfold.dynamics.trial_points import TrialPoint, trial_points
from gridfold.errors import DeviceError

_LINE = re.compile(r'File "([^"]+)", line (\d+)')
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_tried: dict[tuple[int, ...], Device] = {}


def try_once(device: Device, parameters: NDArray[np.float64]) -> None:
    """Try the kernels of a device model of a user's own, once in a process.

    Parameters
    ----------
    device : Device
        The model; one whose kernels are all the package's is not tried.
    parameters : ndarray, shape (n_parameter_rows, n_units)
        Parameters of its units on the system base.

    Raises
    ------
    DeviceError
        A kernel leaves its rows, does not set one of them, has no value or cannot be compiled.
    """
    key = (id(device), *map(id, device.kernels.values()))
    if device.file is None or key in _tried:
        return
    faults = list(try_kernels(device, parameters))
    faults = faults or list(compile_faults(device))
    if faults:
        raise DeviceError(faults)
    _tried[key] = device


def try_kernels(
    device: Device,
    parameters: NDArray[np.float64],
    kernels: dict[str, Kernel] | None = None,
    watch: LineWatch | None = None,
) -> Iterator[str]:
    """Faults of the kernels, each in one line, at :func:`trial_points` about `parameters`.

    `kernels` are the interpreted ones, and `watch` what watches their lines, where the caller has them.
    What a kernel prints is not shown.
    """
    stages = interpreted_kernels(device) if kernels is None else kernels
    watch = LineWatch(stages.values()) if watch is None else watch
    trials = {stage: _Trial(device, stage, kernel, watch) for stage, kernel in stages.items()}
    points = list(trial_points(device, parameters))
    for dtype in (np.float64, np.complex128):
        for point in points if dtype is np.float64 else points[:1]:
            y = np.random.default_rng(1).uniform(
                0.2, 1.2, (len(device.signal_rows), point.x.shape[1])
            )
            y = y.astype(dtype)
            for trial in trials.values():
                y = trial.take(point, y, dtype)
    for trial in trials.values():
        yield from trial.faults()


def interpreted_kernels(device: Device) -> dict[str, Kernel]:
    """The kernels by stage, and all that they call, in plain Python."""
    return {stage: interpreted(kernel) for stage, kernel in device.kernels.items()}


@dataclass
class _Trial:
    """What became of one kernel."""

    device: Device
    stage: str
    kernel: Kernel
    watch: LineWatch
    slip: str = ""
    no_number: str = ""
    without_value: dict[str, int] = field(default_factory=dict)
    ordinary: int = 0
    failed: int = 0

    def take(self, point: TrialPoint, y: NDArray[Any], dtype: type) -> NDArray[Any]:
        """Try a point, unless it has slipped; returns the outputs y with its own ones set.

        What has no value at any ordinary point is not tried elsewhere.
        """
        if self.slip or (self.ordinary == self.failed and not point.is_ordinary):
            return y
        given = {"x": point.x, "u": point.u, "p": point.p, "y": y}
        self.ordinary += point.is_ordinary
        try:
            typed: dict[str, NDArray[Any]] = {
                name: rows.astype(dtype) for name, rows in given.items()
            }
            with self.watch.watching(), redirect_stdout(StringIO()):
                matrices = run_guarded(
                    self.device,
                    self.stage,
                    self.kernel,
                    typed,
                    may_divide_by_zero=not point.is_ordinary,
                )
        except NoNumberError as error:
            self.no_number = self.no_number or str(error)
            self.failed += point.is_ordinary
            return y
        except SlipError as error:
            self.slip = str(error)
            return y
        result = matrices["y"].values
        if point.is_ordinary:
            for name in _without_value(matrices["dx" if self.stage == "derivative" else "y"]):
                self.without_value[name] = self.without_value.get(name, 0) + 1
        return np.where(np.isfinite(result), result, y)

    def faults(self) -> Iterator[str]:
        name = f"device {self.device.model}, {self.stage} kernel"
        if self.slip:
            yield _told(self.slip, name)
        elif self.ordinary and self.failed == self.ordinary:
            yield _told(self.no_number, name)
        else:
            for row, count in self.without_value.items():
                if count + self.failed >= self.ordinary:
                    yield f"{kernel_place(self.kernel)}: {name}: {row} is never a finite number"


def _without_value(matrix: GuardedMatrix) -> Iterator[str]:
    for row in matrix.writable:
        if not np.isfinite(matrix.values[row]).all():
            yield f"row {row} of {matrix.role} ({matrix.names[row]})"


def _told(text: str, name: str) -> str:
    """``FILE:LINE: text`` with the kernel's name behind the place."""
    place, _, rest = text.partition(": ")
    return f"{place}: {name}: {rest}"


def compile_faults(device: Device) -> Iterator[str]:
    """What Numba finds in the kernels."""
    for stage, kernel in device.kernels.items():
        for is_complex in (False, True):
            try:
                compiled_kernel(kernel, is_complex)
            except NumbaError as error:
                text = _COLOUR.sub("", str(error))
                numbers = "complex" if is_complex else "real"
                yield (
                    f"{_numba_place(kernel, text)}: device {device.model}, {stage} kernel: "
                    f"it cannot be compiled for {numbers} numbers: {_reason(text)}"
                )
                break


def _numba_place(kernel: Kernel, text: str) -> str:
    """File and line that Numba's message names; its files are named from the folder at hand."""
    places = _LINE.findall(text)
    if not places:
        return kernel_place(kernel)
    file, line = places[-1]
    here = kernel.__code__.co_filename
    return f"{here if Path(file).resolve() == Path(here).resolve() else file}:{line}"


def _reason(text: str) -> str:
    """The line of Numba's message that says most."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    telling = [
        line
        for line in lines
        if line.startswith(("No implementation of function", "Untyped global", "Unknown attribute"))
        or "NameError" in line
        or "not supported" in line
        or "Invalid use" in line
    ]
    return (telling or lines or ["no reason given"])[0].replace(" found for signature:", "")
