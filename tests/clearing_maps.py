"""A clearing-time map as its folder has it, with places of every kind."""

from __future__ import annotations

from typing import Any

#: A name that would break a page which took it for markup.
WICKED = "</script><img src=x onerror=alert(1)>&\u202e"

_ROW = {
    "branch": None, "fraction": None, "area": 1, "zone": 1, "base_kv": 345.0, "machine": None,
    "status": None, "lost_at_s": None, "bounded": False, "reason": None, "runs": 5,
}  # fmt: skip


def bus_row(number: int, seconds: float | None, **more: Any) -> dict[str, Any]:
    """A fault at a bus that loses synchronism after `seconds`, or fails."""
    row = {**_ROW, "place": f"bus {number}", "name": f"B{number}", "bus": number, "cct_s": seconds}
    if seconds is not None and more.get("bounded", True):
        row |= {"bounded": True, "lost_at_s": round(seconds + 0.01, 9), "machine": "26:1"}
        row["status"] = "lost synchronism"
    return {**row, **more}


def line_row(first: int, second: int, end: float, seconds: float) -> dict[str, Any]:
    """A fault at the end of a line."""
    near = second if end else first
    return bus_row(near, seconds) | {
        "place": f"line {first}-{second} at {near}",
        "bus": None,
        "branch": f"{first}-{second}",
        "fraction": end,
    }


ROWS = [
    bus_row(1, 0.25),
    bus_row(2, 0.03, name=WICKED),
    bus_row(3, 2.0, bounded=False),
    bus_row(4, None, reason="the network is <singular>"),
    bus_row(5, 0.0),
    line_row(1, 2, 0.0, 0.12),
    line_row(1, 2, 1.0, 0.02),
]


def about(rows: list[dict[str, Any]] = ROWS, buses: int = 6, **more: Any) -> dict[str, Any]:
    """What a map of buses in a row is about; each is joined to the next."""
    return {
        "gridfold": "0.1.0",
        "sources": "s",
        "case": "row",
        "fingerprint": "f",
        "settings": {
            "resolution": 0.01, "longest": 2.0, "t_end": 8.0, "criterion": "180 degrees",
            "method": "rk4", "step": 0.01, "model": "detailed",
        },
        "places": len(rows),
        "map": {
            "geographic": True,
            "buses": [
                {"number": k, "name": f"B{k}", "x": float(k), "y": 50 + 0.5 * (k % 2)}
                for k in range(1, buses + 1)
            ],
            "branches": [[k, k + 1] for k in range(1, buses)],
        },
        **more,
    }  # fmt: skip
