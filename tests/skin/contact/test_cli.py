"""Contacts where a person sees them: the live table, the demo, decoded logs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import skin
from skin.cli import main
from skin.contact.record import Flag, SlipState
from skin.view.terminal import LiveTable

LOGS = Path(__file__).parents[2] / "golden" / "logs"


@pytest.fixture
def touched():
    """A palm under a load: the skin, its state, a table."""
    with skin.open("palm", simulate=True, pace=False, seed=3) as palm:
        state = next(s for s in palm if s.contacts and s.contacts[0].load > 8.0)
        yield palm, state, LiveTable(palm.topology)


def test_table_names_what_touches(touched):
    _, state, table = touched
    record = state.contacts[0].record
    record["slip"], record["margin_at_least"], record["friction"] = SlipState.STICK, 0.62, 0.5
    (line,) = (line for line in table.lines(state) if "contact 1" in line)
    assert f"{record['load']:.2f} N" in line
    assert "stick" in line
    assert "margin 62 %" in line
    record["slip"], record["margin_at_least"] = SlipState.UNKNOWN, np.nan
    (line,) = (line for line in table.lines(state) if "contact 1" in line)
    assert "margin" not in line
    assert "none" not in line
    assert "not whole" not in line
    record["flags"] |= int(Flag.UNSEEN)
    (line,) = (line for line in table.lines(state) if "contact 1" in line)
    assert line.endswith("not whole")
    assert "not whole" in repr(state.contacts[0])


def test_table_is_as_long_whatever_touches(touched):
    palm, state, table = touched
    lengths = {len(table.lines(state))}
    contact = state.contacts[0]
    for contacts in ([], [contact, contact], [contact] * 7):
        state.contacts = contacts
        lines = table.lines(state)
        lengths.add(len(lines))
        assert sum("contact 1" in line for line in lines) == min(len(contacts), 3)
    assert len(lengths) == 1
    assert palm.topology.n == 64


def test_decoded_log_says_what_touches_each_unit(tmp_path, capsys):
    log, output = LOGS / "palm-vcan.log", tmp_path / "palm.npz"
    assert main(["decode", "palm", str(log), "--output", str(output)]) == 0
    capsys.readouterr()
    with np.load(output) as found:
        contact, force, wrench = found["contact"], found["force"], found["wrench"]
    assert contact.shape == force[:, 2].shape
    assert (force[:, 2][contact > 0] > 0.02).all()
    held = (force[:, 2] * (contact > 0)).sum(axis=1)
    np.testing.assert_allclose(held, -wrench[:, 2], atol=1e-9)
    table = tmp_path / "palm.csv"
    assert main(["decode", "palm", str(log), "--output", str(table)]) == 0
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name.endswith(".contact")]
    assert [[int(row[name]) for name in names] for row in rows] == contact.tolist()
