"""Try a device model: its kernels, and the tests that every model of the package passes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from gridfold.dynamics.assemble import assemble
from gridfold.dynamics.device import Device
from gridfold.dynamics.evaluate import derivative_stage, output_stage, source_stage
from gridfold.dynamics.line_watch import LineWatch
from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.own_kernels import compile_faults, interpreted_kernels, try_kernels
from gridfold.dynamics.own_models import device_models, record_names, telling_own_errors
from gridfold.dynamics.trial_points import TrialPoint, trial_points
from gridfold.errors import CaseError, DeviceError, GridfoldError
from gridfold.runs.limit_check import limits_found
from gridfold.runs.trial_case import trial_case, trial_values

#: Largest derivative at the start, and largest error of the Jacobian against differences.
AT_REST, JACOBIAN = 1e-8, 1e-5
_DIFFERENCE, _AWAY = 1e-6, 1e-3
#: Difference between compiled and interpreted kernels that rounding may make.
_ROUNDING = 1e-9
_SHOWN_LINES = 6


@dataclass(frozen=True)
class Finding:
    """What one test found; `passed` is None where it could not be made."""

    test: str
    passed: bool | None
    text: str


@dataclass(frozen=True)
class DeviceCheck:
    """What all tests found about a device model.

    Parameters
    ----------
    device : Device
        The model.
    values : mapping
        Parameters that it was tried with.
    findings : tuple of Finding
        One or more for each test.
    records : tuple of str
        Model names of the PSS/E records that it answers.
    """

    device: Device
    values: Mapping[str, float]
    findings: tuple[Finding, ...]
    records: tuple[str, ...] = field(default=())

    @property
    def passed(self) -> bool:
        """Whether no test found a fault."""
        return all(finding.passed is not False for finding in self.findings)


def check_device(device: Device, given: Mapping[str, float] | None = None) -> DeviceCheck:
    """Try a device model on a small built-in case: a machine behind a line at an infinite bus.

    The kernels run on guarded arrays in plain Python first, then compiled. Then follow the tests of a
    device: zero derivative at the start, the Jacobian against differences, and the limits.

    Parameters
    ----------
    device : Device
        The model.
    given : mapping, optional
        Parameters by name or symbol; the others have their defaults, or values of a usual size.

    Raises
    ------
    DeviceError
        The definition of the model does not fit together.
    OptionError
        A name in `given` is none of its parameters.
    """
    device_models(device)
    values = trial_values(device, given or {})
    with telling_own_errors([device]):
        findings = tuple(_findings(device, values))
    return DeviceCheck(device, values, findings, record_names(device))


def _findings(device: Device, values: Mapping[str, float]) -> Iterator[Finding]:
    models = device_models(device)
    case = trial_case(device, values)
    try:
        groups = assemble(case, models)
    except CaseError as error:
        hint = "; give values that fit with --set NAME=VALUE"
        yield from (Finding("parameters", False, fault + hint) for fault in error.faults)
        return
    parameters = next(rows for model, _, rows in groups if model is device)
    kernels = interpreted_kernels(device)
    watch = LineWatch(kernels.values())
    faults = list(try_kernels(device, parameters, kernels, watch))
    if faults:
        yield from (Finding("kernels in plain Python", False, fault) for fault in faults)
        return
    yield Finding("kernels in plain Python", True, _lines_told(watch))
    faults = list(compile_faults(device))
    if faults:
        yield from (Finding("compiled kernels", False, fault) for fault in faults)
        return
    yield _compiled(device, parameters, kernels)
    try:
        model = build_model(case, devices=models)
    except DeviceError:
        raise
    except GridfoldError as error:
        yield Finding("start", False, str(error).splitlines()[0])
        return
    if not model.n_states:
        yield Finding("start, Jacobian", None, "no device of the case has a state")
        return
    yield _start(model)
    yield _jacobian(model)
    yield from _limits(device, model)


def _lines_told(watch: LineWatch) -> str:
    left = watch.places
    if not watch.total:
        return "they keep to their rows"
    run = watch.total - len(left)
    text = f"they keep to their rows; {run} of {watch.total} lines were run"
    if not left:
        return text
    more = f" and {len(left) - _SHOWN_LINES} more" if len(left) > _SHOWN_LINES else ""
    return f"{text}, not {', '.join(left[:_SHOWN_LINES])}{more}"


def _compiled(device: Device, parameters: np.ndarray, kernels: Mapping[str, object]) -> Finding:
    """Compiled kernels give what plain Python does, and each unit what it gives alone."""
    test = "compiled kernels"
    for point in trial_points(device, parameters):
        if not point.is_ordinary:
            break
        together = _evaluated(device, point)
        for unit in range(point.x.shape[1]):
            alone = TrialPoint(point.x[:, [unit]], point.u[:, [unit]], point.p[:, [unit]])
            if not np.array_equal(
                _evaluated(device, alone)[:, 0], together[:, unit], equal_nan=True
            ):
                return Finding(test, False, "units influence one another")
        plain = _interpreted(device, point, kernels)
        error = np.abs(together - plain) / (1.0 + np.abs(plain))
        if not np.nanmax(error, initial=0.0) <= _ROUNDING:
            names = (*device.signal_rows, *(f"d {name}/dt" for name in device.states))
            worst = names[int(np.nanargmax(np.nanmax(error, axis=1)))]
            return Finding(test, False, f"{worst} is not what plain Python gives")
    return Finding(
        test, True, "they give what plain Python gives, and each unit what it gives alone"
    )


def _evaluated(device: Device, point: TrialPoint) -> np.ndarray:
    """Outputs and derivatives, one below the other."""
    x, u, p = (np.ascontiguousarray(rows, dtype=complex) for rows in (point.x, point.u, point.p))
    y = output_stage(device, x, u, p, source_stage(device, x, p))
    return np.concatenate([y, derivative_stage(device, x, u, p, y)]).real


def _interpreted(device: Device, point: TrialPoint, kernels: Mapping[str, object]) -> np.ndarray:
    units = point.p.shape[1]
    y, dx = np.zeros((len(device.signal_rows), units)), np.zeros((len(device.states), units))
    for kernel in kernels.values():
        assert callable(kernel)
        with np.errstate(all="ignore"):
            kernel(point.x, point.u, point.p, y, dx)
    return np.concatenate([y, dx])


def _start(model: DetailedModel) -> Finding:
    rates = np.abs(model.compiled(model.x0))
    worst = int(np.argmax(rates))
    text = f"the largest derivative is {rates[worst]:.1e} 1/s, of {model.state_names[worst]}"
    return Finding("start", bool(rates[worst] < AT_REST), text)


def _jacobian(model: DetailedModel) -> Finding:
    away = np.random.default_rng(0).uniform(-_AWAY, _AWAY, model.n_states)
    error = max(_jacobian_error(model, x) for x in (model.x0, model.x0 + away))
    text = f"it differs by {error:.1e} from differences, of the largest entry of its row"
    return Finding("Jacobian", bool(error < JACOBIAN), text)


def _jacobian_error(model: DetailedModel, x: np.ndarray) -> float:
    h = _DIFFERENCE
    columns = [
        (model.compiled(x + h * e) - model.compiled(x - h * e)) / (2 * h)
        for e in np.eye(model.n_states)
    ]
    expected = np.array(columns).T
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1.0
    return float(np.abs((model.jacobian(x) - expected) / scale).max())


def _limits(device: Device, model: DetailedModel) -> Iterator[Finding]:
    block = next(block for block in model.layout.blocks if block.device is device)
    signals = model.signals(model.x0[None, :])[0]
    x, u = model.x0[block.state_index], signals[block.inputs]
    for found in limits_found(device, x, u, block.parameters):
        yield Finding("limits", found.holds, found.text)
    if not device.limits:
        yield Finding("limits", None, "it names none")
