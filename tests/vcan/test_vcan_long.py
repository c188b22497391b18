"""Ten minutes of a palm on real CAN sockets: every frame has arrived or is counted as lost."""

import os
import threading
import time

import numpy as np
import pytest

import topology
from bus.assemble import Assembler
from bus.codec import Packer
from bus.frame import FrameBatch
from bus.open import open_transport
from topology import CHANNELS

DURATION_S = float(os.environ.get("F3T_LONG_S", "600"))
SPREAD = 113  # fits the narrowest channel, and tells cycles apart whose SYNC counters are the same


def counts_of(skin, number):
    """Counts that tell unit, channel and cycle."""
    place = np.arange(skin.n) + skin.n * np.arange(len(CHANNELS))[:, np.newaxis]
    return ((place + 7 * number) % SPREAD * skin.wired).astype(np.int16)


def send_cycles(skin, transport, numbers, sent):
    """SYNC and data of all units at the cycle rate; one that is late is sent at once."""
    packer, out = Packer(skin), FrameBatch(len(skin.frames) + 1)
    start_ns, period_ns = time.monotonic_ns(), round(1e9 / skin.cycle_rate_hz)
    for i, number in enumerate(numbers):
        wait_ns = start_ns + i * period_ns - time.monotonic_ns()
        if wait_ns > 0:
            time.sleep(wait_ns * 1e-9)
        out.clear()
        out.append(skin.sync_id, bytes([number & 0xFF]))
        packer(counts_of(skin, number), out, sequence=number & 0xFF)
        sent.append(transport.send(out.frames))


@pytest.mark.long
def test_ten_minutes_of_64_units_at_250_hz_are_accounted_for():
    skin = topology.load("palm").on(interface="socketcan", channel="vcan0")
    cycles, per_cycle = round(DURATION_S * skin.cycle_rate_hz), len(skin.frames) + 1
    sent, assembler, batch = [], Assembler(skin), FrameBatch(4096)
    valid = missing = wrong = closed = 0

    def judge(seen):
        nonlocal valid, missing, wrong, closed
        right = ((seen.counts == counts_of(skin, seen.number)) | ~skin.wired).all(axis=0)
        wrong += int((seen.valid & ~right).sum())
        valid += int(seen.valid.sum())
        missing += int((~seen.valid).sum())
        closed += 1

    def take(timeout_s):
        batch.clear()
        taken = far.receive(batch, timeout_s)
        for seen in assembler.feed(batch.frames):
            judge(seen)
        return taken

    with open_transport(skin.buses[0]) as near, open_transport(skin.buses[0]) as far:
        started = time.monotonic()
        units = threading.Thread(
            target=send_cycles, args=(skin, near, range(cycles - 1), sent), daemon=True
        )
        units.start()
        while units.is_alive():
            take(0.1)
        while take(0.2):
            pass
        # The last one finds the queue empty: it shows the gaps of all that went before.
        send_cycles(skin, near, [cycles - 1], sent)
        while take(0.2):
            pass
        if (last := assembler.flush()) is not None:
            judge(last)
        seconds = time.monotonic() - started
        drops, counters = far.counters.queue_drops, assembler.counters
        received = far.counters.received

    print(
        f"{cycles} cycles in {seconds:.1f} s: {sum(sent)} frames sent, {received} received, "
        f"{drops} dropped by the queue; data {counters.data}, late {counters.late}, "
        f"lost {counters.lost}; units x cycles: {valid} valid, {missing} flagged, {wrong} wrong"
    )
    assert sum(sent) == cycles * per_cycle
    assert received + drops == sum(sent)
    arrived = counters.data + counters.late
    assert counters.sync + arrived == received, "no frame is anything else"
    assert counters.lost == cycles * len(skin.frames) - arrived
    assert valid + missing == closed * skin.n
    assert closed == counters.sync
    assert wrong == 0
    if drops == 0:
        assert valid == cycles * skin.n
