"""Temperature of a contact against least squares, and what a contact does not know."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.record import Flag
from skin.contact.slip import SlipSettings
from skin.contact.stream import ContactStream
from tests.fixtures.contact_features import contact_features
from tests.fixtures.contact_stream import with_gate

seeds = st.integers(0, 2**32)


def warm(position, temperature, area, load=1.0, rotation=None):
    """The one contact of some units, which know their temperature or NaN."""
    n = position.shape[1]
    force = np.zeros((3, n))
    force[2] = load
    rotation = naive.facing_down(n) if rotation is None else rotation
    (contact,), total = contact_features(
        np.zeros(n, int), force, 1e-3, position, rotation, area, temperature=temperature
    )
    assert total["temperature"] == pytest.approx(contact["temperature"], nan_ok=True)
    assert total["hot_unit"] == contact["hot_unit"]
    assert total["hot_temperature"] == pytest.approx(contact["hot_temperature"], nan_ok=True)
    return contact


@given(seeds, st.integers(4, 9))
def test_temperature_and_gradient_are_the_plane_of_least_squares(seed, n):
    """Weighted by area, over the units that know their temperature, along the contact's axes."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    position = turn @ (rng.normal(size=(3, n)) * [[0.02], [0.012], [0.002]]) + 1.0
    area, temperature = rng.uniform(0.5e-4, 2e-4, n), rng.uniform(20.0, 60.0, n)
    temperature[rng.integers(n)] = rng.choice([np.nan, np.inf])
    contact = warm(position, temperature, area, rng.uniform(0.5, 2.0, n))
    known = np.isfinite(temperature)
    assert contact["temperature"] == pytest.approx(
        np.average(temperature[known], weights=area[known])
    )
    hottest = np.argmax(np.where(known, temperature, -np.inf))
    assert contact["hot_unit"] == hottest
    assert contact["hot_temperature"] == temperature[hottest]
    along = contact["axes"][:, :2]
    weight = np.sqrt(area[known])
    plane = np.column_stack([np.ones(known.sum()), position[:, known].T @ along])
    spread = np.linalg.svd(plane[:, 1:] - plane[:, 1:].mean(axis=0))[1]
    if spread[1] > 0.15 * spread[0]:
        slope = np.linalg.lstsq(plane * weight[:, None], temperature[known] * weight)[0][1:]
        size = np.abs(slope).max()
        assert contact["temperature_gradient"] == pytest.approx(along @ slope, abs=1e-5 * size)


@pytest.mark.parametrize(("share", "spans"), [(0.049, False), (0.051, True)])
def test_a_gradient_needs_units_that_span_a_plane_by_a_twentieth_of_their_length(share, spans):
    corners = 0.01 * np.array([[1, 1, -1, -1], [share, -share, share, -share], [0.0] * 4])
    contact = warm(corners, np.array([100.0, 50.0, 0.0]) @ corners, 1e-4)
    assert bool(contact["flags"] & Flag.NORMAL_ASSUMED) != spans
    assert np.isfinite(contact["temperature_gradient"]).all() == spans


@given(seeds, st.integers(1, 9))
def test_what_follows_from_wrench_and_normal(seed, n):
    """Shear, torsion and its sigma, pressures and flags, of units that are tilted anyhow."""
    rng = np.random.default_rng(seed)
    position = rng.normal(0.0, 0.02, (3, n)) + rng.normal(size=(3, 1))
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.5, (n, 3))).as_matrix()
    rotation = np.einsum("nij,jkn->ikn", turn, naive.facing_down(n))
    force, sigma = rng.normal(size=(3, n)), rng.uniform(1e-3, 0.02, (3, n))
    force[2], area = rng.uniform(0.5, 3.0, n), rng.uniform(0.5e-4, 2e-4, n)
    (contact,), total = contact_features(np.zeros(n, int), force, sigma, position, rotation, area)
    centre, _ = naive.centre(range(n), force[2], sigma[2], position)
    about = naive.wrench(range(n), force, sigma, position, rotation, centre)
    normal = contact["normal"]
    for record in (contact, total):
        assert record["normal"].tolist() == normal.tolist()
        assert record["shear"] == pytest.approx(np.linalg.norm(np.cross(about[0][:3], normal)))
        assert record["torsion"] == pytest.approx(about[0][3:] @ normal, rel=1e-6, abs=1e-9)
        axes, units = contact["axes"], range(n)
        face = naive.face_variance(units, force[2], area.mean(), position, rotation, axes)
        face = naive.face_torque(about[0][:3], face)
        sigma_of = np.sqrt(normal @ (about[1][3:, 3:] + face) @ normal)
        assert record["torsion_sigma"] == pytest.approx(sigma_of, rel=1e-5, abs=1e-9)
        assert record["load"] == pytest.approx(force[2].sum())
        assert record["load_sigma"] == pytest.approx(np.sqrt((sigma[2] ** 2).sum()))
        assert record["area"] == pytest.approx(area.sum())
        assert record["mean_pressure"] == pytest.approx(force[2].sum() / area.sum())
        assert record["peak_pressure"] == pytest.approx((force[2] / area).max())
        assert record["peak_unit"] == np.argmax(force[2] / area)
        origin = naive.wrench(range(n), force, sigma, position, rotation, np.zeros(3))[1]
        origin[3:, 3:] += face
        assert record["wrench_sigma"] ** 2 == pytest.approx(np.diag(origin), rel=1e-6)
        assert bool(record["flags"] & Flag.TORSION_BLIND) == (n == 1)
        assert not record["flags"] & Flag.WEAK


def test_of_a_load_that_grows_weak_nothing_about_its_centre_is_told_any_more():
    position = naive.grid(1, 3)
    stream = ContactStream(
        position, naive.facing_down(3), 1e-4, *neighbour_graph(position, 0.0125), want={"slip"},
        slip=SlipSettings(friction=0.5),
    )  # fmt: skip
    with_gate(stream, start_sigma=4.1)
    force = np.array([[0.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for number, sigma in enumerate((0.01, 0.01, 0.24)):
        (contact,) = stream.update(force, sigma, 0.3 * force, 0.01, stamp_ns=number * 4_000_000)
        weak = sigma > 0.2
        assert bool(contact.flags & Flag.WEAK) == weak
        for name in ("centroid", "centroid_covariance", "moment", "moment_covariance", "torsion",
                     "torsion_sigma", "margin", "grip_force"):  # fmt: skip
            assert np.isnan(getattr(contact, name)).all() == weak, name
        assert contact.load == pytest.approx(1.0)
        assert contact.shear == pytest.approx(0.1)
