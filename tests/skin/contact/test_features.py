"""What a contact is: against slow sums, and the laws of wrenches and centres."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import tests.naive.contact as naive
from skin.contact.contact import Contact, Kept
from skin.contact.record import NEW, Flag
from skin.errors import SkinError
from skin.patch import wrench_adjoint
from tests.fixtures.contact_features import contact_features

AREA = 1.1e-4
TOUCHED = Contact(Kept(NEW, np.zeros(1), np.zeros(0, np.int32), None), 0, None, None)
seeds = st.integers(0, 2**32)


def scene(seed, n=30, clusters=3):
    """Units anywhere, turned anyhow, each in one of the clusters or in none."""
    rng = np.random.default_rng(seed)
    force = rng.normal(0.0, 1.0, (3, n))
    force[2] = rng.uniform(0.1, 5.0, n)
    sigma = rng.uniform(0.005, 0.03, (3, n))
    position = 0.1 * rng.random((3, n)) + 3.0
    rotation = np.moveaxis(Rotation.random(n, rng=rng).as_matrix(), 0, 2)
    label = rng.integers(-1, clusters, n)
    label[:clusters] = np.arange(clusters)
    return label, force, sigma, position, rotation


@given(seeds)
def test_wrench_centre_and_covariances_are_the_slow_sums(seed):
    label, force, sigma, position, rotation = scene(seed)
    contacts, _ = contact_features(label, force, sigma, position, rotation, AREA)
    for k, contact in enumerate(contacts):
        units = np.flatnonzero(label == k)
        wrench, covariance = naive.wrench(units, force, sigma, position, rotation, np.zeros(3))
        face = naive.face_variance(units, force[2], AREA, position, rotation, contact["axes"])
        covariance[3:, 3:] += naive.face_torque(wrench[:3], face)
        np.testing.assert_allclose(contact["wrench"], wrench, atol=1e-10)
        np.testing.assert_allclose(contact["wrench_covariance"], covariance, atol=1e-12)
        centre, spread = naive.centre(units, force[2], sigma[2], position)
        np.testing.assert_allclose(contact["centroid"], centre, atol=1e-12)
        np.testing.assert_allclose(contact["centroid_covariance"], spread + face, atol=1e-15)
        wrench, covariance = naive.wrench(units, force, sigma, position, rotation, centre)
        covariance[3:, 3:] += naive.face_torque(wrench[:3], face)
        np.testing.assert_allclose(contact["moment"], wrench[3:], atol=1e-12)
        np.testing.assert_allclose(contact["moment_covariance"], covariance[3:, 3:], atol=1e-15)
        assert contact["area"] == pytest.approx(AREA * units.size)
        assert contact["peak_unit"] == units[np.argmax(force[2, units])]
        assert contact["mean_pressure"] == pytest.approx(force[2, units].mean() / AREA)


@pytest.mark.parametrize("loose", [False, True])
@given(seed=seeds)
def test_wrenches_of_clusters_add_up_to_the_total(loose, seed):
    """Its covariance has the loads of units in no cluster besides."""
    label, force, sigma, position, rotation = scene(seed)
    label = label if loose else np.maximum(label, 0)
    contacts, total = contact_features(label, force, sigma, position, rotation, AREA)
    names = ("wrench", "load", "area") + ("wrench_covariance",) * bool((label >= 0).all())
    for name in names:
        np.testing.assert_allclose(contacts[name].sum(0), total[name], rtol=1e-9, atol=1e-12)
    centre = contacts["load"] @ contacts["centroid"] / total["load"]
    np.testing.assert_allclose(total["centroid"], centre, atol=1e-12)


@given(seeds)
def test_wrench_is_covariant_under_rigid_motion(seed):
    label, force, sigma, position, rotation = scene(seed)
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(0.0, 0.5, 3)
    here, _ = contact_features(label, force, sigma, position, rotation, AREA)
    there, _ = contact_features(
        label,
        force,
        sigma,
        turn @ position + shift[:, np.newaxis],
        np.einsum("ij,jkn->ikn", turn, rotation),
        AREA,
    )
    back, origin = turn.T, -turn.T @ shift
    for a, b in zip(here, there, strict=True):
        adjoint = wrench_adjoint(back, origin)
        moved, covariance = adjoint @ a["wrench"], adjoint @ a["wrench_covariance"] @ adjoint.T
        np.testing.assert_allclose(b["wrench"], moved, atol=1e-9)
        np.testing.assert_allclose(b["wrench_covariance"], covariance, atol=1e-9)
        np.testing.assert_allclose(b["centroid"], turn @ a["centroid"] + shift, atol=1e-11)
        # along a normal that is fitted, and turns by rounding where the units hardly tell it
        assert b["torsion"] == pytest.approx(a["torsion"], rel=1e-7, abs=1e-8)
        assert b["shear"] == pytest.approx(a["shear"], rel=1e-7, abs=1e-8)


@pytest.mark.parametrize(
    ("rotation", "origin", "words"),
    [
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3), "rotation: must be right-handed; got a mirror"),
        (2.0 * np.eye(3), np.zeros(3), "rotation: must be orthonormal within 1e-06; got"),
        (np.eye(3), np.zeros(2), r"rotation, origin: must have shapes \(3, 3\) and \(3,\); got"),
        (np.eye(3), [0.0, np.nan, 0.0], "origin: must be within 1000 m; got nan"),
    ],
)
def test_a_frame_that_is_none_is_refused(rotation, origin, words):
    with pytest.raises(SkinError, match=words):
        TOUCHED.wrench_in(rotation, origin)


def test_a_load_below_five_sigma_has_no_centre():
    position, n = naive.grid(2, 2), 4
    force = np.zeros((3, n))
    force[2] = 0.04
    for sigma, weak in ((0.0155, False), (0.0165, True)):
        contacts, total = contact_features(
            np.zeros(n, int), force, sigma, position, naive.facing_down(n), AREA
        )
        for record in (contacts[0], total):
            assert bool(record["flags"] & Flag.WEAK) == weak
            assert np.isnan(record["centroid"]).all() == weak
            assert np.isnan(record["torsion"]) == weak
            assert record["load"] == pytest.approx(0.16)


def test_a_skin_far_from_the_origin_loses_no_digits():
    label, force, sigma, position, rotation = scene(7)
    far = np.array([400.0, -800.0, 200.0])
    a, _ = contact_features(label, force, sigma, position, rotation, AREA)
    b, _ = contact_features(label, force, sigma, position + far[:, np.newaxis], rotation, AREA)
    np.testing.assert_allclose(b["moment"], a["moment"], atol=1e-9)
    np.testing.assert_allclose(b["torsion_sigma"], a["torsion_sigma"], rtol=1e-6)
