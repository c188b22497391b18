"""The questions of docs/guides/bulk.md: asked as they stand there, and answered by plain
loops as well."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import skin
from skin.io.bulk import WANT, decode_logs
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write

TEXT = (Path(__file__).parents[3] / "docs" / "guides" / "bulk.md").read_text("utf-8")
SLIPS, HEAVY, HOT, FAULTS, HOURLY = re.findall(r"```sql\n(.*?)\n```", TEXT, re.DOTALL)
(POLARS,) = (code for code in re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL) if "pl." in code)
NEWTON, CELSIUS = 5, 60


@pytest.fixture(scope="module")
def decoded(tmp_path_factory):
    """Folder and states of a slide in which one board is silent for a while."""
    folder, frames = tmp_path_factory.mktemp("decoded"), frames_of("palm", "slide", 900)
    cycle = np.cumsum(frames["id"] == 0x80)
    silent = (frames["id"] == frames["id"][3]) & (cycle > 50) & (cycle < 90)
    write(log := folder / "run.log", frames[~silent])
    decode_logs("palm", [log], folder)
    return folder, [state.copy() for state in skin.decode_log("palm", log, want=WANT)]


@pytest.fixture
def ask(decoded, monkeypatch):
    """A function that asks duckdb."""
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    monkeypatch.chdir(decoded[0])

    def answers(question):
        result = duckdb.sql(question)
        return [dict(zip(result.columns, row, strict=True)) for row in result.fetchall()]

    return answers


def truth(states):
    """What the loops say: slips, most load of each contact, most temperature of each unit, troubled
    units."""
    most = {}
    for state in states:
        for contact in state.contacts:
            most[contact.id] = max(most.get(contact.id, 0.0), contact.load)
    slips = [(state.stamp_ns, one.id) for state in states for one in state.slips]
    hottest = np.max([state.units.temperature for state in states], axis=0)
    troubled = np.any([~state.units.valid for state in states], axis=0)
    return slips, most, hottest, troubled


@pytest.mark.long
def test_slips_and_loads(decoded, ask):
    slips, most, _, _ = truth(decoded[1])
    found = ask(SLIPS)
    assert len(slips) > 0
    assert sorted(one["id"] for one in found) == sorted(identity for _, identity in slips)
    assert {one["skin"] for one in found} == {"palm"}
    heavy = {one["id"]: one["most"] for one in ask(HEAVY)}
    assert heavy == {identity: load for identity, load in most.items() if load > NEWTON}
    (hour,) = ask(HOURLY)
    assert (hour["slips"], hour["contacts"], hour["most"]) == (
        len(slips), len(most), max(most.values())
    )  # fmt: skip


def test_temperatures_and_trouble(decoded, ask):
    _, _, hottest, troubled = truth(decoded[1])
    names = decoded[1][0].topology.unit_names
    assert ask(HOT) == []
    limit = float(np.median(hottest))
    assert HOT.count(str(CELSIUS)) == 1
    warm = {one["unit"]: one["most"] for one in ask(HOT.replace(str(CELSIUS), repr(limit)))}
    expected = {f"{names[i]}.temperature": hottest[i] for i in np.flatnonzero(hottest > limit)}
    assert warm == expected
    assert {one["unit"] for one in ask(FAULTS)} == {names[i] for i in np.flatnonzero(troubled)}


def test_polars_answers_alike(decoded, monkeypatch):
    pytest.importorskip("polars", reason="polars is not installed")
    monkeypatch.chdir(decoded[0])
    exec(POLARS, found := {})
    slips, most, _, troubled = truth(decoded[1])
    assert sorted(found["slips"]["id"]) == sorted(identity for _, identity in slips)
    assert dict(zip(found["heavy"]["id"], found["heavy"]["load"], strict=True)) == {
        identity: load for identity, load in most.items() if load > NEWTON
    }
    assert found["hourly"]["slip_began"].sum() == len(slips)
    assert found["hot"].is_empty()
    assert found["faults"]["unit"].n_unique() == np.count_nonzero(troubled)
