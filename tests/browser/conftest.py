"""A Chromium that is there, driven through playwright.

GRIDFOLD_CHROMIUM names one that is not on the path.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

playwright = pytest.importorskip(
    "playwright.sync_api", reason="the package playwright is missing: pip install gridfold[browser]"
)

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def executable() -> str | None:
    named = os.environ.get("GRIDFOLD_CHROMIUM")
    return named or next(filter(None, map(shutil.which, NAMES)), None)


# Closed with this module: while it is open, playwright keeps an event loop in the main thread.
@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    path = executable()
    if path is None:
        pytest.skip("no Chromium is found: install the package chromium, or set GRIDFOLD_CHROMIUM")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=path, args=list(FLAGS))
        yield chromium
        chromium.close()
