"""Errors that units share: forces per field by differences, sums by plain matrices."""

from __future__ import annotations

import numpy as np
import pytest

from skin.contact.model import contact_data, contact_model
from skin.contact.unseen import add_shared, force_per_ut, spread_shared

K_RAD_PER_MM, M0_UT = 0.5, 2500.0
SOFT, KNEE_MM, STIFFER = 0.4, 0.8, 0.3
FILM_MM, DEPTH_MM, GAIN, OFFSET = np.array([0.2, -0.15]), 0.7, 0.3, 0.9
UNITS = 3


def force_at(field, by_strength):
    """Of a film whose field turns, by the definitions: displacement, then force."""
    size = np.hypot(*field[:2])
    turned = np.arcsin(size / M0_UT) if by_strength else np.arctan2(size, field[2])
    moved = turned / K_RAD_PER_MM * field[:2] / size - FILM_MM
    length = np.hypot(*moved)
    drag = SOFT * length + STIFFER * max(length - KNEE_MM, 0.0)
    return (GAIN * DEPTH_MM + OFFSET) * drag * moved / length


def units_of(fields, by_strength, rng):
    """Model and data of so many units, of two bodies by turns."""
    n = fields.shape[1]
    model = contact_model(
        rng.standard_normal((3, n)), np.moveaxis(np.linalg.qr(rng.standard_normal((n, 3, 3)))[0],
                                                 0, 2), 1.0, np.zeros(n + 1), []
    )  # fmt: skip
    poses, root = model.poses, rng.standard_normal((2, 3, 3))
    poses["body"] = np.arange(n) % 2
    poses["axes"] = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]
    poses["film"], poses["gain"], poses["gain_offset"] = FILM_MM, GAIN, OFFSET
    poses["shear"][:, :, 0] = SOFT, KNEE_MM, STIFFER, 0.0
    poses["wavenumber"] = K_RAD_PER_MM if by_strength else 0.0
    model.settings["rest_ut2"] = 7.0
    size = np.hypot(*fields[:2])
    turned = np.arctan2(size, fields[2])
    moved = np.vstack([turned / K_RAD_PER_MM * fields[:2] / size - FILM_MM[:, np.newaxis],
                       np.full(n, DEPTH_MM)])  # fmt: skip
    data = contact_data(n, 2, 0)._replace(
        covariance_ut2=root @ root.transpose(0, 2, 1), gain=np.zeros((2, 2, 2, 3, 6))
    )
    data.units["field"], data.units["field_displacement"] = fields.T, moved.T
    data.units["residue"] = rng.uniform(1.0, 9.0, n)
    return model, data


def fields_of(rng, n=UNITS):
    """Fields of films that have turned by 0.2 to 0.9 rad, some below the knee."""
    turned, way = rng.uniform(0.2, 0.9, n), rng.uniform(-np.pi, np.pi, n)
    lateral = np.sin(turned) * np.stack([np.cos(way), np.sin(way)])
    return M0_UT * np.vstack([lateral, np.cos(turned)])


def per_ut(i, model, data):
    """Tangential force of a unit per µT, (2, 3)."""
    return np.reshape(force_per_ut(data.units[i], model.poses[i]), (2, 3))


@pytest.mark.parametrize("by_strength", [False, True])
def test_force_per_field_is_that_of_differences(by_strength):
    fields = fields_of(np.random.default_rng(4), 20)
    model, data = units_of(fields, by_strength, np.random.default_rng(5))
    for i, field in enumerate(fields.T):
        expected = np.stack([
            (force_at(field + step, by_strength) - force_at(field - step, by_strength)) / 0.02
            for step in 0.01 * np.eye(3)
        ], axis=1)  # fmt: skip
        # the sinc is within 3 %
        found = per_ut(i, model, data)
        np.testing.assert_allclose(found, expected, atol=0.035 * np.abs(expected).max())


@pytest.mark.parametrize("by_strength", [False, True])
def test_units_whose_field_or_displacement_is_unknown_share_nothing(by_strength):
    rng = np.random.default_rng(6)
    model, data = units_of(fields_of(rng, 5), by_strength, rng)
    field, moved = data.units["field"], data.units["field_displacement"]
    field[0, :2], moved[1, 1], field[2, 0], field[3, 1] = 0.0, np.nan, np.nan, np.nan
    assert not any(per_ut(i, model, data).any() for i in range(4))
    assert per_ut(4, model, data)[:, :2].all()


def test_wrenches_per_field_and_their_covariance_are_those_of_plain_matrices():
    rng = np.random.default_rng(7)
    model, data = units_of(fields_of(rng), False, rng)
    gain = np.zeros((2, 2, 6, 3))
    for pose, u, i in zip(model.poses, data.units, range(UNITS), strict=True):
        found = per_ut(i, model, data)
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
