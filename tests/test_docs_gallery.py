"""The gallery of the documentation: its commands draw its pictures."""

from __future__ import annotations

import sys
from pathlib import Path

from written_commands import commands, ended

DOCS = Path(__file__).parent.parent / "docs"

sys.path.insert(0, str(DOCS))
import gallery  # noqa: E402

PNG = b"\x89PNG\r\n"


def test_commands_of_the_page_draw_its_pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = gallery.page("pictures")
    for words in commands(page):
        run = ended(words)
        assert run.code == 0, run.err
    for picture in gallery.PICTURES:
        content = Path(picture.name).read_bytes()
        assert content.startswith(PNG)
        assert 20_000 < len(content) < 500_000
        assert f"](pictures/{picture.name})" in page


def test_pictures_that_these_sources_have_drawn_are_kept(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(gallery.subprocess, "run", lambda words, **_: drawn.append(words[2:]))
    for _ in range(2):
        gallery.draw(tmp_path)
    assert len(drawn) == sum(len(picture.commands) for picture in gallery.PICTURES)
    assert all(words[0] == "gridfold" for words in drawn)
