"""Device models of a user's own beside those of the package: which act, and whether they are sound."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import FunctionType

from gridfold.dynamics.device import Device, Limit, Parameter, Role
from gridfold.dynamics.psse_models import LOAD_SUFFIXES
from gridfold.dynamics.registry import DEVICES, NEGATIVE_LOAD
from gridfold.errors import DeviceError, GridfoldError

#: What stands for the models of a user's own: all models by name, or the own ones alone.
Devices = Mapping[str, Device] | Iterable[Device] | Device

#: What a machine takes from the generator where its record lacks it.
_FROM_GENERATOR = ("resistance", "reactance")
#: End of the names of PSS/E's own models that were user-written ones until revision 33.
_ONCE_USER_WRITTEN = "U1"
_TUPLES = ("states", "inputs", "sources", "outputs", "set_points", "targets", "solved_inputs")
#: What the other devices of a unit take from one of a role.
_GIVES = {
    Role.EXCITER: "field_voltage",
    Role.STABILIZER: "stabilizer_signal",
    Role.TURBINE: "mechanical_power",
}
_checked: dict[int, Device] = {}


def device_models(devices: Devices = DEVICES) -> Mapping[str, Device]:
    """All device models by name: those of the package, and a user's own, which are checked.

    Parameters
    ----------
    devices : mapping, iterable of Device, or Device
        Own models, which stand beside those of the package; or a mapping with all of them by name.

    Raises
    ------
    DeviceError
        A model does not fit together, or two have one name or answer one record; lists every fault. A
        model of the package is replaced only by one that says so (``replaces_built_in``).
    """
    if devices is DEVICES:
        return DEVICES
    given = [devices] if isinstance(devices, Device) else devices
    named = given.items() if isinstance(given, Mapping) else [(None, item) for item in given]
    faults: list[str] = []
    own: dict[str, Device] = {}
    for name, item in named:
        if not isinstance(item, Device):
            faults.append(f"devices: {item!r} is no Device; read files with gridfold.load_devices")
        elif name is not None and name != item.model:
            faults.append(f"devices: {name!r} stands for the model {item.model!r}")
        elif item.model in own and own[item.model] is not item:
            faults.append(f"{_place(item)} has the name of {_place(own[item.model])}")
        else:
            own[item.model] = item
    strange = [item for item in own.values() if is_own(item)]
    faults += [fault for item in strange for fault in _definition_faults(item)]
    if not faults:
        faults += _taken(strange)
    if faults:
        raise DeviceError(faults)
    return {**DEVICES, **own}


def is_own(device: Device) -> bool:
    """Whether a model is none of the package's."""
    return DEVICES.get(device.model) is not device


def record_names(device: Device) -> tuple[str, ...]:
    """Model names of the PSS/E records that a device answers."""
    names = device.psse_names or ((device.model,) if device.psse_record else ())
    ends = LOAD_SUFFIXES if device.role is Role.LOAD and not device.psse_names else ("",)
    return tuple(name.upper() + end for name in names for end in ends)


def answering(devices: Mapping[str, Device]) -> dict[str, Device]:
    """The device for each model name of PSS/E; a user's own come before the package's."""
    ordered = sorted(devices.values(), key=is_own)
    return {name: device for device in ordered for name in record_names(device)}


def answering_user_written(devices: Mapping[str, Device]) -> dict[str, Device]:
    """The same for user-written records: a user's own models, and PSS/E's of wind and sun until 33."""
    ordered = sorted(devices.values(), key=is_own)
    return {
        name: device
        for device in ordered
        for name in record_names(device)
        if is_own(device) or name.endswith(_ONCE_USER_WRITTEN)
    }


