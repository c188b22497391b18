"""A skin and the threads beside the one that iterates: closing, and the newest state."""

from __future__ import annotations

import itertools
import threading

import pytest

import skin
import topology
from bus.memory import MemoryTransport
from skin.sim.node import SimulatedUnits
from skin.state import if_wanted
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import over
from tests.fixtures.patience import LONG_S


@long_after_first("name", ["strip", "fingertip"])
@long_after_first("sync", ["host", "bus"])
def test_a_skin_that_another_thread_closes_ends(name, sync):
    """At any moment of a cycle, while the thread that iterates may close it as well."""
    for delay_ms in (0.0, 0.3, 1.0, 3.0):
        ends = [MemoryTransport.pair(i) for i in range(len(topology.load(name).buses))]
        SimulatedUnits(topology.load(name)).attach([far for _, far in ends])
        near = [end for end, _ in ends]
        with over(name, near, pace=False, sync=sync) as opened:
            closing = threading.Timer(1e-3 * delay_ms, opened.close)
            for number, _ in enumerate(opened):
                if number == 0:
                    closing.start()
            closing.join()


def test_a_skin_closed_within_a_send_ends():
    near, _ = MemoryTransport.pair()
    with over("strip", [near], pace=False) as opened:
        send = near.send

        def send_and_close(records):
            thread = threading.Thread(target=opened.close)
            thread.start()
            thread.join()
            return send(records)

        near.send = send_and_close
        assert list(opened) == []


@pytest.mark.long
def test_slips_are_told_once_and_units_by_their_names():
    names = topology.load("palm").unit_names
    with skin.open("palm", simulate="slide", pace=False, want={"slip"}) as palm:
        begun, slipping = [], set()
        for state in itertools.islice(palm, 1000):
            now = {contact.id for contact in state.contacts if contact.slip.name in SLIPPING}
            begun += [contact.id for contact in state.slips]
            assert {contact.id for contact in state.slips} == now - slipping
            slipping = now
            for contact in state.contacts:
                assert contact.unit_names == [names[i] for i in contact.units]
    assert begun
    with skin.open("strip", simulate=True, pace=False, want={"contacts"}) as strip:
        assert if_wanted(next(iter(strip)), "slips") is None


SLIPPING = ("INCIPIENT", "GROSS")


def test_the_newest_state_is_whole_for_a_thread_beside():
    """Every unit lies in every cycle about the number of the cycle, all in the same way."""
    with skin.open("palm", simulate=True, pace=False, want={"contacts", "force"}) as palm:
        assert palm.latest() is None
        found, done = [], threading.Event()

        def watch():
            while not done.is_set():
                state = palm.latest()
                if state is not None:
                    found.append((state, state.cycle, state.units.force.tobytes()))

        watcher = threading.Thread(target=watch)
        watcher.start()
        kept = {}
        for state in itertools.islice(palm, 200):
            kept[state.cycle] = state.units.force.tobytes()
        done.set()
        watcher.join()
        assert palm.latest().cycle == 199
    cycles = [cycle for _, cycle, _ in found]
    assert cycles == sorted(cycles)
    assert len(set(cycles)) > 10
    for state, cycle, force in found:
        assert force == kept[cycle] == state.units.force.tobytes()


def test_the_newest_state_is_told_at_once_while_the_loop_waits():
    loaded, (near, far) = topology.load("strip"), MemoryTransport.pair()
    SimulatedUnits(loaded).attach([far])
    with over(loaded, [near], pace=False, deadline_s=LONG_S) as strip:
        strip.latest()
        states = iter(strip)
        next(states)
        far.listener = lambda records: None  # and nobody answers from now on
        loop = threading.Thread(target=next, args=(states, None))
        loop.start()
        assert strip.latest().cycle == 0
        assert loop.is_alive()
    loop.join()
