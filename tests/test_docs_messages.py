"""The page about what stops a run: its messages exist, and none that a user meets is missing."""

from __future__ import annotations

import sys
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"

sys.path.insert(0, str(DOCS))
import messages  # noqa: E402

FAMILIES = messages.families((DOCS / "howto" / "troubleshooting.md").read_text(encoding="utf-8"))
#: Mathematics that only a program of one's own calls: shapes of matrices, and the like.
FOR_PROGRAMMERS = (
    "numerics/", "systems/", "simulation/", "reduction/", "paper/", "report/reproduction",
    "dynamics/port_rhs", "equivalents/families",
)  # fmt: skip
#: Letters of a message that only says where another one comes from: "...: device ...: ...".
WRAPPER = 10
#: The part of a message's letters that its explanation repeats at least.
SHARE = 0.4


def test_every_message_that_is_explained_exists():
    texts = messages.texts()
    patterns = {family: messages.pattern(family) for family in FAMILIES}
    missing = [
        family for family, form in patterns.items() if not any(form.search(text) for text in texts)
    ]
    assert not missing, "\n".join(missing)


def test_every_message_that_stops_a_command_is_explained():
    patterns = [(messages.letters(f), messages.pattern(f)) for f in FAMILIES]
    missing = [
        f"{found.where}: {found.text.replace(messages.HOLE, '...')}"
        for found in messages.raised()
        if (count := messages.letters(found.text)) > WRAPPER
        and not found.where.startswith(FOR_PROGRAMMERS)
        and not any(n >= SHARE * count and form.search(found.text) for n, form in patterns)
    ]
    assert not missing, "\n".join(missing)


def test_no_message_is_explained_twice():
    assert len(FAMILIES) == len(set(FAMILIES))


def test_terms_of_the_page_are_messages_whose_dots_stand_for_names_and_numbers():
    form = messages.pattern("there is no bus ... in case ...")
    assert form.search("x: there is no bus \0 in case \0")
    assert not form.search("there is no bus \0")
    assert messages.families("`a ...`, `b`\n: What it is.\n\nno `term`\n") == ["a ...", "b"]