def own_notices(used: Mapping[str, int], devices: Iterable[Device]) -> Iterator[str]:
    """What is told of own models with every result; `used` has the number of units by model."""
    built_in = answering(DEVICES)
    for device in devices:
        if is_own(device) and used.get(device.model):
            count = used[device.model]
            text = (
                f"{_place(device)} is a model of your own: {count} unit{'' if count == 1 else 's'}"
            )
            replaced = {built_in[n].model for n in record_names(device) if n in built_in}
            replaced |= {device.model} & set(DEVICES)
            if replaced:
                text += f", in place of gridfold's {', '.join(sorted(replaced))}"
            yield text


def _taken(own: list[Device]) -> Iterator[str]:
    """Names and records that are somebody else's already."""
    built_in = answering(DEVICES)
    holders: dict[str, Device] = {}
    for device in own:
        say = "set replaces_built_in=True in the model if it is to stand in its place"
        if device.model in DEVICES and not device.replaces_built_in:
            yield f"{_place(device)} has the name of a model of gridfold; {say}"
        for name in record_names(device):
            if name in holders:
                yield f"{_place(device)} answers {name} records, as {_place(holders[name])} does"
            elif name in built_in and not device.replaces_built_in and device.model not in DEVICES:
                yield f"{_place(device)} answers {name} records, as a model of gridfold does; {say}"
            holders.setdefault(name, device)


def _place(device: Device) -> str:
    """Name of a model, with its file."""
    return f"device {device.model}" + (f" ({device.file})" if device.file else "")


def _definition_faults(device: Device) -> list[str]:
    """What does not fit together in a model; found once."""
    if id(device) in _checked:
        return []
    faults = [f"{_place(device)}: {fault}" for fault in _faults(device)]
    if not faults:
        _checked[id(device)] = device
    return faults


def _faults(device: Device) -> Iterator[str]:
    forms = list(_form_faults(device))
    yield from forms
    if forms:
        return
    names = {p.name for p in device.parameters}
    signals = {*device.states, *device.signal_rows}
    for what, rows in (
        ("parameters and set points", device.parameter_rows),
        ("inputs", device.inputs),
        ("states and outputs", (*device.states, *device.signal_rows)),
    ):
        twice = [name for name, count in Counter(rows).items() if count > 1]
        if twice:
            yield f"its {what} have {', '.join(twice)} more than once"
    for what, used, known in (
        ("targets", device.targets, signals),
        ("solved_inputs", device.solved_inputs, set(device.inputs)),
        ("defaults", device.defaults, {*device.inputs, *device.targets}),
        ("limits", [limit.parameter for limit in device.limits], names),
        ("limits", [n for limit in device.limits if (n := limit.added_to)], names),
        ("limits", [n for limit in device.limits if (n := limit.state)], set(device.states)),
        ("psse_record", [name for name in device.psse_record if name], names),
    ):
        strange = [name for name in used if name not in known]
        if strange:
            listed = ", ".join(sorted(known)) or "none"
            yield f"its {what} name {', '.join(map(repr, strange))}; there are {listed}"
    free = len(device.set_points) + len(device.solved_inputs)
    if len(device.targets) != free:
        yield (
            f"it has {len(device.targets)} targets for {free} set points and solved inputs; "
            "the start needs as many"
        )
    yield from _kernel_faults(device)
    yield from _record_faults(device, names)


def _form_faults(device: Device) -> Iterator[str]:
    """Fields of another kind than they should be."""
    kind: type
    for field, kind in (("model", str), ("role", Role)):
        value = getattr(device, field)
        if not isinstance(value, kind) or value in ("", NEGATIVE_LOAD):
            yield f"its {field} cannot be {value!r}"
    texts = {name: getattr(device, name) for name in (*_TUPLES, "psse_names")}
    for field, value in texts.items():
        if not isinstance(value, tuple) or not all(isinstance(name, str) for name in value):
            yield f"its {field} are {value!r}, not a tuple of names; one name is written ('name',)"
    for field, kind in (("parameters", Parameter), ("limits", Limit)):
        value = getattr(device, field)
        if not isinstance(value, tuple) or not all(isinstance(item, kind) for item in value):
            yield f"its {field} are not a tuple of {kind.__name__}"
    record = device.psse_record
    if not isinstance(record, tuple) or not all(n is None or isinstance(n, str) for n in record):
        yield f"its psse_record is {record!r}, not a tuple of names and None"
    for name in ("source", "output", "derivative"):
        kernel = getattr(device, name)
        if kernel is not None and not isinstance(kernel, FunctionType):
            yield f"its {name} kernel is no plain function; write it without a decorator"
        elif kernel is not None and kernel.__code__.co_argcount != 5:
            yield (
                f"its {name} kernel takes {kernel.__code__.co_argcount} arguments; "
                "a kernel is kernel(x, u, p, y, dx)"
            )


