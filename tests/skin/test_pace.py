"""When a live skin looks at its buses: it hears what has come, sleeps while it need not."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest

import topology
from bus.datagram import DatagramTransport
from bus.frame import FrameBatch
from bus.linux import has_batches
from bus.memory import MemoryTransport
from bus.status import Status
from bus.wait import IdleWindow
from skin.sim.node import SimulatedUnits
from tests.fixtures.datagram import sockets
from tests.fixtures.live import over

PERIOD_NS = 4_000_000


@pytest.fixture
def slow_palm(tmp_path):
    """A palm at 50 Hz."""
    text, file = topology.load("palm").path.read_text(), tmp_path / "palm.toml"
    file.write_text(text.replace("cycle_rate_hz = 250", "cycle_rate_hz = 50"))
    return topology.load(file)


def test_a_board_that_comes_back_after_all_others_is_heard():
    """Its frame, the last of each cycle, is there before the next SYNC."""
    palm = topology.load("palm")
    near, far = MemoryTransport.pair()
    nodes, out, owed, looks = SimulatedUnits(palm), FrameBatch(64), [], []
    asked = itertools.count()

    def answer(records):
        out.clear()
        nodes.respond(records, out)
        last = out.frames["id"] == palm.frames.can_id[-1]
        far.send(out.frames[~last])
        looks.clear()
        if not 2 <= next(asked) < 10:
            owed.append(out.frames[last])

    def look(batch, wait_ns):
        looks.append(wait_ns)
        if len(looks) == 2 and owed:
            far.send(owed.pop())
        return receive(batch, wait_ns)

    far.listener = answer
    with over(palm, [near], pace=False, deadline_s=0.05) as opened:
        receive, opened._waiter.receive = opened._waiter.receive, look
        flags = []
        for state in itertools.islice(opened, 16):
            flags.append(Status(int(state.units.status[-1])))
            while owed:
                far.send(owed.pop())
    assert Status.LATE not in flags[1]
    assert Status.STALE in flags[9]
    assert not any(Status.LATE in each for each in flags[12:])


@pytest.mark.long
@pytest.mark.skipif(not has_batches(), reason="needs a 64-bit Linux")
def test_arrivals_that_complete_no_cycle_are_slept_through(slow_palm):
    """13 frames, 0.5 ms apart: a look at each would be 13 looks a cycle. A busy machine delays the
    frames of some cycles; it has to sleep through those of ten in a row."""
    near, far = (DatagramTransport(end, "end") for end in sockets())
    nodes, stop, looks, each = SimulatedUnits(slow_palm), threading.Event(), [], []

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
    with over(slow_palm, [near], deadline_s=0.5) as opened:
        receive = opened._waiter.receive
        opened._waiter.receive = lambda *given: looks.append(0) or receive(*given)
        states = iter(opened)
        while len(each) < 500 and (len(each) < 10 or np.median(each[-10:]) >= 9):
            looks.clear()
            next(states)
            each.append(len(looks))
    stop.set()
    units.join()
    far.close()
    assert np.median(each[-10:]) < 9


def test_a_lull_ends_before_cycles_are_complete_and_shrinks_where_it_was_too_long():
    lull = IdleWindow(PERIOD_NS)
    for _ in range(100):
        lull.learn(3_000_000, slept_too_long=False)
    assert 2_700_000 < lull.ns <= 2_750_000
    for _ in range(3):
        lull.learn(lull.ns, slept_too_long=True)
    assert lull.ns < 1_200_000
    for _ in range(40):
        lull.learn(100_000, slept_too_long=False)
    assert lull.ns == 0
    slow = IdleWindow(10 * 10**9)
    for _ in range(100):
        slow.learn(5 * 10**9, slept_too_long=False)
    assert slow.ns <= 20_000_000, "who closes a skin waits for its end"
