"""Bodies against faces: depths and the way a moving body takes the faces along."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skin.sim.mechanics.body import Body, carried, penetration
from tests.fixtures.cases import long_after_first
from tests.naive.mechanics import inside, square, turned

SEEDS = st.integers(0, 2**32 - 1)

BODIES = {
    "sphere": Body.sphere(0.03),
    "cylinder": Body.cylinder(0.02, 0.05),
    "block": Body.block(0.05, 0.04, 0.03),
    "plate": Body.plate(0.06, 0.05, 0.02),
}


def rotation_of(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


@long_after_first("name", BODIES)
@given(seed=SEEDS)
def test_the_axis_leaves_the_body_where_the_body_ends(name: str, seed: int) -> None:
    """Just before the depth the axis is in the body, just behind it is not, nor farther on."""
    rng = np.random.default_rng(seed)
    body, turn = BODIES[name], rotation_of(rng)
    n = 40
    position = rng.uniform(-0.03, 0.03, (3, n))
    rotation = np.stack([rotation_of(rng) for _ in range(n)], axis=-1)
    pose = turn, rng.uniform(-0.01, 0.01, 3)
    depth_mm = penetration(body, pose, position, rotation)

    def is_in(depth: np.ndarray) -> np.ndarray:
        points = turn.T @ (position + depth * rotation[:, 2] - pose[1][:, np.newaxis])
        return inside(body, points)

    starts_in, touched = is_in(np.zeros(n)), depth_mm > 0.0
    assert np.all(starts_in == touched)
    depth = 1e-3 * np.where(np.isfinite(depth_mm), depth_mm, 0.0)
    away = np.isfinite(depth_mm) & ~touched
    for met in (touched, away):
        assert np.all(is_in(depth - 1e-7)[met])
        assert not np.any(is_in(depth + 1e-7)[met])
    for further in np.linspace(0.001, 0.1, 20):
        assert not np.any(is_in(depth + further)[touched | away])


# -- motion ----------------------------------------------------------------------------------------


@given(angle=st.floats(-0.3, 0.3), x=st.floats(-0.05, 0.05), y=st.floats(-0.05, 0.05))
def test_a_body_that_turns_on_the_spot_carries_faces_around_it(
    angle: float, x: float, y: float
) -> None:
    """Torsion: a point comes to where it is on a circle about the axis."""
    skin, depth = square(4), np.full(16, 1.0)
    pose = np.eye(3), np.array([x, y, 0.02])
    after = turned(pose, np.array([0.0, 0.0, 1.0]), angle)
    way = np.einsum("ijn,jn->in", skin.rotation[:, :2], carried(
        pose, after, skin.position, skin.rotation, depth
    ))  # fmt: skip
    arm = (skin.position[0] - x) + 1j * (skin.position[1] - y)
    np.testing.assert_allclose(
        1e-3 * (way[0] + 1j * way[1]), arm * (1.0 - np.exp(-1j * angle)), atol=1e-12
    )
