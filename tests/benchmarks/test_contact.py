"""The benchmark of contacts runs, and numpy finds the same contacts."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import topology
from benchmarks import contact, peers_contact, peers_live
from benchmarks.peers_contact import NumpyContacts, force_sigma
from skin.options import Options
from skin.pipeline import Pipeline
from skin.sim.unit import UnitSimulator


@pytest.mark.long
def test_benchmark_gives_errors_beside_times(monkeypatch):
    monkeypatch.setattr(contact, "SHAPES", {64: "grid"})
    monkeypatch.setattr(contact, "CYCLES", 12)
    monkeypatch.setattr(contact, "LAPS", (1, 1))
    monkeypatch.setattr(contact, "TRIALS", (12, 4))
    figures = json.loads(json.dumps(contact.run(quick=True)))
    rows = figures["sizes"]["64"]
    assert set(rows) == {"0", "1", "3"}
    low, high = figures["live_numpy_ratio_64_95"]
    assert low <= figures["live_numpy_ratio_64"] <= high
    assert figures["cycle_us_p50_64"] == rows["3"]["full"]["us_p50"]
    for row in rows.values():
        assert 0.0 < row["full"]["us_p50"] <= row["full"]["us_p99"]
        assert 0.0 < row["plain"]["us_p50"] <= row["plain"]["us_p99"]
        assert row["numpy_ratio"] > 1.0
        assert row["live_numpy_ratio"] > 1.0
    assert [row["contacts"] for row in figures["many"]] == [1, 4, 4, 4], "four tiles of a palm"
    for row in figures["many"]:
        assert row["identities"] == row["contacts"]
        assert 0.0 < row["found_us_p50"] < row["full_us_p50"]
    for row in figures["centre_of_pressure"]:
        if row["load_n"] == "above 5":
            assert row["rms_mm"] < 0.2
    text = contact.table(figures)
    assert "above 5" in text
    assert ("nb-touch is not installed" in text) == ("nb_touch" not in rows["1"])


@pytest.mark.long
def test_each_side_does_the_work_that_it_is_named_after(monkeypatch):
    """The very calls that are timed: their options, contacts, and how often they decode."""
    monkeypatch.setattr(contact, "CYCLES", 8)
    decoded, run = [], Pipeline.step

    def counted(self, cycle):
        decoded.append(self)
        return run(self, cycle)

    monkeypatch.setattr(Pipeline, "step", counted)
    skin = contact.plate(64)
    sides = contact.sides_of(skin, 3)
    lean = {"estimator": "sine", "sweeps": 0, "ambient": False}
    options = {"live": Options(), "contacts": Options(want={"contacts"}, **lean),
               "full": Options(want={"wrench", "centroid", "slip"}, **lean)}  # fmt: skip
    ours = {}
    for name, wanted in options.items():
        assert sides[name].pipeline.options == wanted
        side, reference = sides[name], contact.Pass(skin, wanted)
        decoded.clear()
        expected = reference.contacts(side.counts)
        often = len(decoded)
        decoded.clear()
        ours[name] = [side.call(side.prepare(cycle)).contacts for cycle in side.counts]
        assert len(decoded) == often >= len(side.counts) == 8, name
        for found, others in zip(ours[name], expected, strict=True):
            assert [c.load for c in found] == [c.load for c in others]
    assert all(c.slip is not None for found in ours["live"] for c in found)
    for name, theirs in (("live", "numpy_live"), ("contacts", "numpy")):
        side = sides[theirs]
        assert np.array_equal(side.counts, sides[name].counts)
        for found, cycle in zip(ours[name], side.counts, strict=True):
            others = side.call(side.prepare(cycle))
            assert [c.id for c in found] == [c.id for c in others] == [1, 2, 3]
            for one, other in zip(found, others, strict=True):
                assert one.load == pytest.approx(other.load, rel=0.02)
                np.testing.assert_allclose(one.centroid, other.centroid, atol=1e-4)
    assert not np.array_equal(sides["live"].counts, sides["contacts"].counts)


def test_laps_of_both_sides_take_turns(monkeypatch):
    """As many of one as of the other, one after the other; the ratio is of neighbours."""
    monkeypatch.setattr(contact, "LAPS", (7, 7))
    monkeypatch.setattr(contact, "assert_same", lambda *args: None)
    monkeypatch.setattr(contact, "assert_live_same", lambda *args: None)
    order, spell = [], {}

    def side(name, ns):
        def lap(self):
            order.append(name)
            spell[name] = spell.get(name, 0) + 1
            return [ns * spell[name]] * 3

        return type("Side", (), {"lap": lap, "counts": []})()

    times = {"live": 2, "numpy_live": 60, "decode": 1, "contacts": 2, "full": 3, "numpy": 20}
    monkeypatch.setattr(
        contact, "sides_of", lambda *args: {name: side(name, ns) for name, ns in times.items()}
    )
    found = contact._size(None, 3, True)
    assert order == list(times) * 7
    assert (found["live_numpy_ratio"], found["live_numpy_ratio_95"]) == (30.0, [30.0, 30.0])
    assert (found["numpy_ratio"], found["numpy_ratio_95"]) == (10.0, [10.0, 10.0])


@pytest.mark.parametrize(
    ("n", "kind", "touches"),
    [(64, "grid", 3), pytest.param(363, "cylinder", 1, marks=pytest.mark.long)],
)
def test_numpy_does_what_the_live_pass_does(n, kind, touches):
    """The same forces, displacements and contacts, of films that feel each other, as units are
    dragged, on flat and curved skins; after seconds, in which the ambient field is found."""
    skin = contact.plate(n, kind)
    contact.assert_live_same(skin, contact.counts_of(skin, touches, live=True) * 3, touches)


def test_a_live_pass_of_others_values_is_no_comparison(monkeypatch):
    skin = contact.plate(64)
    counts = contact.counts_of(skin, 1, live=True)[:4]
    monkeypatch.setattr(peers_live, "WALK_UT2", 4000.0)
    with pytest.raises(AssertionError):
        contact.assert_live_same(skin, counts, 1)


def test_plain_arrays_have_the_contacts_of_the_whole_pass():
    skin = contact.plate(64)
    one, stream = contact.Pass(skin, contact.lean(contact.FULL)), contact.plain(skin)
    for counts in contact.counts_of(skin, 3)[:20]:
        state = one.pipeline.state(one.load(counts))
        found = stream(*(array.copy() for array in contact._shown(state.units)))
        assert [c.id for c in found] == [c.id for c in state.contacts] == [1, 2, 3]
        for a, b in zip(found, state.contacts, strict=True):
            assert a.load == b.load
            assert a.slip == b.slip
            np.testing.assert_array_equal(a.motion, b.motion)


@pytest.mark.parametrize(("n", "kind"), [(64, "grid"), (363, "cylinder")])
def test_plates_have_the_units_and_the_contacts_that_are_asked_for(n, kind):
    skin = contact.plate(n, kind)
    assert skin.n == n
    assert (np.ptp(skin.rotation[2, 2]) > 0.01) == (kind == "cylinder")
    for touches in (0, 1, 3):
        truth = contact.pressed_by(skin, touches)
        share = truth.contact.mean() / contact.SHARE
        assert share == pytest.approx(touches, rel=0.25)


@pytest.mark.long
def test_numpy_would_be_told_apart(monkeypatch):
    palm = topology.load("palm").exact()
    counts = contact.counts_of(palm, 1)[:2]
    contact.assert_same(palm, counts, 1)
    wrong = NumpyContacts._describe

    def describe(self, *args):
        found = wrong(self, *args)
        return found._replace(torsion=found.torsion + 1e-4)

    monkeypatch.setattr(NumpyContacts, "_describe", describe)
    with pytest.raises(AssertionError, match="torsion"):
        contact.assert_same(palm, counts, 1)


def test_without_nb_touch_there_is_no_row(monkeypatch):
    monkeypatch.setitem(sys.modules, "nb_touch.contact.detector", None)
    assert peers_contact.nb_touch(topology.load("palm").exact()) is None


def test_numpy_sigma_is_that_of_the_noise():
    palm = topology.load("palm").exact()
    truth = contact.pressed(palm, palm.position[:, [27]], 0.2, 1.9)
    truth.displacement_mm[0] = 0.3
    counts = np.stack([UnitSimulator(palm, seed=s).counts(truth) for s in range(200)])
    rows = np.stack([peers_contact.numpy_decode(palm, c) for c in counts])
    mean = rows.mean(axis=0)
    sigma = force_sigma(palm, mean[3], mean[6], mean[7], mean[8])
    loaded = truth.force[2] > 1.2
    assert loaded.sum() > 8
    ratio = sigma[:, loaded] / rows[:, 1:4, loaded].std(axis=0)
    assert np.median(ratio, axis=1) == pytest.approx(1.0, abs=0.06)


def test_numpy_has_one_thread_as_the_live_skin_has():
    """Of the libraries below it, from the first import on: in a process of its own."""
    code = (
        "import os, sys; from benchmarks import __main__ as main\n"
        "assert 'numpy' not in sys.modules\n"
        "main.import_module = lambda name: sys.exit(os.environ['OPENBLAS_NUM_THREADS'] != '1')\n"
        "sys.argv = ['benchmarks', 'contact']; main.main()"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
