"""What is said while kernels are compiled."""

from __future__ import annotations

import io
import logging
import re

import pytest

from bus.compiled import cache, warm
from skin import compiling

LINE = "f3t-skin: compiling kernels for this machine, once …"


@pytest.fixture(autouse=True)
def fresh(caplog):
    caplog.set_level(logging.INFO, "skin")
    compiling._say_begun.cache_clear()
    yield
    compiling._say_begun.cache_clear()


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


def test_what_compiles_as_it_goes_is_announced_once_where_nothing_is_kept(
    monkeypatch, caplog, tmp_path
):
    monkeypatch.setattr(cache, "folder", lambda: tmp_path)
    (tmp_path / "kernel.nbi").touch()
    compiling.announce()
    assert caplog.messages == []
    (tmp_path / "kernel.nbi").unlink()
    compiling.announce()
    compiling.announce()
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
