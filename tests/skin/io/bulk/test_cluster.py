"""A job on a cluster of two processes: the files of one machine, whoever is lost."""

from __future__ import annotations

import dataclasses
import os
import signal
import threading
import time
import warnings

import pytest

from skin.errors import LibraryError
from skin.io.bulk.cluster import run_on
from skin.io.bulk.decode_part import decode_part
from skin.io.bulk.job import parts_of
from tests.fixtures.patience import LONG_S


@pytest.fixture
def client():
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, about ports and processes
        with (
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
                silence_logs=50,
            ) as cluster,
            distributed.Client(cluster) as client,
        ):  # fmt: skip
            yield client


def kill(pid, job):
    """Kill a worker as soon as a log was begun."""
    until = time.monotonic() + LONG_S
    while time.monotonic() < until:
        if (job.folder / "_logs").is_dir():
            os.kill(pid, signal.SIGKILL)
            return
        time.sleep(0.02)


def test_a_cluster_gives_the_files_of_one_machine_even_if_a_worker_dies(
    client, job, log, palm_frames, contents, tmp_path
):
    from bus.logs import write

    other = tmp_path / "other.log"
    write(other, palm_frames[: palm_frames.size // 2])
    for part in parts_of([log, other]):
        decode_part(job, part)
    spread = dataclasses.replace(job, folder=tmp_path / "spread")
    pid = next(iter(client.run(os.getpid).values()))
    killer = threading.Thread(target=kill, args=(pid, spread))
    killer.start()
    report = run_on(client, spread, [log, other])
    killer.join()
    assert (report["failed"], report["faults"]) == (0, [])
    mine, theirs = contents(spread.folder), contents(job.folder)
    assert mine.keys() == theirs.keys()
    assert [name for name in mine if mine[name] != theirs[name]] == []


def test_without_the_library_its_extra_is_named(job, log, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(LibraryError, match=r"f3t-skin\[cluster\]"):
        run_on("tcp://none", job, [log])
