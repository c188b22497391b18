"""Errors that units share: sums over units by plain matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skin.contact.describe import add_shared, spread_shared
from skin.contact.model import contact_data, contact_model

UNITS = 3


def units_of(rng):
    """Model and data of units of two bodies by turns, whose forces follow their fields."""
    turns = np.moveaxis(Rotation.random(UNITS, rng=rng).as_matrix(), 0, 2)
    model = contact_model(rng.standard_normal((3, UNITS)), turns, 1.0, np.zeros(UNITS + 1), [])
    root = rng.standard_normal((2, 3, 3))
    model.poses["body"] = np.arange(UNITS) % 2
    model.poses["axes"] = np.linalg.qr(rng.standard_normal((UNITS, 3, 3)))[0]
    data = contact_data(UNITS, 2, 0)._replace(
        covariance_ut2=root @ root.transpose(0, 2, 1), gain=np.zeros((2, 2, 2, 3, 6))
    )
    data.units["per_ut"] = rng.standard_normal((UNITS, 6))
    data.units["residue"] = rng.uniform(1.0, 9.0, UNITS)
    return model, data


def test_units_whose_force_follows_an_unknown_field_share_nothing():
    model, data = units_of(np.random.default_rng(6))
    data.units["per_ut"][0, 4] = np.nan
    assert add_shared(data.units[0], model.poses[0], data.gain[0]) == (0.0, 0.0)
    assert not data.gain.any()


def test_wrenches_per_field_and_their_covariance_are_those_of_plain_matrices():
    rng = np.random.default_rng(7)
    model, data = units_of(rng)
    gain = np.zeros((2, 2, 6, 3))
    for pose, u in zip(model.poses, data.units, strict=True):
        found = np.reshape(u["per_ut"], (2, 3))
        for rest, local in enumerate((found @ pose["axes"].T,
                                      np.outer(found[:, 2], pose["axes"][:, 2]))):  # fmt: skip
            forces = pose["rotation"][:, :2] @ local
            gain[pose["body"], rest, :3] += forces
            gain[pose["body"], rest, 3:] += np.cross(pose["position"], forces, axisb=0, axisc=0)
        shared = add_shared(u, pose, data.gain[0])
        assert shared == pytest.approx(u["residue"] * (found[:, :2] ** 2).sum(axis=1))
    np.testing.assert_allclose(data.gain[0].swapaxes(2, 3), gain, rtol=1e-9, atol=1e-12)
    before = rng.standard_normal((6, 6))
    covariance = before.copy()
    spread_shared(data.gain[0], 7.0, data, covariance)
    expected = sum(
        of_field @ c @ of_field.T + 7.0 * rest @ rest.T
        for (of_field, rest), c in zip(gain, data.covariance_ut2, strict=True)
    )
    np.testing.assert_allclose(covariance - before, expected, rtol=1e-7, atol=1e-9)
