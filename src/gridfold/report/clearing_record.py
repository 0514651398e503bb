"""What the report of a clearing-time map tells, as one record that is ready for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gridfold.report.grid_layout import with_places

Record = dict[str, Any]

#: Limits between classes of clearing times that may be taken, in milliseconds.
_LIMITS = (
    1, 2, 5, *range(10, 200, 10), *range(200, 400, 20), *range(400, 1000, 50),
    *range(1000, 2000, 250), *range(2000, 10_001, 1000),
)  # fmt: skip
#: Shares of all places, the shortest times first, at which classes end.
_SHARES = (0.04, 0.15, 0.35, 0.6, 0.85)
#: Viridis in steps (S. van der Walt, N. Smith, 2015): lightness alone tells them apart, dark is short.
_COLORS = ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
#: Where a fault at the end of a line is drawn: this share of its length away from the bus.
_INSET = 0.13
#: Room around the places that are shown: a share of what they take, and at least of the whole map.
_ROOM, _LEAST_ROOM = 0.12, 0.03
#: Share of the map from which all of it is shown.
_MOST = 0.7

#: Columns of the table in the page.
_FIELDS = (
    "place", "name", "base_kv", "area", "zone", "cct_ms", "lost_ms", "bounded", "machine", "status",
    "runs", "reason", "group", "x", "y", "line",
)  # fmt: skip


def clearing_record(about: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> Record:
    """The whole record of a map, finished or not.

    Parameters
    ----------
    about : mapping
        Case, settings, places and the grid, as :attr:`gridfold.ClearingTimes.about` or a folder has.
    rows : sequence of mapping
        The places whose times are known, as :attr:`gridfold.ClearingTimes.rows`.

    Returns
    -------
    dict
        Ready for JSON. Clearing times are in milliseconds. Places are sorted, the shortest time first;
        each has a ``group``: a class of times, ``never`` or ``failed``, and a spot on the map.
    """
    settings, grid = about["settings"], with_places(about["map"])
    classes = _classes([1000 * row["cct_s"] for row in rows if _known(row) and row["bounded"]])
    spots = {bus["number"]: (bus["x"], bus["y"]) for bus in grid["buses"]}
    shown = sorted((_row(row, classes, spots) for row in rows), key=_order)
    groups = [row["group"] for row in shown]
    return {
        "case": about["case"],
        "settings": dict(settings),
        "resolution_ms": _milliseconds(settings["resolution"]),
        "longest_ms": _milliseconds(settings["longest"]),
        "classes": [item | {"count": groups.count(k)} for k, item in enumerate(classes)],
        "counts": {
            "total": about["places"],
            "waiting": about["places"] - len(rows),
            "never": groups.count("never"),
            "failed": groups.count("failed"),
        },
        "map": grid,
        "view": _view(shown, grid["buses"]),
        "fields": list(_FIELDS),
        "rows": [[row[name] for name in _FIELDS] for row in shown],
        "provenance": _provenance(about),
    }


def _classes(times: Sequence[float]) -> list[Record]:
    """Classes of clearing times in ms with colours: the first few places in the darkest ones."""
    if not len(times):
        return []
    wanted = np.quantile(times, _SHARES)
    limits = {next((limit for limit in _LIMITS if limit >= value), None) for value in wanted}
    ends = [limit for limit in sorted(filter(None, limits)) if limit < max(times)]
    colors = [_COLORS[round(k)] for k in np.linspace(0, len(_COLORS) - 1, len(ends) + 1)]
    return [
        {"above": above, "up_to": end, "color": color}
        for above, end, color in zip([None, *ends], [*ends, None], colors, strict=True)
    ]


def _row(row: Mapping[str, Any], classes: Sequence[Record], spots: Mapping[int, Any]) -> Record:
    time = _milliseconds(row["cct_s"])
    x, y = _spot(row, spots)
    return {
        **{name: row[name] for name in ("place", "name", "base_kv", "area", "zone")},
        **{name: row[name] for name in ("bounded", "machine", "status", "runs", "reason")},
        "cct_ms": time,
        "lost_ms": _milliseconds(row["lost_at_s"]),
        "group": _group(row, time, classes),
        "x": x,
        "y": y,
        "line": row["branch"] is not None,
    }


def _group(row: Mapping[str, Any], time: float | None, classes: Sequence[Record]) -> int | str:
    if time is None:
        return "failed"
    if not row["bounded"]:
        return "never"
    return next(
        k for k, item in enumerate(classes) if item["up_to"] is None or time <= item["up_to"]
    )


def _spot(row: Mapping[str, Any], spots: Mapping[int, tuple[float, float]]) -> tuple[float, float]:
    """Where a fault is drawn."""
    if row["bus"] is not None:
        return spots[row["bus"]]
    first, second = (spots[int(bus)] for bus in row["branch"].partition(":")[0].split("-"))
    share = min(max(row["fraction"], _INSET), 1 - _INSET)
    x, y = (round(a + share * (b - a), 6) for a, b in zip(first, second, strict=True))
    return x, y


def _view(rows: Sequence[Record], buses: Sequence[Record]) -> Record | None:
    """The part of the map that the places take, with some room; None if that is most of it."""
    if not rows:
        return None
    view, share = {}, 1.0
    for axis in ("x", "y"):
        low, high = min(row[axis] for row in rows), max(row[axis] for row in rows)
        whole = max(bus[axis] for bus in buses) - min(bus[axis] for bus in buses)
        room = max(_ROOM * (high - low), _LEAST_ROOM * whole)
        view[axis] = [low - room, high + room]
        share *= min(1.0, (high - low + 2 * room) / whole) if whole else 1.0
    return view if share < _MOST else None


def _order(row: Mapping[str, Any]) -> tuple[bool, bool, float]:
    """The shortest first, then those that never lose synchronism, then those that failed."""
    never = row["group"] == "never"
    return row["cct_ms"] is None, never, row["cct_ms"] or 0.0


def _known(row: Mapping[str, Any]) -> bool:
    return row["cct_s"] is not None


def _milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000 * seconds, 6)


def _provenance(about: Mapping[str, Any]) -> list[list[str]]:
    """Pairs of a term and what is said about it."""
    settings = about["settings"]
    pairs = [
        ["gridfold", f"{about['gridfold']}, sources {about['sources']}"],
        ["Case data", f"{about['case']}, fingerprint {about['fingerprint']}"],
    ]
    words = {
        "resolution": ("Grid of clearing times", "{:g} s"),
        "longest": ("Longest clearing time tried", "{:g} s"),
        "t_end": ("End of each run after the fault begins", "{:g} s"),
        "criterion": ("Synchronism is lost at", "{}"),
        "method": ("Integration", "{}"),
        "step": ("Time step", "{:g} s"),
        "model": ("Model", "{}"),
        "load_model": ("Loads", "{}"),
    }
    for key, (term, text) in words.items():
        if settings.get(key) is not None:
            pairs.append([term, text.format(settings[key])])
    return pairs
