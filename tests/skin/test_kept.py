"""What somebody keeps of a cycle stays as it was: states, readings, arrays, contacts."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import topology
from skin.contact.model import neighbour_graph
from skin.contact.record import CONTACT
from skin.contact.stream import ContactStream
from skin.decode.decoder import Decoder
from skin.errors import NotWantedError
from skin.options import Options
from skin.pipeline import Pipeline
from skin.sim.node import SimulatedUnits
from skin.sim.truth import Truth
from skin.state import Reading, if_wanted
from tests.fixtures.decode import any_counts
from tests.fixtures.live import cycles_of

STRIP = topology.load("strip").exact()
CYCLES = 40
OF_STATE = ("wrench", "wrench_sigma", "centroid", "centroid_covariance", "label", "slip",
            "sampled_ns")  # fmt: skip
OF_CONTACT = ("units", "path", "noise_ratio", "slip_began")


class Growing:
    """A load that grows from cycle to cycle, over ever more units."""

    def __init__(self) -> None:
        self.truth = Truth.at_rest(STRIP.n, 24.0)

    def at(self, time_s: float) -> Truth:
        touched = np.arange(STRIP.n) < 2 + 20.0 * time_s
        self.truth.time_s = time_s
        self.truth.depth_mm[:] = np.where(touched, 0.2 + 2.0 * time_s, 0.0)
        return self.truth


def told(state) -> dict[str, bytes]:
    """All that a state says, as bytes."""
    said = {name: if_wanted(state.units, name) for name in Reading.__slots__[:-2]}
    said |= {name: getattr(state, name) for name in OF_STATE}
    for k, contact in enumerate(state.contacts):
        said |= {f"{k}.{name}": getattr(contact, name) for name in OF_CONTACT}
        said |= {f"{k}.{name}": contact.record[name] for name in CONTACT.names}
        said[f"{k}.trembles"] = np.array([contact.impact, contact.vibration])
    return {name: np.asarray(array).tobytes() for name, array in said.items() if array is not None}


@pytest.fixture(scope="module")
def cycles():
    """What each of some cycles said when it came, and the states that were kept."""
    nodes, pipeline = SimulatedUnits(STRIP, Growing(), seed=3), Pipeline(STRIP, Options())
    said, kept, now = [], [], []
    for cycle, frames in enumerate(cycles_of(nodes, CYCLES)):
        for state in pipeline.feed(frames):
            now.append(told(pipeline.now))
            kept.append(state)
            if cycle % 2:  # some are read when they come, and some are not
                said.append(told(state))
            else:
                said.append(now[-1])
    assert len(kept) == CYCLES
    assert kept[-1].contacts
    return said, kept, now


def test_kept_states_say_what_they_said(cycles):
    said, kept, now = cycles
    for before, state, shown in zip(said, kept, now, strict=True):
        assert told(state) == before == shown
    assert len({each["force"] for each in said}) == CYCLES


def test_kept_contacts_are_as_many_as_there_were(cycles):
    _, kept, _ = cycles
    contacts = []
    for state in kept:
        contacts += state.contacts
    loads = [contact.load for contact in contacts]
    assert len({*map(id, contacts)}) == len(contacts) > CYCLES // 2
    assert loads[-1] > 3.0 * loads[0]
    assert len({*loads}) == len(loads)
    assert contacts[-1].units.size > contacts[0].units.size


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda s: s.copy(),
                                 lambda s: pickle.loads(pickle.dumps(s))])  # fmt: skip
def test_states_are_copied_and_packed_as_before(way, cycles):
    said, kept, _ = cycles
    other = way(kept[-1])
    assert told(other) == said[-1]
    assert repr(other) == repr(kept[-1])


def test_a_copy_has_arrays_of_its_own(cycles):
    _, kept, _ = cycles
    state = kept[-1]
    other = state.copy()
    other.units.force[:] = 7.0
    other.contacts[0].wrench[:] = 7.0
    assert not (state.units.force == 7.0).any()
    assert not (state.contacts[0].wrench == 7.0).any()
    assert other.time_s == state.time_s == pytest.approx(0.004 * state.cycle, abs=1e-3)


def test_what_is_not_wanted_says_which_want_gives_it():
    pipeline = Pipeline(STRIP, Options(want={"temperature"}, auto_tare=False))
    (state,) = pipeline.feed(*cycles_of(SimulatedUnits(STRIP), 1))
    for kept in (state, state.copy(), pickle.loads(pickle.dumps(state))):
        for record, name in ((kept.units, "force"), (kept, "wrench"), (kept, "label"),
                             (kept, "contacts"), (kept, "whole"), (kept, "slips")):  # fmt: skip
            assert if_wanted(record, name) is None
            assert not hasattr(record, name)
        assert "0 touched" not in repr(kept)
    for record, name, wants in (
        (state, "contacts", "'contacts'"), (state, "label", "'contacts'"),
        (state, "wrench_sigma", "'wrench'"), (state, "slips", "'slip'"),
        (state.units, "displacement_mm", "'displacement'"),
        (state.units, "force_sigma", "{'force', 'sigma'}"),
    ):  # fmt: skip
        with pytest.raises(NotWantedError) as raised:
            getattr(record, name)
        assert str(raised.value) == (
            f"{name}: must be wanted to be read (want={wants}); got states without"
        )
    assert state.units.temperature.shape == (STRIP.n,)
    with pytest.raises(AttributeError, match="'Reading' object has no attribute 'forces'"):
        _ = state.units.forces


def test_readings_of_a_decoder_are_kept():
    counts = any_counts(STRIP, 8)
    decoder, other = Decoder(STRIP), Decoder(STRIP)
    kept = [decoder(counts[t]) for t in range(8)]
    for t in range(8):
        now = other(counts[t])
        for name in Reading.__slots__[:-2]:
            mine, theirs = if_wanted(kept[t], name), if_wanted(now, name)
            if theirs is not None:
                np.testing.assert_array_equal(mine, theirs)
    assert len({reading.temperature.tobytes() for reading in kept}) == 8


def test_contacts_of_a_stream_are_kept():
    position = np.array([[0.0, 0.01, 0.02], [0, 0, 0], [0, 0, 0]])
    upright = np.repeat(np.diag([1.0, -1.0, -1.0])[:, :, None], 3, axis=2)
    stream = ContactStream(position, upright, 1e-4, *neighbour_graph(position, 0.012))
    kept = []
    for cycle in range(6):
        load = np.array([1.0 + cycle, 2.0, 2.0 * (cycle > 2)])
        force = np.stack([0.0 * load, 0.0 * load, load])
        kept += stream.update(force, 0.01, stamp_ns=cycle * 4_000_000)
    assert [contact.load for contact in kept] == [3.0, 4.0, 5.0, 8.0, 9.0, 10.0]
    assert [contact.units.size for contact in kept] == [2, 2, 2, 3, 3, 3]
