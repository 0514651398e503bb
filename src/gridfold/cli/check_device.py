"""The command that tries a device model of a user's own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from gridfold.cli.console import out, speaks_to_people, write_json_option
from gridfold.cli.exit_codes import ExitCode
from gridfold.cli.options import JsonOption
from gridfold.dynamics.device import Device
from gridfold.errors import OptionError
from gridfold.report.tables import facts_table, finding_table
from gridfold.runs.device_check import DeviceCheck
from gridfold.runs.device_check import check_device as check
from gridfold.runs.own_devices import devices_in, own_devices_in, read_devices

_value_option = partial(typer.Option, rich_help_panel="Parameters")


def check_device(
    file: Annotated[Path, typer.Argument(metavar="FILE.py", help="Python file; it is run.")],
    name: Annotated[
        str | None, typer.Option(help="One model of the file.", show_default="all of them")
    ] = None,
    values: Annotated[
        list[str] | None,
        _value_option(
            "--set",
            metavar="NAME=VALUE",
            help="A parameter by name or symbol; may be repeated.",
            show_default="its default, or a usual size",
        ),
    ] = None,
    record: Annotated[
        str | None,
        _value_option(help="All of them, as in a DYR record behind bus, model and id."),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Try a device model of your own on a small case before it meets a grid.

    Its kernels run in plain Python on arrays that check each index, then compiled; then come zero
    derivative at the start, the Jacobian against differences, and the limits. Exit code 2: a fault.

    Example: gridfold check-device my_exciter.py --record "0.02 200 0.05 0 5"
    """
    (code,) = read_devices([file])
    devices_in([code])
    chosen = _chosen(own_devices_in(code), name, file)
    found = [check(device, _given(device, values or [], record)) for device in chosen]
    write_json_option(json, [_record(item) for item in found])
    if speaks_to_people(json):
        for item in found:
            out.print(facts_table(_facts(item)))
            out.print(finding_table(item.findings))
    raise typer.Exit(
        ExitCode.COMPLETED if all(item.passed for item in found) else ExitCode.BAD_INPUT
    )


def _chosen(own: Sequence[Device], name: str | None, file: Path) -> list[Device]:
    chosen = [device for device in own if name in (None, device.model)]
    if not chosen:
        known = ", ".join(device.model for device in own)
        raise OptionError(f"{file} has no device model {name!r}; there are {known}")
    return chosen


def _given(device: Device, texts: Sequence[str], record: str | None) -> dict[str, float]:
    """Parameters of the options, those of the record first."""
    values: dict[str, float] = {}
    if record is not None:
        parts = record.replace(",", " ").rstrip("/ ").split()
        if len(parts) > len(device.psse_record):
            raise OptionError(
                f"--record has {len(parts)} values; a record of {device.model} has "
                f"{len(device.psse_record)}"
            )
        pairs = zip(device.psse_record, parts, strict=False)
        values = {name: _number("--record", text) for name, text in pairs if name is not None}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise OptionError(f"--set {text}: write NAME=VALUE")
        names = {p.symbol: p.name for p in device.parameters}
        key = name.strip()
        values[names.get(key, key)] = _number("--set", value)
    return values


def _number(option: str, text: str) -> float:
    try:
        value = float(text.strip().replace("D", "e").replace("d", "e"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise OptionError(f"{option}: {text.strip()!r} is not a number")
    return value


def _facts(found: DeviceCheck) -> dict[str, str]:
    device = found.device
    facts = {"Device": f"{device.model}, {device.title}", "File": device.file or "none"}
    if found.records:
        columns = " ".join(_symbol(device, name) for name in device.psse_record)
        facts["DYR records"] = f"{', '.join(found.records)}: {columns}"
    values = (f"{p.symbol} {found.values[p.name]:g}" for p in device.parameters)
    return facts | {"Tried with": ", ".join(values) or "no parameters"}


def _symbol(device: Device, name: str | None) -> str:
    return next((p.symbol for p in device.parameters if p.name == name), "(not used)")


def _record(found: DeviceCheck) -> dict[str, Any]:
    return {
        "device": found.device.model,
        "file": found.device.file,
        "records": list(found.records),
        "parameters": dict(found.values),
        "passed": found.passed,
        "findings": [vars(item) for item in found.findings],
    }
