"""What is said while kernels are compiled: nothing, unless it takes long."""

from __future__ import annotations

import io
import logging
import re
import time

import pytest
from numba.core import event

from bus.compiled import warm
from skin import compiling
from tests.fixtures.patience import LONG_S

LINE = "f3t-skin: compiling kernels for this machine, once …"


@pytest.fixture(autouse=True)
def fresh(monkeypatch, caplog):
    monkeypatch.setattr(compiling, "PATIENCE_S", 0.1)
    caplog.set_level(logging.INFO, "skin")
    for once in (compiling.announce, compiling._say_begun):
        once.cache_clear()
    yield
    compiling._watching.close()
    for once in (compiling.announce, compiling._say_begun):
        once.cache_clear()


@pytest.fixture
def two_jobs(monkeypatch):
    """Two kernels that other processes compile at once."""
    jobs = [warm.Job("module", name, ()) for name in ("step", "films")]
    monkeypatch.setattr(warm, "jobs_of", lambda calls: jobs)

    def side_by_side(jobs, done):
        for job in jobs:
            done(job)

    monkeypatch.setattr(warm, "side_by_side", side_by_side)


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Kernel:
    """What numba's events carry."""

    def py_func(self):
        """A kernel."""


def compiles(seconds):
    with event.trigger_event("numba:compile", data={"dispatcher": Kernel()}):
        time.sleep(seconds)


def until(condition):
    end = time.monotonic() + LONG_S
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    assert condition()


def test_a_quick_kernel_is_not_worth_a_word(monkeypatch, caplog):
    monkeypatch.setattr(compiling, "PATIENCE_S", LONG_S)  # quick on any machine
    compiling.announce()
    compiles(0.0)
    time.sleep(0.2)
    assert caplog.messages == []


def test_a_long_compilation_is_announced_while_it_goes_on_and_once(caplog):
    compiling.announce()
    with event.trigger_event("numba:compile", data={"dispatcher": Kernel()}):
        compiles(0.0)
        until(lambda: caplog.messages)
    compiles(0.3)
    assert caplog.messages == [LINE]


def test_nothing_is_said_where_nothing_is_to_be_compiled(monkeypatch, caplog):
    monkeypatch.setattr(warm, "jobs_of", lambda calls: [])
    compiling.compile_calls([]).join()
    assert caplog.messages == []


def test_a_log_has_two_lines(two_jobs, monkeypatch, caplog):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    compiling.compile_calls([]).join()
    begun, done = caplog.messages
    assert begun == LINE
    assert re.fullmatch(r"f3t-skin: compiled in \d+\.\d+ s", done)


def test_what_this_process_compiles_first_is_not_announced_again(two_jobs, monkeypatch, caplog):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    compiling.announce()
    with event.trigger_event("numba:compile", data={"dispatcher": Kernel()}):
        until(lambda: caplog.messages)
    compiling.compile_calls([]).join()
    assert caplog.messages.count(LINE) == 1


def test_a_terminal_has_a_bar_that_goes_when_all_is_compiled(two_jobs, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("COLUMNS", "200")
    compiling.compile_calls([]).join()
    bars = [f"{'#' * full}{'.' * (24 - full)}] {done} of 2" for full, done in
            ((0, 0), (12, 1), (24, 2))]  # fmt: skip
    *drawn, last = terminal.getvalue().split("\r\x1b[K")[1:]
    assert last == ""
    for bar, text in zip(bars, drawn, strict=True):
        assert text.startswith(f"f3t-skin: compiling for this machine, once [{bar} kernels")


def test_a_bar_is_for_terminals_and_not_where_no_colours_are_wanted(monkeypatch):
    for file, no_color, has_bar in (
        (Terminal(), "", True), (Terminal(), "1", False), (io.StringIO(), "", False)
    ):  # fmt: skip
        monkeypatch.setattr("sys.stderr", file)
        monkeypatch.setenv("NO_COLOR", no_color)
        assert (compiling.terminal() is not None) == has_bar
