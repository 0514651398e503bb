"""What criteria say of a contingency, as figures of its row."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from gridfold.runs.criteria import BETWEEN, Finding, Verdict


def judged_figures(findings: Sequence[Finding], error_deg: float | None = None) -> dict[str, Any]:
    """Columns about criteria; none without criteria.

    Parameters
    ----------
    findings : sequence of Finding
        One for each criterion.
    error_deg : float, optional
        Estimated error of rotor angles against the centre of inertia: two of them are apart within
        twice as much.
    """
    if not findings:
        return {}
    shares = [item.share for item in findings if item.share is not None]
    error = 2 * (error_deg or 0.0)
    return {
        "violations": sum(item.verdict is Verdict.VIOLATED for item in findings),
        "violated": names_of(findings, Verdict.VIOLATED),
        "not_judged": names_of(findings, Verdict.OPEN),
        "close": _joined(f for f in findings if f.unit == "deg" and f.within(error)),
        "least_margin": min(shares, default=None),
        "criteria": json.dumps([item.record() for item in findings], allow_nan=False),
    }


def names_of(findings: Iterable[Finding], verdict: Verdict) -> str:
    """Names of the criteria with a verdict, empty if there is none."""
    return _joined(item for item in findings if item.verdict is verdict)


def _joined(findings: Iterable[Finding]) -> str:
    return BETWEEN.join(item.name for item in findings)
