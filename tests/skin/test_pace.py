"""When a live skin looks at its buses: it hears what has come, sleeps while it need not."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest

import skin
import topology
from bus.datagram import DatagramTransport
from bus.frame import FrameBatch
from bus.linux import has_batches
from bus.memory import MemoryTransport
from bus.status import Status
from bus.wait import Lull
from skin.sim.node import Nodes
from tests.fixtures.datagram import sockets

PERIOD_NS = 4_000_000


@pytest.fixture
def slow_palm(tmp_path):
    """A palm at 50 Hz."""
    text = (
        topology.load("palm").path.read_text().replace("cycle_rate_hz = 250", "cycle_rate_hz = 50")
    )
    file = tmp_path / "palm.toml"
    file.write_text(text.replace("cycle_rate_hz = 250", "cycle_rate_hz = 50"))
    return topology.load(file)


def test_a_board_that_comes_back_after_all_others_is_heard(slow_palm):
    """Its frame, the last of each cycle, is there before the next SYNC."""
    near, far = MemoryTransport.pair()
    nodes, out, last_words = Nodes(slow_palm), FrameBatch(64), []
    asked = itertools.count()

    def answer(records):
        for record in records:
            out.clear()
            nodes.respond(record[np.newaxis], out)
            last = out.frames["id"] == slow_palm.frames.can_id[-1]
            far.send(out.frames[~last])
            if not 2 <= next(asked) < 10:
                timer = threading.Timer(0.006, far.send, (out.frames[last],))
                timer.start()
                last_words.append(timer)

    far.listener = answer
    with skin.open(slow_palm, transports=[near]) as opened:
        states = [state.units.status[-1] for state in itertools.islice(opened, 16)]
    for timer in last_words:
        timer.join()
    assert states[1] & Status.LATE == 0
    assert states[9] & Status.STALE
    assert [status & Status.LATE for status in states[12:]] == [0] * 4


@pytest.mark.skipif(not has_batches(), reason="needs a 64-bit Linux")
def test_arrivals_that_complete_no_cycle_are_slept_through(slow_palm):
    """13 frames, 0.5 ms apart: a look at each would be 13 looks a cycle."""
    near, far = (DatagramTransport(end, "end") for end in sockets())
    nodes, stop, looks = Nodes(slow_palm), threading.Event(), []

    def answer():
        heard, out = FrameBatch(8), FrameBatch(64)
        while not stop.is_set():
            heard.clear()
            far.receive(heard, 0.05)
            for record in heard.frames:
                out.clear()
                nodes.respond(record[np.newaxis], out)
                for i in range(out.count):
                    time.sleep(5e-4)
                    far.send(out.frames[i : i + 1])

    units = threading.Thread(target=answer)
    units.start()
    with skin.open(slow_palm, transports=[near]) as opened:
        receive = opened._waiter.receive
        opened._waiter.receive = lambda *given: looks.append(0) or receive(*given)
        states = iter(opened)
        for _ in range(30):
            next(states)
        looks.clear()
        whole = [next(states).coverage for _ in range(20)]
    stop.set()
    units.join()
    far.close()
    assert whole == pytest.approx([1.0] * 20)
    assert len(looks) < 20 * 9


def test_a_lull_ends_before_cycles_are_complete_and_shrinks_where_it_was_too_long():
    lull = Lull(PERIOD_NS)
    for _ in range(100):
        lull.learn(3_000_000, slept_too_long=False)
    assert 2_700_000 < lull.ns <= 2_750_000
    for _ in range(3):
        lull.learn(lull.ns, slept_too_long=True)
    assert lull.ns < 1_200_000
    for _ in range(40):
        lull.learn(100_000, slept_too_long=False)
    assert lull.ns == 0
    slow = Lull(10 * 10**9)
    for _ in range(100):
        slow.learn(5 * 10**9, slept_too_long=False)
    assert slow.ns <= 20_000_000, "who closes a skin waits for its end"
