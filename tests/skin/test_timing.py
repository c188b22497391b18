"""Cycles that are late, left out or far apart: states are of the time that passed."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest

import skin
import topology
from bus.cycle import ClosedBy, RawCycle
from skin.contact.stream import ContactStream
from skin.errors import CountsError, SkinError
from skin.options import Options
from skin.pipeline import Pipeline
from tests.fixtures.cases import long_after_first
from tests.skin.test_values import FOLDER, PERIOD_NS

TIP = topology.load("fingertip").exact()
WANT = {"force", "temperature", "contacts", "slip", "wrench"}
BEGIN = 10**18


@pytest.fixture(scope="module")
def recorded():
    """Twelve units under a body that is pressed on, pulled and slips."""
    with np.load(FOLDER / "counts.npz") as file:
        return file["counts"], file["status"]


def played(recorded, cycles, numbers, stamps, **options):
    """Forces, ages of the contact and the pipeline, of some cycles by numbers and stamps."""
    counts, status = recorded
    pipeline = Pipeline(TIP, Options(want=WANT, **options))
    force, ages = {}, {}
    rest = (np.zeros(TIP.n, int),) * 3
    for cycle, number, stamp in zip(cycles, numbers, stamps, strict=True):
        raw = RawCycle(
            int(number), int(stamp), ClosedBy.COMPLETE, counts[cycle], status[cycle] == 0,
            status[cycle], *rest,
        )  # fmt: skip
        pipeline.counts[:], pipeline.status[:] = raw.counts, raw.status
        state = pipeline.state(raw)
        force[cycle] = state.units.force.copy()
        ages[cycle] = state.contacts[0].age_s if state.contacts else 0.0
    assert state.overruns == pipeline.clock.overruns
    return force, ages, pipeline


EVERY = np.arange(700)
FIFTH = EVERY[::5]
HALF = np.flatnonzero(np.random.default_rng(0).random(700) < 0.5)
JITTER = np.random.default_rng(1).normal(0.0, 0.07 * PERIOD_NS, 700)
STREAMS = {
    # cycles, numbers, stamps, largest difference of a force in newton
    "stamps that jitter": (EVERY, EVERY, EVERY * PERIOD_NS + JITTER, 1e-4),
    "every fifth SYNC": (FIFTH, FIFTH, FIFTH * PERIOD_NS, 0.03),
    "a slow host that counts on": (FIFTH, np.arange(140), FIFTH * PERIOD_NS, 0.03),
    "every other SYNC, at random": (HALF, HALF, HALF * PERIOD_NS, 0.1),
}


@long_after_first("name", STREAMS)
def test_seldom_cycles_give_the_forces_and_times_of_the_steady_stream(name, recorded):
    """The neighbours' displacements are those of the cycle before; the rest keeps to the time."""
    cycles, numbers, stamps, bound = STREAMS[name]
    steady, steady_ages, _ = played(recorded, EVERY, EVERY, BEGIN + EVERY * PERIOD_NS)
    force, ages, pipeline = played(recorded, cycles, numbers, BEGIN + np.rint(stamps))
    assert max(np.nanmax(np.abs(force[c] - steady[c])) for c in cycles) < bound
    assert max(ages.values()) > 1.0
    for cycle in cycles[len(cycles) // 2 :]:
        assert ages[cycle] == pytest.approx(steady_ages[cycle], abs=6 * 0.004)
    left_out = cycles[-1] - cycles[0] + 1 - cycles.size
    assert pipeline.clock.overruns == pytest.approx(left_out, abs=2)


def test_forces_keep_to_the_steady_stream_where_two_sweeps_are_taken(recorded):
    steady, *_ = played(recorded, EVERY, EVERY, EVERY * PERIOD_NS, sweeps=2)
    force, *_ = played(recorded, FIFTH, FIFTH, FIFTH * PERIOD_NS, sweeps=2)
    # what is left is the ambient field, which has seen a fifth of the noise
    assert max(np.nanmax(np.abs(force[c] - steady[c])) for c in FIFTH) < 0.02


@pytest.mark.long
def test_a_slow_consumer_sees_the_time_that_passed():
    with skin.open("strip", simulate=True) as strip:
        states = iter(strip)
        opened = time.monotonic()
        next(states)
        started = time.monotonic()
        for _ in range(25):
            time.sleep(0.02)
            asked = time.monotonic()
            state = next(states)
        ended = time.monotonic()
        clock, truth_s = strip.pipeline.clock, strip.nodes.truth.time_s
    # the first cycle was within (opened, started), the last within (asked, ended)
    least_s, most_s = asked - started - 0.005, ended - opened + 0.005
    assert least_s > 0.4
    assert least_s < clock.now_ns * 1e-9 < most_s
    assert least_s < truth_s < most_s
    assert state.overruns == strip.timing.overruns == state.cycle - 25
    assert truth_s == pytest.approx(state.cycle / 250.0)
    assert state.units.valid.all()


def in_two_threads(call, calls=4000):
    """What `call` raises, made by two threads at once until one is refused."""
    refused, stop = [], threading.Event()

    def work():
        for _ in range(calls):
            if stop.is_set():
                return
            try:
                call()
            except SkinError as error:
                refused.append(error)
                stop.set()

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return refused


def test_two_threads_on_one_decoder_are_refused():
    palm = topology.load("palm")
    decoder = skin.Decoder(palm, sweeps=2, ambient=True)
    raw = np.zeros((200, 6, palm.n), np.int16)
    decoder.warmup()
    (error, *_) = in_two_threads(lambda: decoder(raw))
    assert isinstance(error, CountsError)
    assert "palm: must be decoded from one thread at a time" in str(error)
    decoder(raw[0])  # who is refused leaves no lock behind


def test_two_threads_on_one_stream_of_contacts_are_refused():
    palm = topology.load("palm")
    stream = ContactStream(
        palm.position, palm.rotation, palm.area, palm.neighbour_start, palm.neighbour_index,
        want={"contacts"},
    )  # fmt: skip
    force = np.ones((3, palm.n))
    stream.warmup()
    stamps = itertools.count()
    (error, *_) = in_two_threads(
        lambda: stream.update(force, 0.01, stamp_ns=next(stamps)), calls=200_000
    )
    assert "one thread at a time" in str(error)
