"""What is said while kernels are compiled: nothing, unless it takes long."""

from __future__ import annotations

import io
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


def test_the_share_of_a_bar_goes_with_code_and_time_and_never_back():
    progress = compiling.Progress()
    for kernel, size in (("long", 600), ("short", 100), ("other", 100)):
        progress.planned(kernel, size)
    assert progress.share(0.0) == 0.0
    progress.begins("long", 0.0)
    progress.begins("short", 0.0)
    assert progress.share(1.0) == 0.0  # nothing to go by yet
    progress.ends("short", 2.0)
    assert progress.share(2.0) == pytest.approx((100 + 2.0 * 50.0) / 800)
    assert progress.share(4.0) == pytest.approx((100 + 4.0 * 50.0) / 800)
    progress.planned("late", 800)
    assert progress.share(4.0) == pytest.approx(300 / 800)
    assert progress.share(1e6) == pytest.approx((100 + 0.95 * 600) / 1600)
    progress.ends("long", 20.0)
    for kernel in ("other", "late"):
        progress.begins(kernel, 20.0)
        progress.ends(kernel, 21.0)
    assert progress.share(21.0) == 1.0


@pytest.mark.parametrize(
    ("kernel", "name"),
    [
        ("step_python", "step"),
        ("_share_python", "share"),
        ("decode_python.<locals>.decode", "decode"),
        ("_caller.013b2fa0ef35a79ba60bed0d", "caller"),
    ],
)
def test_kernels_have_names_for_people(kernel, name):
    assert compiling.short(kernel) == name


def test_a_terminal_has_a_bar_that_goes_when_all_is_compiled(monkeypatch, caplog):
    for name, seconds in (("PATIENCE_S", 0.05), ("PAUSE_S", LONG_S), ("DRAW_S", 0.01)):
        monkeypatch.setattr(compiling, name, seconds)
    monkeypatch.setenv("COLUMNS", "200")
    terminal = io.StringIO()
    announcer = compiling.Announcer(terminal)
    for kernel, size in (("step_python", 300), ("films_python", 100)):
        announcer.plans(kernel, size)
        announcer.begins(kernel)
    until(lambda: terminal.getvalue().count("\r") >= 2)
    announcer.ends("films_python")
    until(lambda: "1 of 2 kernels: step" in terminal.getvalue())
    announcer.ends("step_python")
    announcer.finish()
    first, *_, last = terminal.getvalue().split("\r\x1b[K")[1:]
    assert re.fullmatch(
        r"f3t-skin: compiling for this machine, once \[[#.]{24}\] +\d+% +\d+ s, "
        r"0 of 2 kernels: step, films", first,
    )  # fmt: skip
    assert last == ""
    assert said(caplog) == []


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
