"""Arrows, discs and labels, against what one computes unit by unit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from skin.contact.record import SlipState
from skin.state import Status
from skin.view.drawing import (
    LEAST_MISFIT,
    SLIP_COLOURS,
    Pose,
    camera,
    contact_arrows,
    contact_label,
    cross,
    disc,
    frame_of,
    radii,
    tag_places,
    unit_arrows,
)
from tests.fixtures.shown import Shown
from tests.naive.record import fill, snapshots


@pytest.fixture
def skin():
    return Shown(5, 7)


def snapshot_of(skin, **of_state):
    record = snapshots(1, skin.topology.n)
    fill(record, skin.state(**of_state))
    return record[0]


def pose_of(skin):
    return Pose(*(np.array(each, np.float32) for each in skin.poses))


def test_discs_do_not_overlap(skin):
    radius = radii(skin.poses[0], np.full(skin.topology.n, 1.0))
    gap = np.linalg.norm(skin.poses[0][:, :, None] - skin.poses[0][:, None], axis=0)
    np.fill_diagonal(gap, np.inf)
    assert (radius[:, None] + radius[None] <= gap).all()


def test_arrows_are_those_of_each_unit_that_is_valid_and_loaded(skin):
    rng = np.random.default_rng(2)
    n = skin.topology.n
    force = rng.normal(0.0, 0.5, (3, n)) * (rng.random(n) < 0.6)
    status = np.where(rng.random(n) < 0.2, int(Status.LATE | Status.STALE), 0).astype(np.uint16)
    force[:, status > 0] = np.nan
    pose, frame = pose_of(skin), frame_of(pose_of(skin), np.full(n, 0.005))
    radius = rng.uniform(0.01, 0.03, n)
    got = unit_arrows(snapshot_of(skin, force=force, status=status), pose, frame, radius, 2.0)
    expected = []
    for i in range(n):
        if status[i] or np.linalg.norm(force[:, i]) <= max(0.0555, 0.04):
            continue
        beside = (skin.poses[1][:, 0, i] + skin.poses[1][:, 1, i]) / np.sqrt(2.0)
        head = (skin.poses[0][:, i] - frame.middle) * frame.scale + 1.25 * radius[i] * beside
        push = skin.poses[1][:, :, i] @ force[:, i]
        expected.append((head - 0.2 * push / 2.0, head))
    assert len(got) == len(expected) > 5
    np.testing.assert_allclose(got, np.array(expected), atol=1e-5)


def test_noise_has_an_arrow_once_in_a_million(skin):
    assert chi2.sf(LEAST_MISFIT, 3) == pytest.approx(1e-6, rel=0.05)
    record, pose = snapshot_of(skin), pose_of(skin)
    limit_n = 0.01 * np.sqrt(LEAST_MISFIT)
    record["force"][2] = limit_n * np.where(np.arange(35) < 20, 1.01, 0.99)
    frame = frame_of(pose, np.full(35, 0.005))
    assert len(unit_arrows(record, pose, frame, np.full(35, 0.02), 1e-3)) == 20


def test_an_untouched_skin_has_no_arrow_and_no_label(skin):
    record, pose = snapshot_of(skin), pose_of(skin)
    frame = frame_of(pose, np.full(35, 0.005))
    assert unit_arrows(record, pose, frame, np.full(35, 0.02), 1.0).shape == (0, 2, 3)
    forces, normals, hues, known = contact_arrows(record, frame, 1.0)
    assert forces.shape == normals.shape == (0, 2, 3)
    assert hues.shape == (0, 3)
    assert known.size == 0


def test_contacts_have_arrow_normal_colour_and_label(skin):
    contacts = [skin.contact(4, 5.0, SlipState.STICK, 7), skin.contact(9, 2.0, SlipState.GROSS, 8)]
    contacts.append(skin.contact(1, 1.0, SlipState.UNKNOWN, 9))
    contacts[2].record["centroid"] = contacts[2].record["margin_at_least"] = np.nan
    record, pose = snapshot_of(skin, contacts=contacts), pose_of(skin)
    frame = frame_of(pose, np.full(35, 0.005))
    forces, normals, hues, known = contact_arrows(record, frame, 10.0)
    assert known.tolist() == [0, 1]
    for row, (unit, load) in enumerate(((4, 5.0), (9, 2.0))):
        head = (skin.poses[0][:, unit] - frame.middle) * frame.scale
        outward = -skin.poses[1][:, 2, unit]
        np.testing.assert_allclose(forces[row], [head + 0.4 * load / 10 * outward, head], atol=1e-5)
        np.testing.assert_allclose(normals[row], [head, head + 0.16 * outward], atol=1e-5)
    assert hues.tolist() == [[*SLIP_COLOURS[SlipState.STICK]], [*SLIP_COLOURS[SlipState.GROSS]]]
    assert [contact_label(one.record) for one in contacts] == [
        "contact 7   5.00 N   stick   margin 50 %",
        "contact 8   2.00 N   gross slip   margin 50 %",
        "contact 9   1.00 N",
    ]


@pytest.mark.parametrize("mesh", [disc, cross])
def test_faces_look_away_from_the_skin(mesh):
    vertices, faces = mesh()
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = np.abs(normal[:, 2]) > 1e-6
    assert flat.any()
    assert (normal[flat, 2] < 0.0).all()
    middle = corners[~flat].mean(axis=1)
    assert (np.einsum("fa,fa->f", normal[~flat][:, :2], middle[:, :2]) > 0.0).all()


def test_the_camera_looks_at_the_faces():
    for outward in ([0.0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, -1]):
        z = -np.array(outward)
        x = np.cross([0.3, 0.5, 0.8], z)
        x /= np.linalg.norm(x)
        rotation = np.stack([x, np.cross(z, x), z], axis=1)[:, :, None]
        place, _, up = camera(Pose(np.zeros((3, 1)), rotation))
        assert place @ outward > 0.5
        assert np.linalg.norm(up) == pytest.approx(1.0)


def test_names_of_patches_stand_beside_their_units():
    flat = Pose(
        np.stack([np.arange(36) % 6, np.arange(36) // 6, np.zeros(36)]).astype(np.float32),
        np.repeat(np.diag([1.0, -1.0, -1.0])[:, :, None], 36, axis=2).astype(np.float32),
    )
    points = frame_of(flat, np.full(36, 0.4)).points(flat.position)
    left, right, missing = tag_places(points, flat, (np.arange(36) % 6 >= 3).astype(int), 3)
    assert left[0] < points[:, 0].min()
    assert right[0] > points[:, 0].max()
    assert np.isnan(missing).all()
    (alone,) = tag_places(points, flat, np.zeros(36, int), 1)
    assert alone[1] < points[:, 1].min()