def _kernel_faults(device: Device) -> Iterator[str]:
    """Kernels and rows that do not go together."""
    for rows, kernel, what in (
        (device.states, device.derivative, ("states", "derivative")),
        (device.outputs, device.output, ("outputs", "output")),
        (device.sources, device.source, ("sources", "source")),
    ):
        if rows and kernel is None:
            yield f"it has {what[0]}, but no {what[1]} kernel"
        if kernel is not None and not rows:
            yield f"it has a kernel for its {what[0]}, but no {what[0]}"
    gives = _GIVES.get(device.role)
    if gives and gives not in (*device.states, *device.signal_rows):
        yield f"its role gives {gives}, which is none of its states and outputs"
    if device.role is Role.MACHINE:
        if len(device.sources) < 2 or device.admittance is None:
            yield "a machine needs two sources (its Norton current) and an admittance"
    elif device.role is Role.LOAD:
        if len(device.sources) < 2:
            yield "a device of a load needs two sources (its Norton current)"
    elif device.source is not None or device.admittance is not None:
        yield "only machines and devices of loads have a source and an admittance"


def _record_faults(device: Device, names: set[str]) -> Iterator[str]:
    record = [name for name in device.psse_record if name]
    if device.psse_names and not record and device.parameters:
        yield "it answers PSS/E records (psse_names), but has no psse_record that names their values"
    if record and device.role is Role.TURBINE:
        yield "records of PSS/E have turbines in their governors: give it the role of a governor"
    if len(set(record)) < len(record):
        yield "its psse_record has a name more than once"
    if not 0 <= device.psse_icons <= len(device.psse_record):
        yield f"it has {device.psse_icons} ICONs among the {len(device.psse_record)} of its record"
    needed = {p.name for p in device.parameters if p.default is None} - set(record)
    if device.role is Role.MACHINE:
        needed -= set(_FROM_GENERATOR)
    if record and needed & names:
        yield f"its psse_record lacks {', '.join(sorted(needed))}, which have no default"


@contextmanager
def telling_own_errors(devices: Iterable[Device]) -> Iterator[None]:
    """What functions of own models raise, whoever calls them, is a DeviceError with its line.

    A SystemExit would else end the program as if all were well.
    """
    try:
        yield
    except GridfoldError:
        raise
    except (Exception, SystemExit) as error:
        found = _origin(error, [device for device in devices if is_own(device)])
        if found is None:
            raise
        place, device = found
        raise DeviceError(f"{place}: device {device.model}: {told(error)}") from error


def told(error: BaseException) -> str:
    """An exception in a line of words."""
    if isinstance(error, SystemExit):
        return f"the code of a device model asks to end the program (exit code {error.code!r})"
    what = error.msg if isinstance(error, SyntaxError) else error
    return f"{type(error).__name__}: {what}"


def _origin(error: BaseException, own: list[Device]) -> tuple[str, Device] | None:
    """Line from which an error came, and the model that the file there belongs to."""
    files: dict[str, Device] = {device.file: device for device in own if device.file}
    place: tuple[str, Device] | None = None
    trace = error.__traceback__
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if file in files:
            place = f"{file}:{trace.tb_lineno}", files[file]
        trace = trace.tb_next
    return place
