"""Blocks of units that several threads decode: the same results, whoever decodes what."""

from __future__ import annotations

import multiprocessing
import threading

import pytest

from skin.decode import sharing
from skin.decode.decoder import Decoder
from tests.fixtures.patience import LONG_S
from tests.skin.decode.test_plan import FIELDS, scene

UNITS = 700
"""Six blocks, the last of them not whole."""


@pytest.fixture
def always_shared(monkeypatch):
    monkeypatch.setattr(sharing, "ENOUGH", 1)


def told(reading):
    """All that a reading says, to the bit."""
    values = (getattr(reading, name) for name in (*FIELDS, "temperature", "status", "valid"))
    return [value.tobytes() for value in values]


def decoded(workers, units=UNITS, **options):
    """Cycles one by one, a batch, the last cycle once more, and cycles again."""
    skin, raw, status = scene(units, 7)
    decoder = Decoder(skin, workers=workers, **{"sweeps": 0, "ambient": False} | options)
    seen = [told(decoder(counts, flags)) for counts, flags in zip(raw[:7], status, strict=False)]
    seen.append(told(decoder(raw, status)))
    seen.append(told(decoder(raw[-1], status[-1], advance=False)))
    decoder.reset()
    seen.append(told(decoder(raw[:9], status[:9])))
    return seen + [told(decoder(counts)) for counts in raw[9:16]]


@pytest.mark.parametrize("workers", [2, 4, 50])
@pytest.mark.parametrize("options", [{}, {"skip": True}, {"skip": True, "sweeps": 1}])
def test_threads_change_no_result(always_shared, options, workers):
    assert decoded(workers, **options) == decoded(1, **options)


def test_two_threads_have_a_block_each(always_shared):
    assert decoded(2, 130, skip=True) == decoded(1, 130, skip=True)


def test_batches_are_shared_where_cycles_are_not(monkeypatch):
    alone = decoded(1, skip=True)
    monkeypatch.setattr(sharing, "ENOUGH", 2 * UNITS)
    assert decoded(3, skip=True) == alone


def test_what_is_worth_it_is_done_in_other_threads(monkeypatch):
    skin, raw, _ = scene(UNITS, 1)
    decoder = Decoder(skin, workers=3, sweeps=0, ambient=False)
    decoder(raw[0])
    asked = []
    monkeypatch.setattr(sharing, "together", lambda calls: asked.append(len(calls)))
    decoder(raw)
    monkeypatch.setattr(sharing, "ENOUGH", raw.shape[0] * UNITS)
    decoder(raw)
    assert asked == [1, 3]


def test_calls_are_made_at_the_same_time():
    here = threading.Barrier(2, timeout=LONG_S)
    sharing.together([here.wait, here.wait])


@pytest.mark.parametrize("failing", [0, 1])
def test_a_call_that_fails_is_told_when_the_others_have_ended(failing):
    ended = threading.Event()

    def fail():
        raise ValueError("too much")

    calls = [ended.set, ended.set]
    calls[failing] = fail
    with pytest.raises(ValueError, match="too much"):
        sharing.together(calls)
    assert ended.is_set()


@pytest.mark.skipif(not hasattr(sharing.os, "fork"), reason="no fork")
def test_a_child_process_has_threads_of_its_own(always_shared):
    expected = decoded(2)
    context = multiprocessing.get_context("fork")
    answers = context.SimpleQueue()
    child = context.Process(target=lambda: answers.put(decoded(2) == expected), daemon=True)
    child.start()
    child.join(60.0)
    assert child.exitcode == 0
    assert answers.get()
