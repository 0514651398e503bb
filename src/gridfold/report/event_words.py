"""Events of a contingency in words, and where they are on the map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

Record = Mapping[str, Any]


def event_words(event: Record) -> str:
    """The record of an event as a sentence without its full stop."""
    words = {
        "bus-fault": _bus_fault,
        "branch-fault": _branch_fault,
        "branch-trip": lambda e: f"branch {e['branch']} trips at {e['time']:g} s",
        "branch-reclose": lambda e: f"branch {e['branch']} is closed at {e['time']:g} s",
        "machine-trip": lambda e: f"machine {e['bus']}:{e['id']} trips at {e['time']:g} s",
        "load-step": _load_step,
        "branch-open-end": _open_end,
        "load-shed": _load_shed,
        "shunt-trip": lambda e: f"shunt {e['bus']}:{e['id']} trips at {e['time']:g} s",
        "shunt-close": lambda e: f"shunt {e['bus']}:{e['id']} is closed at {e['time']:g} s",
        "shunt-step": _shunt_step,
        "set": _set,
        "redispatch": _redispatch,
    }
    return words.get(event["kind"], _plainly)(event)


def event_places(events: Iterable[Record]) -> dict[str, Any]:
    """Buses, and branches as pairs of buses with the fault's place between them (0 to 1, or None)."""
    buses: list[int] = []
    branches: list[list[Any]] = []
    for event in events:
        if "bus" in event:
            buses.append(event["bus"])
        if "branch" in event:
            ends = str(event["branch"]).partition(":")[0].split("-")
            branches.append([int(ends[0]), int(ends[1]), event.get("fraction")])
    return {"buses": list(dict.fromkeys(buses)), "branches": branches}


def _bus_fault(event: Record) -> str:
    end = "cleared by tripping the bus" if event["trip_bus"] else "clears by itself"
    return f"{_fault(event)} at bus {event['bus']} {_window(event)}, {end}"


def _branch_fault(event: Record) -> str:
    names = str(event["branch"]).partition(":")[0].split("-")
    fraction = event["fraction"]
    where = {0: f" at bus {names[0]}", 1: f" at bus {names[1]}"}.get(
        fraction, f", {100 * fraction:g} % of its length from bus {names[0]},"
    )
    end = "cleared by tripping the branch" if event["trip"] else "clears by itself"
    if event.get("far_duration") is not None:
        end += f"; its second end opens after {event['far_duration']:g} s"
    return f"{_fault(event)} on branch {event['branch']}{where} {_window(event)}, {end}"


def _fault(event: Record) -> str:
    if not event["resistance"] and not event["reactance"]:
        return "three-phase fault"
    return f"three-phase fault through {event['resistance']:g}+j{event['reactance']:g} p.u."


def _window(event: Record) -> str:
    return f"from {event['start']:g} s for {event['duration']:g} s"


def _load_step(event: Record) -> str:
    return (
        f"load at bus {event['bus']} changes by {event['active_mw']:g} MW "
        f"and {event['reactive_mvar']:g} Mvar at {event['time']:g} s"
    )


def _open_end(event: Record) -> str:
    return f"branch {event['branch']} opens at bus {event['bus']} alone at {event['time']:g} s"


def _load_shed(event: Record) -> str:
    share = f"{100 * event['share']:g} % of the load in {_selection(event)}"
    return f"{share} is shed at {event['time']:g} s"


def _redispatch(event: Record) -> str:
    which = event.get("units") or f"in {_selection(event)}"
    return f"units {which} give {event['active_mw']:+g} MW from the start"


def _shunt_step(event: Record) -> str:
    return (
        f"a shunt of {event['susceptance_mvar']:g} Mvar and {event['conductance_mw']:g} MW is added at "
        f"bus {event['bus']} at {event['time']:g} s"
    )


def _set(event: Record) -> str:
    how = (
        f"is set to {event['value']:g}" if "value" in event else f"changes by {event['change']:+g}"
    )
    unit = f"{event['bus']}:{event['id']}"
    return f"{event['parameter']} of unit {unit} {how} at {event['time']:g} s"


def _selection(event: Record) -> str:
    names = ("buses", "areas", "zones")
    return " and ".join(f"{name} {event[name]}" for name in names if event.get(name))


def _plainly(event: Record) -> str:
    return ", ".join(f"{key} {value}" for key, value in event.items())
