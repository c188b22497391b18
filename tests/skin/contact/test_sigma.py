"""Sigmas of wrenches and centres against truths of their own: films, faces and silent units made
here, by formulas that share nothing with the decoder or the simulator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.record import Flag
from skin.contact.stream import ContactStream
from tests.fixtures.contact_stream import with_gate

PITCH, FACE = 0.012, 0.0105


def stream_of(position, rotation, **options):
    graph = neighbour_graph(position, 1.5 * PITCH)
    given = {"want": {"contacts"}} | options
    stream = ContactStream(position, rotation, FACE**2, *graph, **given)
    return with_gate(stream, start_sigma=5.5)


# -- what is not seen ------------------------------------------------------------------------------


def test_a_contact_without_its_strongest_unit_says_so_and_covers_the_truth():
    """Balls on a palm; the strongest unit falls silent: two in three errors within sigma, or more,
    for the bound is not below what it bore."""
    rng = np.random.default_rng(3)
    position = naive.grid(8, 8, PITCH)
    stream = stream_of(position, naive.facing_down(64))
    covered = []
    for trial in range(60):
        x, y = rng.uniform(0.01, 0.07, 2)
        square = (position[0] - x) ** 2 + (position[1] - y) ** 2
        load = np.maximum(1.2 - 1e3 * square / (2.0 * rng.uniform(0.05, 0.2)), 0.0) * 1.5
        force = np.stack([0.3 * load, 0.1 * load, load])
        valid = np.ones(64, bool)
        for k in range(3):
            (contact,) = stream.update(force, 0.01, valid=valid, stamp_ns=10 * trial + k + 1)
            assert contact.whole
        valid[np.argmax(load)] = False
        growing = force * rng.uniform(0.9, 1.1)
        stream.update(growing, 0.01, valid=valid, stamp_ns=10 * trial + 5)
        truth = naive.wrench(range(64), growing, growing, position, naive.facing_down(64),
                             np.zeros(3))[0]  # fmt: skip
        for one in (stream.contacts[0] if stream.contacts else stream.total, stream.total):
            assert not one.whole
            assert one.flags & Flag.UNSEEN
        error = np.abs(stream.total.wrench - truth)[:3]
        covered.append(error <= 1.15 * stream.total.wrench_sigma[:3])
        stream.update(0.0 * force, 0.01, stamp_ns=10 * trial + 8)
        assert stream.total.whole
    assert np.mean(covered) > 0.66


def test_a_wrench_of_which_nothing_is_known_is_not_zero():
    stream = stream_of(naive.grid(2, 2, PITCH), naive.facing_down(4), want={"wrench"})
    for stamp, sigma in enumerate((np.nan, np.inf)):  # no unit is heard, and no load has a bound
        stream.update(np.zeros((3, 4)), sigma, stamp_ns=stamp)
        total = stream.total
        assert np.isnan([total.load, total.load_sigma, *total.wrench, *total.wrench_sigma]).all()
        assert (stream.coverage, total.whole) == (0.0, False)
    stream.update(np.zeros((3, 4)), 0.01, stamp_ns=2)
    assert stream.total.wrench.tolist() == [0.0] * 6
    assert stream.total.whole


def test_no_wrench_is_zero_within_zero_while_units_are_silent():
    position = naive.grid(4, 4, PITCH)
    stream = stream_of(position, naive.facing_down(16), want={"wrench"}, most_n=7.0,
                       feels=np.arange(16) != 15)  # fmt: skip
    valid, force = np.ones(16, bool), np.zeros((3, 16))
    stream.update(force, 0.01, valid=valid & False, stamp_ns=1)
    assert stream.total.wrench_sigma[:3] == pytest.approx(7.0 * np.sqrt(15.0)), "never heard of any"
    assert not stream.total.whole
    stream.update(force, 0.01, valid=np.arange(16) != 15, stamp_ns=2)
    assert stream.total.whole, "one that is never to be heard is not missed"
    assert stream.total.wrench_sigma[:3] == pytest.approx(0.01 * np.sqrt(15.0)), "of their sum"
    stream.update(force, 0.01, valid=np.arange(16) != 5, stamp_ns=3)
    assert stream.total.whole, "its neighbours would show a touch"
    assert stream.total.wrench_sigma[:3] == pytest.approx(np.hypot(0.03, 0.01 * np.sqrt(15.0)))
    force[2, 5] = 6.0
    stream.update(force, 0.01, valid=valid, stamp_ns=4)
    assert stream.total.load == 6.0
    for stamp in (5, 6, 500_000_000):
        stream.update(force, 0.01, valid=np.arange(16) != 5, stamp_ns=stamp)
        assert stream.total.wrench.tolist() == [0.0] * 6
        assert stream.total.wrench_sigma[:3] == pytest.approx(6.0, abs=1e-3)
        assert not stream.total.whole
    force[2, 5] = 0.0
    stream.update(force, 0.01, valid=valid, stamp_ns=600_000_000)
    assert stream.total.whole
    assert stream.total.wrench_sigma[:3] == pytest.approx(0.04)


def test_the_centre_may_lie_where_silent_units_would_draw_it():
    """As the first order of load-weighted means says: load² of each times its arm squared."""
    rng = np.random.default_rng(11)
    turn = Rotation.random(rng=rng).as_matrix()
    position = turn @ (naive.grid(4, 4, PITCH) + rng.normal(0.0, 1e-3, (3, 16))) + 0.1
    rotation = np.einsum("ij,jkn->ikn", turn, naive.facing_down(16))
    load, silent = rng.uniform(0.5, 2.0, 16), np.isin(np.arange(16), (5, 6, 11))
    load[silent] = 0.0
    force = np.stack([0.0 * load, 0.0 * load, load])
    found = []
    for valid in (np.ones(16, bool), ~silent):
        stream = stream_of(position, rotation)
        stream.update(0.0 * force, 1e-6, stamp_ns=1)
        found.append(stream.update(force, 1e-6, valid=valid, stamp_ns=2)[0].centroid_covariance)
    before, after = found
    graph = naive.rows_of(*neighbour_graph(position, 1.5 * PITCH)).toarray() > 0
    most = np.array([load[graph[i] & ~silent].max() for i in np.flatnonzero(silent)])
    arms = position[:, silent] - position @ load[:, np.newaxis] / load.sum()
    added = (most**2 * arms) @ arms.T / load.sum() ** 2
    assert after - before == pytest.approx(added, rel=1e-6, abs=1e-12)


# -- what is below the gate ------------------------------------------------------------------------


def test_what_is_below_the_gate_beside_a_contact_is_in_the_sigma_of_its_wrench():
    """Round bodies that bear on many units lightly: all six rows of the wrench against that of all
    units, whether they are in the contact or not."""
    rng = np.random.default_rng(5)
    position, rotation = naive.grid(8, 8, PITCH), naive.facing_down(64)
    stream = stream_of(position, rotation)
    ratios, stamp = [], 0
    for _ in range(300):
        x, y = rng.uniform(0.02, 0.06, 2)
        away = (position[0] - x) ** 2 + (position[1] - y) ** 2
        peak = 0.05 * 10.0 ** rng.uniform(0.0, 1.0)
        load = peak * np.maximum(1.0 - away / rng.uniform(0.012, 0.035) ** 2, 0.0)
        force = np.stack([0.2 * load, 0.1 * load, load])
        for _ in range(2):
            stamp += 1
            stream.update(force + 0.01 * rng.standard_normal((3, 64)), 0.01, stamp_ns=stamp)
        truth = naive.wrench(range(64), force, force, position, rotation, np.zeros(3))[0]
        if stream.contacts:
            ratios.append((stream.total.wrench - truth) / stream.total.wrench_sigma)
        stamp += 1_000_000_000
        stream.update(0.0 * force, 0.01, stamp_ns=stamp)
    assert len(ratios) > 200
    assert 0.64 < np.mean(np.abs(ratios) <= 1.0) < 0.78
    assert np.mean(np.square(ratios)) < 1.5


@pytest.mark.parametrize(
    ("before", "now", "most"),
    [
        ({}, {"near": 0.08}, 7.0),  # it may bear all of it
        ({}, {"near": 1.0, "far": 1.2}, 1.0),  # the body is not centred upon it
        ({"near": 1.0}, {"near": 1.0}, 0.03),  # as it was when it was last heard
        ({"near": 1.0}, {"near": 3.0}, 2.09),  # that, as often, and what the neighbour has gained
        ({"near": 0.5, "own": 2.0}, {"near": 1.0}, 4.5),
        ({}, {}, 0.03),  # neighbours would show a touch
    ],
)
def test_neighbours_bound_a_silent_unit_only_as_far_as_they_show(before, now, most):
    place = {"own": [0], "near": [1], "far": [2]}
    stream = stream_of(naive.grid(1, 6, PITCH), naive.facing_down(6), most_n=7.0)

    def loaded(loads):
        force = np.zeros((3, 6))
        for name, load in loads.items():
            force[2, place[name]] = load
        return force

    for stamp in (1, 2):
        stream.update(loaded(before), 0.01, stamp_ns=stamp)
    stream.update(loaded(now), 0.01, valid=np.arange(6) != 0, stamp_ns=3)
    record = stream.contacts[0] if stream.contacts else stream.total
    unseen = record.load_sigma**2 - 0.01**2 * len(now) - 0.03**2
    assert np.sqrt(unseen) == pytest.approx(most, rel=0.02, abs=0.01)
    assert record.whole == (most == 0.03)
