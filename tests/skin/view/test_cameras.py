"""Camera presets: all that is drawn is in the picture, left of the panel."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from skin.view.cameras import FIT, PANEL_PX, VIEWS, fitted, set_camera
from skin.view.history import Pose

FOV = 1.0


def pixels(points, position, target, up, size):
    """Where a pinhole camera sees points, shape (m, 2), from the upper left corner."""
    depth = target - position
    depth /= np.linalg.norm(depth)
    right = np.cross(depth, up)
    right /= np.linalg.norm(right)
    down = np.cross(depth, right)
    seen = (points - position) @ np.stack([right, down, depth], axis=1)
    assert (seen[:, 2] > 0.0).all()
    focal = 0.5 * size[1] / np.tan(0.5 * FOV)
    return focal * seen[:, :2] / seen[:, 2:] + 0.5 * np.array(size)


def camera(size):
    return SimpleNamespace(
        position=np.array([0.3, -1.0, 0.9]), look_at=np.array([0.1, 0.0, 0.0]),
        up_direction=np.array([0.0, 0.0, 1.0]), fov=FOV, image_width=size[0], image_height=size[1],
    )  # fmt: skip


def facing(outward):
    z = -np.array(outward, float)
    x = np.cross([0.3, 0.5, 0.8], z)
    x /= np.linalg.norm(x)
    return Pose(np.zeros((3, 1)), np.stack([x, np.cross(z, x), z], axis=1)[:, :, None])


@pytest.mark.parametrize("size", [(1440, 960), (1000, 900), (500, 900), (2400, 700)])
@pytest.mark.parametrize("view", VIEWS)
def test_a_preset_has_everything_in_the_free_part_of_the_picture(view, size):
    rng = np.random.default_rng(5)
    for shape in ((1.0, 1.0, 0.02), (0.1, 1.0, 0.3), (1.0, 1.0, 1.0)):
        points = rng.uniform(-0.5, 0.5, (200, 3)) * shape + [0.2, -0.1, 0.05]
        one = camera(size)
        set_camera(one, view, points, facing([0.0, 0.0, 1.0]))
        seen = pixels(points, one.position, one.look_at, one.up_direction, size)
        free = size[0] - PANEL_PX if size[0] > 2 * PANEL_PX else size[0]
        assert (seen >= 0.0).all()
        assert (seen <= [free, size[1]]).all()
        assert (np.ptp(seen, axis=0) / [free, size[1]]).max() > 0.5  # and it is large


def test_fit_keeps_the_direction_of_view():
    one, before = camera((1440, 960)), camera((1440, 960))
    set_camera(one, FIT, np.eye(3), facing([0.0, 0.0, 1.0]))
    now, then = one.position - one.look_at, before.position - before.look_at
    np.testing.assert_allclose(now / np.linalg.norm(now), then / np.linalg.norm(then), atol=1e-9)


@pytest.mark.parametrize("outward", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (0.2, 0.1, 0.9)])
def test_the_front_is_the_side_that_units_face(outward):
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))
    views = {}
    for view in VIEWS[1:]:
        one = camera((1440, 960))
        set_camera(one, view, points, facing(np.array(outward) / np.linalg.norm(outward)))
        toward = one.position - one.look_at
        views[view] = toward / np.linalg.norm(toward)
        assert abs(np.linalg.norm(one.up_direction) - 1.0) < 1e-9
        assert abs(one.up_direction @ views[view]) < 1e-9
    assert views["front"] @ np.array(outward) > 0.9 * np.linalg.norm(outward)
    np.testing.assert_allclose(views["left"], -views["right"])
    assert abs(views["top"] @ views["front"]) < 1e-9


def test_a_point_alone_is_seen():
    position, target = fitted(np.zeros((1, 3)), np.eye(3)[2], np.eye(3)[1], FOV, (1440, 960))
    assert np.isfinite(position).all()
    assert np.linalg.norm(position - target) > 0.01
