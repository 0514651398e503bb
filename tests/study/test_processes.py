"""Worker processes: proved before anything is written, gone when their parent is."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gridfold.io.study_store import FILE

STUDY = {
    "contingencies": {"bus_faults": "1-30", "clearing_time": 0.05},
    "model": {"kind": "detailed"},
    "run": {"t_end": 6.0},
}
CALL = (
    "import json; import gridfold as gf; from gridfold.study.study_file import parse_study\n"
    f"study = parse_study(json.loads('''{json.dumps(STUDY)}'''))\n"
)
RUN = (
    "gf.run_study(study, 'out', workers='processes', count=2, "
    "on_progress=lambda progress: print(progress.done, flush=True))\n"
)
GUARD = "if __name__ == '__main__':\n    "


def children(pid: int) -> list[int]:
    """Processes below one, and below these."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError):
            continue
        if parent == pid:
            found += [int(folder.name), *children(int(folder.name))]
    return found


def alive(pid: int) -> bool:
    try:
        return (Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("standard_input", [False, True])
def test_workers_without_a_main_guard_are_one_error_and_nothing_is_written(
    tmp_path, standard_input
):
    text = CALL + RUN
    (tmp_path / "program.py").write_text(text)
    called = [sys.executable, "-"] if standard_input else [sys.executable, "program.py"]
    given = {"input": text} if standard_input else {"stdin": subprocess.DEVNULL}
    done = subprocess.run(
        called, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False, **given
    )
    assert done.returncode == 1
    assert "worker processes end before they begin" in done.stderr.splitlines()[-1]
    assert "__name__ == '__main__'" in done.stderr.splitlines()[-1]
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="there is no /proc")
def test_workers_end_when_their_parent_is_killed(tmp_path):
    (tmp_path / "program.py").write_text(CALL + GUARD + RUN)
    with subprocess.Popen(
        [sys.executable, "program.py"], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    ) as process:
        for line in process.stdout:
            if int(line) > 0:
                break
        workers = children(process.pid)
        assert len(workers) >= 2
        process.send_signal(signal.SIGKILL)
    end = time.monotonic() + 20
    while (left := [pid for pid in workers if alive(pid)]) and time.monotonic() < end:
        time.sleep(0.05)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert not left
    assert (tmp_path / "out" / FILE).exists()
