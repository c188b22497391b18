"""What is said while kernels are compiled: nothing, unless it takes long."""

from __future__ import annotations

import io
import logging
import re
import time

import pytest

from skin import compiling
from tests.fixtures.patience import LONG_S

LINE = "f3t-skin: compiling kernels for this machine, once …"


@pytest.fixture
def announcer(monkeypatch, caplog):
    monkeypatch.setattr(compiling, "PATIENCE_S", 0.1)
    caplog.set_level(logging.INFO, "skin")
    return compiling.Announcer()


def until(condition):
    end = time.monotonic() + LONG_S
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    assert condition()


def test_a_quick_kernel_is_not_worth_a_word(announcer, caplog, monkeypatch):
    monkeypatch.setattr(compiling, "PATIENCE_S", LONG_S)  # quick on any machine
    announcer.begins("quick")
    announcer.ends("quick")
    announcer.finish()
    time.sleep(0.2)
    assert caplog.messages == []


def test_a_long_compilation_is_announced_while_it_goes_on_and_once(announcer, caplog):
    announcer.begins("outer")
    announcer.begins("inner")
    announcer.ends("inner")
    until(lambda: caplog.messages)
    announcer.ends("outer")
    announcer.begins("another")
    until(lambda: not announcer._timer.is_alive())
    announcer.ends("another")
    assert caplog.messages == [LINE]
    announcer.finish()
    announcer.finish()
    assert len(caplog.messages) == 2
    assert re.fullmatch(r"f3t-skin: compiled in \d+\.\d+ s", caplog.messages[1])


def test_many_quick_kernels_are_long_together(announcer, caplog):
    for _ in range(20):
        announcer.begins("one")
        time.sleep(0.02)
        announcer.ends("one")
    announcer.finish()
    assert len(caplog.messages) == 2


def test_a_terminal_has_a_bar_that_goes_when_all_is_compiled(monkeypatch, caplog):
    monkeypatch.setattr(compiling, "PATIENCE_S", 0.05)
    terminal = io.StringIO()
    announcer = compiling.Announcer(terminal)
    for kernel in ("step", "films"):
        announcer.plans(kernel, 300)
    announcer.begins("step")
    announcer.begins("films")
    until(terminal.getvalue)
    announcer.ends("films")
    announcer.ends("step")
    announcer.finish()
    assert terminal.getvalue().split("\r\x1b[K")[1:] == [
        f"f3t-skin: compiling for this machine, once [{'.' * 24}] 0 of 2 kernels",
        f"f3t-skin: compiling for this machine, once [{'#' * 12}{'.' * 12}] 1 of 2 kernels",
        "",
    ]
    assert caplog.messages == []


def test_a_bar_is_for_terminals_and_not_where_no_colours_are_wanted(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    for file, no_color, has_bar in (
        (Terminal(), "", True), (Terminal(), "1", False), (io.StringIO(), "", False)
    ):  # fmt: skip
        monkeypatch.setattr("sys.stderr", file)
        monkeypatch.setenv("NO_COLOR", no_color)
        assert (compiling.terminal() is not None) == has_bar
