"""Pictures of the built-in case, each drawn by the commands that stand beside it."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import gridfold
from gridfold.numerics.kernel_cache import SOURCES


@dataclass(frozen=True)
class Picture:
    """A picture of the gallery.

    Parameters
    ----------
    name : str
        Its file, which the last command writes.
    title : str
        Heading.
    words : str
        What is seen.
    commands : sequence of str
        Commands that draw it, one after another, after those of the pictures before.
    """

    name: str
    title: str
    words: str
    commands: Sequence[str]


_RUN = "gridfold simulate npcc --fault-bus 3 --fault-start 0.2 --t-end 5"
PICTURES = (
    Picture(
        "run.png",
        "A run",
        "A fault of 0.1 s at bus 3, with what is drawn by default. Of many curves those that move most "
        "are told apart.",
        [f"{_RUN} --plot run.png"],
    ),
    Picture(
        "flows.png",
        "Watched flows",
        "From the table of a run: power into the lines at bus 3, and what New England sends out.",
        [
            f'{_RUN} --monitor "angle_coi, voltage 3, flow 3-2, 3-4, interface EXPORT = area:1 to all" '
            "--csv short.csv",
            'gridfold plot short.csv "flow, interface" --out flows.png',
        ],
    ),
    Picture(
        "compare.png",
        "Two runs compared",
        "The same fault 0.15 s long, dashed, and the differences.",
        [
            f'{_RUN} --fault-duration 0.15 --monitor "angle_coi, voltage 3" --csv long.csv',
            'gridfold compare short.csv long.csv "angle_coi 23:1, voltage 3" --out compare.png',
        ],
    ),
    Picture(
        "modes.png",
        "Modes",
        "Eigenvalues at the operating point, with lines of equal damping.",
        ["gridfold eigenvalues npcc --count 10 --plot modes.png"],
    ),
    Picture(
        "clearing-times.png",
        "Clearing times",
        "The map of the grid in the colours of its critical clearing times, and the shortest of them.",
        ["gridfold cct npcc --t-end 8 --plot clearing-times.png"],
    ),
)


def draw(folder: Path) -> None:
    """Draw all pictures into `folder`, unless these commands and these sources have drawn them."""
    state = json.dumps([SOURCES, *map(asdict, PICTURES)])
    digest = hashlib.sha256(state.encode()).hexdigest()
    stamp = folder / "drawn-by.txt"
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == digest:
        return
    folder.mkdir(parents=True, exist_ok=True)
    env = os.environ | {"PYTHONPATH": str(Path(gridfold.__file__).parents[1])}
    for picture in PICTURES:
        for command in picture.commands:
            words = [sys.executable, "-m", *shlex.split(command)]
            subprocess.run(words, cwd=folder, env=env, check=True, stdout=subprocess.DEVNULL)
    stamp.write_text(digest, encoding="utf-8")


def page(folder: str) -> str:
    """Sections of all pictures in Markdown; `folder` leads from the page to them."""
    parts = []
    for picture in PICTURES:
        lines = "\n".join(command.replace(" --", " \\\n    --") for command in picture.commands)
        parts.append(
            f"## {picture.title}\n\n{picture.words}\n\n```bash\n{lines}\n```\n\n"
            f"![{picture.title}]({folder}/{picture.name})\n"
        )
    return "\n".join(parts)
