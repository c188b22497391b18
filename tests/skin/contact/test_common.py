"""Errors that units share: forces per field by differences, sums by plain matrices."""

from __future__ import annotations

import numpy as np
import pytest

from skin.contact.common import LAW, Common, _rows, add_common, felt_rows, spread_common
from skin.contact.model import POSE, contact_data, no_readings
from skin.contact.touched import gather, touched_rows

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


def common_of(fields, by_strength, rng):
    """So many units, of two bodies by turns."""
    n = fields.shape[1]
    law = np.zeros(n, LAW)
    law["body"] = np.arange(n) % 2
    law["axes"] = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]
    law["film"], law["gain"], law["gain_offset"] = FILM_MM, GAIN, OFFSET
    law["shear"][:, :, 0] = SOFT, KNEE_MM, STIFFER, 0.0
    law["wavenumber"] = K_RAD_PER_MM if by_strength else 0.0
    size = np.hypot(*fields[:2])
    turned = np.arctan2(size, fields[2])
    moved = np.vstack([turned / K_RAD_PER_MM * fields[:2] / size - FILM_MM[:, np.newaxis],
                       np.full(n, DEPTH_MM)])  # fmt: skip
    root = rng.standard_normal((2, 3, 3))
    return Common(
        law, fields, moved, root @ root.transpose(0, 2, 1), rng.uniform(1.0, 9.0, n),
        np.array([7.0]), felt_rows(n), np.zeros((4, 4, 6, 3)),
    )  # fmt: skip


def fields_of(rng, n=UNITS):
    """Fields of films that have turned by 0.2 to 0.9 rad, some below the knee."""
    turned, way = rng.uniform(0.2, 0.9, n), rng.uniform(-np.pi, np.pi, n)
    lateral = np.sin(turned) * np.stack([np.cos(way), np.sin(way)])
    return M0_UT * np.vstack([lateral, np.cos(turned)])


def added(k, units, common, poses=None, variance=0.0):
    """Forces per µT of units that are added to row k, (units, 2, 3), and what is left of the
    variances of their tangential forces."""
    n = common.law.size
    reading, data = no_readings(n, float), contact_data(no_readings(n, float), 1, 0)
    reading.force_sigma[:] = np.sqrt(variance)
    poses = np.zeros(n, POSE) if poses is None else poses
    units = np.asarray(units, np.int32)
    length, touched = gather(units, reading, poses, data.touched), touched_rows(data.touched)
    add_common(k, units, length, common, touched)
    per_ut = _rows(common.felt).per_ut
    assert not per_ut[:, units.size : length].any()
    return per_ut[:, : units.size].T.reshape(-1, 2, 3).copy(), touched.variance[:2, : units.size]


@pytest.mark.parametrize("by_strength", [False, True])
def test_force_per_field_is_that_of_differences(by_strength):
    common = common_of(
        fields_of(np.random.default_rng(4), 20), by_strength, np.random.default_rng(5)
    )
    found, _ = added(0, range(20), common)
    for i in range(20):
        steps = 0.01 * np.eye(3)
        field = common.field_ut[:, i]
        expected = np.stack([
            (force_at(field + step, by_strength) - force_at(field - step, by_strength)) / 0.02
            for step in steps
        ], axis=1)  # fmt: skip
        # the sinc is within 3 %
        np.testing.assert_allclose(found[i], expected, atol=0.035 * np.abs(expected).max())


@pytest.mark.parametrize("by_strength", [False, True])
def test_units_whose_field_or_displacement_is_unknown_share_nothing(by_strength):
    rng = np.random.default_rng(6)
    common = common_of(fields_of(rng, 5), by_strength, rng)
    common.field_ut[:2, 0], common.displacement_mm[1, 1] = 0.0, np.nan
    common.field_ut[0, 2], common.field_ut[1, 3] = np.nan, np.nan
    per_ut, _ = added(0, range(5), common)
    assert not per_ut[:4].any()
    assert per_ut[4, :, :2].all()


def test_wrenches_per_field_and_their_covariances_are_those_of_plain_matrices():
    rng = np.random.default_rng(7)
    common, n = common_of(fields_of(rng), False, rng), UNITS
    poses = np.zeros(n, POSE)
    poses["position"] = rng.standard_normal((n, 3))
    poses["rotation"] = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]
    rows, variance = [np.array([2, 1]), np.array([0])], 9.1e-7
    gain = np.zeros((4, 4, 6, 3))
    for k, units in enumerate(rows):
        found, left = added(k, units, common, poses, variance)
        for at, i in enumerate(units):
            law, pose, per_ut = common.law[i], poses[i], found[at]
            ways = {law["body"]: per_ut @ law["axes"].T,
                    law["body"] + 2: np.outer(per_ut[:, 2], law["axes"][:, 2])}  # fmt: skip
            for column, local in ways.items():
                forces = pose["rotation"][:, :2] @ local
                gain[k, column, :3] += forces
                gain[k, column, 3:] += np.cross(pose["position"], forces, axisb=0, axisc=0)
            shared = common.residue_ut2[i] * (per_ut[:, :2] ** 2).sum(axis=1)
            own = np.maximum(variance - shared, 0.0)  # 0 of two of the six
            np.testing.assert_allclose(left[:, at], own, rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(common.gain, gain, rtol=1e-9, atol=1e-12)

    data = contact_data(no_readings(n, float), 2, 0)._replace(common=common)
    data.sums.rows["wrench_covariance"] = rng.standard_normal(21)
    before = data.sums.rows["wrench_covariance"].copy()
    spread_common(2, data)
    gain[3] = gain[:3].sum(axis=0)
    for k in (0, 1, 3):
        expected = sum(gain[k, g] @ common.covariance_ut2[g] @ gain[k, g].T
                       + 7.0 * gain[k, g + 2] @ gain[k, g + 2].T for g in range(2))  # fmt: skip
        spread = data.sums.rows["wrench_covariance"][k] - before[k]
        np.testing.assert_allclose(spread, expected[np.triu_indices(6)], rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(data.sums.rows["wrench_covariance"][2], before[2])
