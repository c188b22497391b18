"""A worker beside the loop: what is written is read once and in order, and ends are seen."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from skin.errors import SkinError
from skin.worker import RingBuffer, Worker
from tests.fixtures.patience import LONG_S
from tests.fixtures.process import is_gone

DTYPE = np.dtype([("value", np.int64), ("other", np.float32, (3, 2))])
MODULE = "tests.fixtures.summing_worker"


@pytest.fixture
def ring() -> RingBuffer:
    return RingBuffer(DTYPE, 7)


@pytest.fixture
def worker(ring: RingBuffer) -> Iterator[Worker]:
    worker = Worker(MODULE, ring, {"start": 10})
    yield worker
    worker.close()


def put(ring: RingBuffer, value: int) -> bool:
    at = ring.claim()
    if at is None:
        return False
    ring.records[at] = value, np.full((3, 2), value)
    ring.publish()
    return True


def test_records_come_out_once_and_in_their_order(ring: RingBuffer) -> None:
    rng, written, read = np.random.default_rng(1), 0, []
    while written < 1000:
        for _ in range(rng.integers(0, 9)):
            written += put(ring, written)
        records = ring.unread()[: rng.integers(0, 9)]
        read += records["value"].tolist()
        ring.release(records.size)
    assert read == list(range(len(read)))
    assert ring.waiting == written - len(read) <= ring.slots


def test_a_full_ring_takes_nothing_and_overwrites_nothing(ring: RingBuffer) -> None:
    assert [put(ring, i) for i in range(9)] == [True] * 7 + [False] * 2
    assert ring.unread()["value"].tolist() == list(range(7))


def test_a_record_is_unseen_until_it_is_published(ring: RingBuffer) -> None:
    assert ring.claim() is not None
    assert ring.unread().size == 0


def test_both_ends_see_the_same_memory(ring: RingBuffer) -> None:
    other = RingBuffer(DTYPE, 7, os.dup(ring.fd))
    put(ring, 5)
    assert other.unread()["value"].tolist() == [5]
    other.release(1)
    assert ring.waiting == 0


def test_what_is_told_is_not_waited_for(worker: Worker) -> None:
    worker.ask("total")
    assert worker.send("sleep", seconds=0.0)
    assert worker.ask("total")["total"] == 10
    assert not worker.send("sleep", seconds=0.0, text="x" * 10_000)
    worker._process.kill()
    worker._process.wait()
    assert not worker.send("sleep", seconds=0.0)
    worker.close()
    assert not worker.send("sleep", seconds=0.0)


def test_what_is_told_to_a_worker_that_hangs_is_left_out_in_time(worker: Worker) -> None:
    worker.ask("total")
    assert worker.send("sleep", seconds=LONG_S)
    began, told = time.monotonic(), 0
    while worker.send("sleep", seconds=0.0, text="x" * 4000):
        told += 1
        assert told < 1000
    assert time.monotonic() - began < LONG_S
    worker._process.kill()


def test_a_worker_reads_what_was_written_while_it_started(ring: RingBuffer, worker: Worker) -> None:
    sent = 0
    while sent < 500 and worker.status is None:
        sent += put(ring, sent)
    while ring.waiting and worker.status is None:
        time.sleep(0.001)
    assert worker.ask("total") == {"total": 10 + sum(range(500)), "count": 500}


def test_an_error_of_the_worker_is_raised_here(worker: Worker) -> None:
    with pytest.raises(SkinError, match="command: must be one of total, sleep, die; got 'avg'"):
        worker.ask("avg")
    assert worker.ask("total")["total"] == 10


def test_a_worker_that_dies_is_told(worker: Worker) -> None:
    with pytest.raises(
        SkinError, match=r"summing_worker: must answer 'die'; worker exited early \(status 3\)"
    ):
        worker.ask("die")
    assert worker.status is not None


def test_a_worker_that_does_not_answer_is_told_and_ended(worker: Worker) -> None:
    worker.ask("total")
    with pytest.raises(SkinError, match="must answer 'sleep'; got timed out"):
        worker.ask("sleep", timeout_s=0.1, seconds=LONG_S)
    worker.close(5.0)
    assert worker.status is not None


def test_a_worker_ends_with_the_loop_however_that_ends() -> None:
    code = (
        "import sys, time\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[2])!r})\n"
        "from tests.skin.test_worker import DTYPE, MODULE\n"
        "from skin.worker import RingBuffer, Worker\n"
        "worker = Worker(MODULE, RingBuffer(DTYPE, 7), {'start': 0})\n"
        "worker.ask('total')\n"
        "print(worker._process.pid, flush=True)\n"
        "time.sleep(3600)\n"
    )
    loop = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert loop.stdout is not None
    with loop.stdout:
        pid = int(loop.stdout.readline())
    os.kill(loop.pid, signal.SIGKILL)
    loop.wait()
    until = time.monotonic() + LONG_S
    while not is_gone(pid):
        assert time.monotonic() < until
        time.sleep(0.05)
