"""Groups of options: frozen dataclasses whose fields are options of a command.

A command takes a group as one parameter, ``area: AreaOptions``. Typer knows parameters alone, so
:func:`flat` gives it the fields of the group in its place. Groups may hold groups.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints

from gridfold.errors import OptionError


def flat(command: Callable[..., None]) -> Callable[..., None]:
    """The same command with the fields of groups as parameters of its own."""
    parameters = list(_parameters(command))

    @wraps(command)
    def run(**values: Any) -> None:
        command(**_arguments(command, values))

    run.__annotations__ = {item.name: item.annotation for item in parameters}
    vars(run)["__signature__"] = Signature(parameters)
    return run


def _parameters(owner: Callable[..., Any]) -> Iterable[Parameter]:
    """Parameters of a command or a group, those of groups in their place."""
    hints = get_type_hints(owner, include_extras=True)
    for name, parameter in signature(owner).parameters.items():
        if is_dataclass(hints[name]):
            yield from _parameters(hints[name])
        else:
            yield parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=hints[name])


def _arguments(owner: Callable[..., Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of a command or a group, from the values of all options."""
    hints = get_type_hints(owner)
    return {
        name: hints[name](**_arguments(hints[name], values))
        if is_dataclass(hints[name])
        else values[name]
        for name in signature(owner).parameters
    }


def given(group: Any) -> list[str]:
    """Options of a group, and of the groups in it, that are not None."""
    names: list[str] = []
    for item in fields(group):
        value = getattr(group, item.name)
        if is_dataclass(value):
            names += given(value)
        elif value is not None:
            names.append("--" + item.name.replace("_", "-"))
    return names


def refuse(names: Sequence[str], what: str) -> None:
    """Raise an OptionError if there are options among `names`: they have no effect on `what`."""
    if names:
        raise OptionError(f"{names[0]} has no effect on {what}")
