"""Spoilt input ends in a result or a refusal: a few of each kind, and all that once ended otherwise."""

import sys
import time

import pytest
from fuzz.campaign import CORPUS, Campaign, Tally
from fuzz.targets import TARGETS
from fuzz.worker import outcome_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits are set as on Linux")

SEED, SECONDS = 20, 120.0
NUMBERS = {"command": 8, "store": 20, "raw": 30}


def test_spoilt_input_is_read_or_refused():
    with Campaign(SEED, time.monotonic() + SECONDS) as campaign:
        for name in TARGETS:
            tally = Tally()
            campaign.run(name, tally, NUMBERS.get(name, 50))
            assert tally.inputs > 0
    assert not campaign.bad


def test_the_same_number_gives_the_same_input():
    for name, target in TARGETS.items():
        if name not in ("reduced", "store"):
            assert target.make(1, 7) == target.make(1, 7)
            assert len({target.make(1, number) for number in range(20)}) > 10


@pytest.mark.parametrize(
    "path", sorted(CORPUS.glob("*/*")), ids=lambda path: f"{path.parent.name}/{path.name[:10]}"
)
def test_what_once_ended_badly_is_read_or_refused(path):
    target = TARGETS[path.parent.name]
    name = path.name.partition("-")[2].replace("+", "/")
    outcome, message = outcome_of(target, name, path.read_bytes())
    assert outcome in ("refused", "read"), message
