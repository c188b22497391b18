"""The benchmark of contacts runs, and numpy finds the same contacts."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

import topology
from benchmarks import contact, peers_contact, peers_live
from benchmarks.peers_contact import NumpyContacts, force_sigma
from skin.sim.unit import UnitSimulator


def test_benchmark_gives_errors_beside_times(monkeypatch):
    monkeypatch.setattr(contact, "SHAPES", {64: "grid"})
    monkeypatch.setattr(contact, "CYCLES", 12)
    monkeypatch.setattr(contact, "LAPS", (1, 1))
    monkeypatch.setattr(contact, "TRIALS", (12, 4))
    figures = json.loads(json.dumps(contact.run(quick=True)))
    rows = figures["sizes"]["64"]
    assert set(rows) == {"0", "1", "3"}
    assert figures["cycle_us_p50_64"] == rows["3"]["full"]["us_p50"]
    for row in rows.values():
        assert 0.0 < row["full"]["us_p50"] <= row["full"]["us_p99"]
        assert 0.0 < row["plain"]["us_p50"] <= row["plain"]["us_p99"]
        assert row["numpy_ratio"] > 1.0
        assert row["live_numpy_ratio"] > 1.0
    for row in figures["centre_of_pressure"]:
        if row["load_n"] == "above 5":
            assert row["rms_mm"] < 0.2
    text = contact.table(figures)
    assert "above 5" in text
    assert ("nb-touch is not installed" in text) == ("nb_touch" not in rows["1"])


@pytest.mark.parametrize(("n", "kind", "touches"), [(64, "grid", 3), (363, "cylinder", 1)])
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
