"""Pages as a real browser shows them, and what it complains of."""

from __future__ import annotations

from typing import Any

WIDE, NARROW = 1280, 400


class Visit:
    """A page, with what it has complained of and asked for."""

    def __init__(self, browser: Any, address: str, metered: bool = False):
        self.page = browser.new_page(viewport={"width": WIDE, "height": 800})
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        if metered:
            session = self.page.context.new_cdp_session(self.page)
            session.send("Performance.enable", {"timeDomain": "threadTicks"})
        self.page.goto(address)
        self.seconds = _task_seconds(session) if metered else None

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)


def _task_seconds(session: Any) -> float:
    """Time that the page's thread has computed."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return float(next(item["value"] for item in metrics if item["name"] == "TaskDuration"))


def until(page: Any, condition: str) -> None:
    """Wait until a condition holds; asked from outside, since the page forbids code from strings."""
    for _ in range(200):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    raise AssertionError(condition)


def overflow(page: Any) -> int:
    script = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    return int(page.evaluate(script))


def check_quiet(visit: Visit, address: str) -> None:
    assert visit.complaints == []
    assert [url for url in visit.requests if not url.startswith("data:")] == [address]
