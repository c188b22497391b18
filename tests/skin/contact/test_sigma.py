"""Sigmas of wrenches and centres against truths of their own: films, faces and silent units made
here, by formulas that share nothing with the decoder or the simulator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom

import tests.naive.contact as naive
from skin.contact.model import Common, neighbour_graph
from skin.contact.record import Flag
from skin.contact.stream import ContactStream
from tests.fixtures.cases import long_after_first
from tests.fixtures.contact_stream import with_gate

PITCH, FACE = 0.012, 0.0105
K_RAD_PER_MM, M0_UT = 0.55, 2500.0


def stream_of(position, rotation, **options):
    graph = neighbour_graph(position, 1.5 * PITCH)
    given = {"want": {"contacts"}} | options
    stream = ContactStream(position, rotation, FACE**2, *graph, **given)
    return with_gate(stream, start_sigma=5.5)


def share_within(hits, low=0.66, high=0.72):
    """A rate that may be between two: not outside of both by more than chance, 1 in 1000."""
    n, count = len(hits), int(np.sum(hits))
    return binom.ppf(5e-4, n, low) <= count <= binom.ppf(1 - 5e-4, n, high)


# -- errors that units share -----------------------------------------------------------------------


def field_of(displacement):
    """Of a film that turns its field as it is displaced, µT, in the unit's axes: (3, n)."""
    radius = np.maximum(np.linalg.norm(displacement, axis=0), 1e-12)
    lateral = M0_UT * np.sin(K_RAD_PER_MM * radius) * displacement / radius
    return np.vstack([lateral, M0_UT * np.cos(K_RAD_PER_MM * radius)[np.newaxis]])


def shear_of(field):
    """Displacement and tangential force by such a field: 0.5 N/mm, 2 N/mm more beyond 0.8 mm."""
    strength = np.maximum(np.linalg.norm(field[:2], axis=0), 1e-12)
    radius = np.arctan2(strength, field[2]) / K_RAD_PER_MM
    force = 0.5 * radius + 2.0 * np.maximum(radius - 0.8, 0.0)
    return radius * field[:2] / strength, force * field[:2] / strength


@long_after_first("curved", [False, True])
@long_after_first("bodies", [1, 2])
@long_after_first(("drag", "rest_ut"), [(0.02, 0.0), (1.4, 0.0), (1.4, 40.0)])
def test_the_ambient_field_counts_once_for_all_units_of_a_body(curved, bodies, drag, rest_ut):
    """Chi-square of wrenches whose units share an unknown field of each body, and, along their own
    axes, the one in which Bz at rest was learnt; in all six rows and in each: mean 6 of 6, within
    4 sigma of the mean of so many."""
    rng = np.random.default_rng(7)
    position, rotation = naive.cylinder(5, 6) if curved else (
        naive.grid(5, 6), naive.facing_down(30)
    )  # fmt: skip
    n, trials, noise = position.shape[1], 300, 0.004
    half = rng.normal(0.0, 12.0, (bodies, 3, 3))
    covariance = half @ half.transpose(0, 2, 1)
    body = np.arange(n) * bodies // n
    true = drag * np.array([[np.cos(0.7)], [np.sin(0.7)]]) * rng.uniform(0.7, 1.0, n)
    true_force = np.vstack([shear_of(field_of(true))[1], np.full((1, n), 2.0)])
    moved, force, sigma = (np.zeros((3, n)) for _ in range(3))
    residue, per_ut = np.zeros(n), np.zeros((6, n))
    common = Common(body, np.moveaxis(rotation, 2, 0), rest_ut**2, covariance, per_ut, residue)
    stream = stream_of(position, rotation)
    stream.bind(force, sigma, moved, np.full((3, n), 0.01), common=common)
    told, _ = naive.wrench(range(n), true_force, sigma, position, rotation, np.zeros(3))
    squares, each = [], []
    step = 1e-3
    for trial in range(trials):
        unknown = np.stack([rng.multivariate_normal(np.zeros(3), one) for one in covariance])
        at_units = np.einsum("abn,na->bn", rotation, unknown[body])
        at_units[2] += np.einsum(
            "an,na->n", rotation[:, 2], rng.normal(0, rest_ut, (bodies, 3))[body]
        )
        field = field_of(true) + at_units
        moved[:2], force[:2] = shear_of(field)
        force[2] = 2.0
        # what the decoder has in sigma, by differences: the mean variance of both lateral axes,
        # and what turns the field as much as the unknown field along the unit does
        of_axes = np.einsum("abn,nac,cbn->bn", rotation, covariance[body], rotation)
        square = field**2
        residue[:] = of_axes[:2].mean(axis=0)
        residue += rest_ut**2 * (square[0] + square[1]) / square.sum(axis=0)
        slopes = [(shear_of(field + step * np.eye(3)[:, [a]])[1] - force[:2]) / step
                  for a in range(3)]  # fmt: skip
        per_ut[:] = np.swapaxes(slopes, 0, 1).reshape(6, n)
        own = noise**2 + residue * np.square(slopes[:2]).sum(axis=0)
        force += noise * rng.standard_normal((3, n))
        sigma[:2], sigma[2] = np.sqrt(own), noise
        stream.step(trial + 1)
        error = stream.total.wrench - told
        rest, axes = stream.total.wrench_covariance.copy(), stream.contacts[0].axes
        face = naive.face_variance(range(n), force[2], FACE**2, position, rotation, axes)
        rest[3:, 3:] -= naive.face_torque(stream.total.wrench[:3], face)
        squares.append(error @ np.linalg.solve(rest, error))
        each.append(np.abs(error) <= np.sqrt(np.diag(rest)))
        assert stream.contacts[0].wrench_sigma == pytest.approx(stream.total.wrench_sigma)
    assert np.mean(squares) == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / trials) + 0.6)
    for row in np.transpose(each)[[0, 1, 5]]:
        assert share_within(row), np.mean(row)


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


# -- the centre ------------------------------------------------------------------------------------


# -- what the gate leaves out, and what is silent --------------------------------------------------


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
