"""The live table: where units are drawn, what a flagged unit looks like, who gets no table."""

from __future__ import annotations

import io
import re
from dataclasses import astuple

import numpy as np
import pytest

import topology
from bus.cycle import ClosedBy, FrameCounters
from skin.state import Reading, State, Status
from skin.view.terminal import LiveTable, unit_map


class Terminal(io.StringIO):
    """A text stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def palm():
    return topology.load("palm")


def state_of(palm, status=None, load=0.0):
    n = palm.n
    force = np.zeros((3, n))
    force[2] = load
    status = np.zeros(n, np.uint16) if status is None else status
    reading = Reading(
        temperature=np.full(n, 31.5),
        force=force,
        tangential=None,
        theta=None,
        displacement_mm=None,
        status=status,
        valid=status == 0,
    )
    wrench = np.array([0.0, 0.0, -force[2].sum(), 0.0, 0.0, 0.0])
    return State(
        cycle=7,
        stamp_ns=0,
        units=reading,
        wrench=wrench,
        centroid=np.full(3, np.nan),
        closed_by=ClosedBy.COMPLETE,
        totals=np.array(astuple(FrameCounters(data=13, lost=2))),
        topology=palm,
    )


def test_grid_fills_its_map_once(palm):
    cells, shape = unit_map(palm)
    assert shape == (8, 8)
    assert len({tuple(cell) for cell in cells.T}) == palm.n
    top_right = np.argmax(palm.position[0] + palm.position[1])
    assert cells[:, top_right].tolist() == [0, 7]


@pytest.mark.parametrize("name", ["fingertip", "hand", "strip"])
def test_every_skin_fits_the_width(name):
    cells, shape = unit_map(topology.load(name), width=40)
    assert shape[1] <= 40
    assert (cells >= 0).all()
    assert (cells[0] < shape[0]).all()
    assert (cells[1] < shape[1]).all()


def test_flagged_units_are_marked_and_named(palm):
    status = np.zeros(palm.n, np.uint16)
    status[5] = int(Status.NEVER)
    status[9] = int(Status.STALE | Status.LATE)
    text = "\n".join(LiveTable(palm).lines(state_of(palm, status)))
    assert text.count("! \x1b[0m") == 2
    assert f"! {palm.unit_names[5]}: never" in text
    assert f"! {palm.unit_names[9]}: late, stale" in text


def test_a_wrench_of_a_part_and_the_test_ratio_of_a_flagged_unit_are_shown(palm):
    status, table = np.zeros(palm.n, np.uint16), LiveTable(palm)
    status[5] = int(Status.MAGNETIC_ANOMALY)
    state = state_of(palm, status)
    assert "whole" not in "\n".join(table.lines(state))
    state.whole = False
    state.units.test_ratio = np.full(palm.n, 2.25)
    text = "\n".join(table.lines(state))
    assert "  N  not whole" in text
    assert f"! {palm.unit_names[5]}: magnetic_anomaly, test ratio 2.25" in text


def test_long_trouble_is_counted_not_listed(palm):
    status = np.full(palm.n, int(Status.NEVER), np.uint16)
    text = "\n".join(LiveTable(palm).lines(state_of(palm, status)))
    assert f"! and {palm.n - 3} more units" in text


def test_numbers_shown(palm):
    text = "\n".join(LiveTable(palm).lines(state_of(palm, load=0.5)))
    assert f"{-0.5 * palm.n:+7.2f}" in text
    assert "31.5 mean" in text
    assert "lost 2" in text
    assert "late" not in text


def test_terminal_is_redrawn_in_place_and_seldom(palm):
    stream = Terminal()
    table = LiveTable(palm, stream=stream)
    for _ in range(50):
        table.show(state_of(palm), 10_000)
    first = stream.getvalue()
    assert first.count("cycle 7") == 1
    table._next = 0.0
    table.show(state_of(palm), 10_000)
    assert stream.getvalue()[len(first) :].startswith(f"\x1b[{first.count(chr(10))}A")


def test_no_terminal_no_table(palm):
    stream = io.StringIO()
    LiveTable(palm, stream=stream).show(state_of(palm), 10_000)
    assert stream.getvalue() == ""


def test_no_colour_where_none_is_wanted(palm, monkeypatch):
    status = np.zeros(palm.n, np.uint16)
    status[3] = int(Status.NEVER)
    monkeypatch.setenv("NO_COLOR", "1")
    plain = LiveTable(palm, stream=Terminal()).lines(state_of(palm, status, load=3.0))
    assert not any("\x1b" in line for line in plain)
    monkeypatch.setenv("NO_COLOR", "")
    coloured = LiveTable(palm, stream=Terminal()).lines(state_of(palm, status, load=3.0))
    assert [re.sub(r"\x1b\[[0-9;]*m", "", line) for line in coloured] == plain
