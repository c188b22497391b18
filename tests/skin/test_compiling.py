"""What is said while kernels are compiled: nothing, unless it takes long."""

from __future__ import annotations

import logging
import re
import time

import pytest

from skin import compiling
from tests.fixtures.patience import LONG_S


@pytest.fixture
def announcer(monkeypatch, caplog):
    for name in ("PATIENCE_S", "PAUSE_S"):
        monkeypatch.setattr(compiling, name, 0.2)
    caplog.set_level(logging.INFO, "skin")
    return compiling.Announcer()


def said(caplog):
    return [record.getMessage() for record in caplog.records]


def until(condition):
    end = time.monotonic() + LONG_S
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    assert condition()


def test_a_quick_kernel_is_not_worth_a_word(announcer, caplog, monkeypatch):
    monkeypatch.setattr(compiling, "PATIENCE_S", LONG_S)  # quick on any machine
    announcer.begins("quick")
    assert announcer.kernels == ["quick"]
    announcer.ends("quick")
    announcer.finish()
    time.sleep(0.3)
    assert said(caplog) == []
    assert announcer.kernels == []


def test_a_long_compilation_is_announced_while_it_goes_on(announcer, caplog):
    announcer.begins("outer")
    announcer.begins("inner")
    announcer.ends("inner")
    until(lambda: said(caplog))
    assert said(caplog) == ["f3t-skin: compiling kernels for this machine, once …"]
    announcer.finish()  # not yet
    assert len(said(caplog)) == 1
    announcer.ends("outer")
    announcer.finish()
    assert len(said(caplog)) == 2
    assert re.fullmatch(r"f3t-skin: compiled in \d+\.\d+ s.*", said(caplog)[1])


def test_many_quick_kernels_are_long_together(announcer, caplog):
    for _ in range(20):
        announcer.begins("one")
        time.sleep(0.02)
        announcer.ends("one")
    announcer.finish()
    assert len(said(caplog)) == 2


def test_who_forgets_to_finish_hears_of_the_end_all_the_same(announcer, caplog):
    announcer.begins("slow")
    until(lambda: len(said(caplog)) == 1)
    announcer.ends("slow")
    until(lambda: len(said(caplog)) == 2)


def test_pauses_are_no_end_while_more_is_to_come(announcer, caplog):
    announcer.hold()
    announcer.begins("one")
    until(lambda: len(said(caplog)) == 1)
    announcer.ends("one")
    time.sleep(0.5)
    announcer.begins("other")
    announcer.ends("other")
    assert len(said(caplog)) == 1
    announcer.finish()
    assert len(said(caplog)) == 2
