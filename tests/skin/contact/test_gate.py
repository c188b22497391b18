"""The gate: as few false contacts as were asked for, and real ones seen in time."""

import numpy as np
import pytest

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.stream import ContactStream
from skin.errors import SkinError
from tests.fixtures.contact_stream import gate_of, with_gate

ROWS, PITCH, RATE_HZ = 8, 0.012, 250.0
N, DAY_S = ROWS * ROWS, 86_400.0
SIGMA = 0.02
MIDDLE, NEXT, FAR = 3 * ROWS + 3, 3 * ROWS + 4, 6 * ROWS + 6


class Skin:
    """64 units side by side that are shown their loads in sigmas."""

    def __init__(self, false_contacts_per_day=1.0, **gate):
        position = naive.grid(ROWS, ROWS)
        self.stream = ContactStream(
            position, naive.facing_down(N), 1e-4, *neighbour_graph(position, 1.5 * PITCH), want=(),
            rate_hz=RATE_HZ,
            false_contacts_per_day=false_contacts_per_day,
        )  # fmt: skip
        with_gate(self.stream, **gate)
        self.now = 0

    def see(self, level):
        """Number of contacts; a dict of units or all 64."""
        force = np.zeros((3, N))
        if isinstance(level, dict):
            force[2, list(level)] = list(level.values())
        else:
            force[2] = level
        self.now += 4_000_000
        return len(self.stream.update(SIGMA * force, SIGMA, stamp_ns=self.now))

    def begun(self):
        """Contacts so far."""
        return int(self.stream.records["id"].max())


def test_noise_starts_no_more_contacts_than_were_asked_for():
    cycles, wanted = 20_000, 200
    per_day = wanted / cycles * RATE_HZ * DAY_S
    skin = Skin(false_contacts_per_day=per_day, keep_sigma=1.5, memory_ns=0.0)
    rng = np.random.default_rng(2)
    for _ in range(cycles):
        skin.see(rng.standard_normal(N))
    assert wanted / 3 < skin.begun() < wanted + 4.0 * np.sqrt(wanted)


def test_a_lone_unit_needs_more_than_one_that_lasts_or_has_a_neighbour():
    gate = gate_of(Skin().stream)
    alone = gate.start_sigma
    twice, both = np.sqrt(2.0) * gate.repeat_sigma, np.sqrt(2.0) * gate.pair_sigma
    assert alone > 6.0
    less, more = -0.01, 0.01
    for off, found in ((less, 0), (more, 1)):
        assert Skin().see({MIDDLE: alone + off}) == found
        assert Skin().see({MIDDLE: 0.5 * both + off, NEXT: 0.5 * both + off}) == found
        assert Skin().see({MIDDLE: 0.5 * both + off, FAR: 0.5 * both + off}) == 0
        lasting = Skin()
        assert lasting.see({MIDDLE: 0.5 * twice + off}) == 0
        assert lasting.see({MIDDLE: 0.5 * twice + off}) == found
        interrupted = Skin()
        assert [interrupted.see({MIDDLE: level * (0.5 * twice + off)}) for level in (1, 0, 1)] == [
            0, 0, 0,
        ]  # fmt: skip
        elsewhere = Skin()
        assert elsewhere.see({MIDDLE: 0.5 * twice + off}) == 0
        assert elsewhere.see({FAR: 0.5 * twice + off}) == 0


def test_a_unit_without_neighbours_has_no_pairs_and_a_rate_of_none_is_refused():
    one = ContactStream(
        np.zeros((3, 1)), naive.facing_down(1), 1e-4, [0, 0], [], want=(), rate_hz=RATE_HZ
    )
    assert gate_of(one).pair_sigma == np.inf
    with pytest.raises(SkinError, match="false_contacts_per_day: must be a number from 1e-09 to"):
        Skin(false_contacts_per_day=0.0)
