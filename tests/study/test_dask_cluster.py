"""A local cluster opens nothing but what it needs, on this machine alone."""

import ipaddress
import os
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

import gridfold as gf
from gridfold.study import dask_cluster, run_study
from gridfold.study.study_file import parse_study

STUDY = {
    "contingencies": {"bus_faults": "1-3", "clearing_time": 0.05},
    "model": {"kind": "detailed"},
    "run": {"t_end": 0.5},
}


def listening(pids: set[int]) -> list[tuple[str, int]]:
    """Addresses and ports at which processes listen."""
    sockets = set()
    for pid in pids:
        for descriptor in Path(f"/proc/{pid}/fd").iterdir():
            with suppress(FileNotFoundError):  # closed while we look
                target = str(descriptor.readlink())
                sockets.add(target.removeprefix("socket:[").removesuffix("]"))
    found = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in sockets:
                address, _, port = fields[1].partition(":")
                number = bytes.fromhex(address)
                words = [number[k : k + 4][::-1] for k in range(0, len(number), 4)]
                found.append((str(ipaddress.ip_address(b"".join(words))), int(port, 16)))
    return found


def below(pid: int) -> set[int]:
    children = Path(f"/proc/{pid}/task").glob("*/children")
    pids = {int(text) for file in children for text in file.read_text().split()}
    return {pid}.union(*(below(child) for child in pids))


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="there is no /proc")
def test_a_local_cluster_listens_on_the_loopback_without_pages(tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed")
    before, seen = set(listening({os.getpid()})), []

    def look(progress):
        if progress.latest and not seen:
            seen.extend(set(listening(below(os.getpid()))) - before)

    run = run_study(parse_study(STUDY), tmp_path / "a", cluster="local", count=1, on_progress=look)
    assert (run.done, run.failed) == (3, 0)
    assert len(seen) == 3, "scheduler, nanny, worker, and no page of any of them"
    assert {address for address, _ in seen} == {"127.0.0.1"}
    assert 8787 not in {port for _, port in seen}


def test_a_cluster_that_cannot_prepare_the_study_is_an_error_and_no_row(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")

    def prepare(offline):
        raise ModuleNotFoundError("No module named 'mine'")

    monkeypatch.setattr("gridfold.study.processes.prepare", prepare)
    with (
        distributed.LocalCluster(
            n_workers=1, processes=False, dashboard_address=":0", protocol="tcp"
        ) as cluster,
        pytest.raises(gf.OptionError, match="cannot prepare the study: ModuleNotFound"),
    ):
        run_study(parse_study(STUDY), tmp_path / "a", cluster=cluster.scheduler_address)
    assert not (tmp_path / "a").exists()


class OneWorker:
    """A client whose worker takes what was scattered with it when it dies."""

    def __init__(self):
        self.scattered, self.given = [], []

    def nthreads(self):
        return {"worker": 1}

    def scatter(self, offline, **options):
        self.scattered.append(SimpleNamespace(status="finished"))
        return self.scattered[-1]

    def get_executor(self, **options):
        return self

    def submit(self, solve, everywhere, *batch):
        self.given.append(everywhere)
        return SimpleNamespace(result=lambda: None)


def test_the_study_is_handed_out_again_where_it_went_with_a_worker():
    client = OneWorker()
    submit = dask_cluster._members(client, offline=None).submit
    submit(())
    client.scattered[0].status = "lost"
    submit(())
    submit(())
    first, second = client.scattered
    assert client.given == [first, first, second, second]
