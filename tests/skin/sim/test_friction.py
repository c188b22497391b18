"""Bodies dragged over skins: stick and slip, torsion and rolling, work, and what the truth says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import spearmanr

from skin.errors import SkinError
from skin.sim.mechanics.body import Body, Pose
from skin.sim.mechanics.contact import Mechanics, MechanicsTruth
from skin.sim.truth import wrench_map
from tests.naive.mechanics import moved, turned
from topology import load

DOWN = np.array([0.0, 0.0, -1.0])
SEEDS = st.integers(0, 2**32 - 1)
RADIUS_M = 0.1


def ball(name: str = "palm", **options: object) -> Mechanics:
    """A sphere on one of the skins."""
    return Mechanics(load(name), Body.sphere(RADIUS_M), **options)


def over(x: float, y: float, depth_m: float) -> Pose:
    """The sphere over a point of the palm."""
    return np.eye(3), np.array([x, y, RADIUS_M - depth_m])


def wrench(truth: MechanicsTruth, name: str = "palm") -> np.ndarray:
    """Force and moment about the origin of the skin, shape (6,)."""
    skin = load(name)
    return wrench_map(skin.position, skin.rotation) @ truth.force.ravel()


def dissipated_j(truth: MechanicsTruth) -> float:
    """Work that friction took in the last step, by the forces at its end."""
    return 1e-3 * float(np.vdot(truth.force[:2], truth.slip_mm))


# -- bodies on skins -------------------------------------------------------------------------------


def random_drive(mechanics: Mechanics, seed: int, steps: int, name: str = "palm"):
    """Truths along a random way of the sphere, pressed, dragged, turned; poses of each."""
    rng, skin = np.random.default_rng(seed), load(name)
    near = rng.integers(skin.n)
    out = -skin.rotation[:, 2, near]
    pose = np.eye(3), skin.position[:, near] + (RADIUS_M - 0.001) * out
    for _ in range(steps):
        pose = moved(pose, rng.normal(0.0, 2e-4, 3))
        pose = turned(pose, rng.normal(size=3), rng.normal(0.0, 0.003))
        yield mechanics.step(pose)


@settings(max_examples=10)
@given(seed=SEEDS, name=st.sampled_from(("palm", "fingertip")), slower=st.floats(0.5, 1.0))
def test_coulomb_is_never_exceeded_and_no_work_is_gained(
    seed: int, name: str, slower: float
) -> None:
    mechanics = ball(name, static=0.3, kinetic=0.3 * slower)
    loads = 0.0
    for truth in random_drive(mechanics, seed, 30, name):
        assert np.all(np.hypot(*truth.force[:2]) <= 0.3 * truth.load * (1.0 + 1e-9))
        assert np.all(truth.load >= 0.0)
        assert np.all(truth.contact == (truth.load > 0.0))
        assert not np.any(truth.slipping & ~truth.contact)
        assert dissipated_j(truth) >= -1e-12
        loads += truth.load.sum()
    assert loads > 0.0


@settings(max_examples=8)
@given(force=st.floats(0.1, 60.0), x=st.floats(-0.03, 0.03), name=st.sampled_from(("palm",)))
def test_unit_loads_add_up_to_the_load_of_the_body(force: float, x: float, name: str) -> None:
    mechanics = ball(name)
    truth = mechanics.push(over(x, 0.002, -0.05), force, DOWN)
    assert truth.load.sum() == pytest.approx(force, rel=1e-6, abs=1e-8)
    assert -wrench(truth)[2] == pytest.approx(force, rel=1e-6, abs=1e-8)
    height = truth.pose[1][2]
    again = ball(name).step(truth.pose)
    np.testing.assert_allclose(again.load, truth.load, rtol=1e-5, atol=1e-6)
    more = mechanics.push(over(x, 0.002, -0.05), 1.1 * force, DOWN)
    assert more.pose[1][2] < height


@pytest.mark.parametrize("name", ["fingertip", "hand"])
def test_a_load_is_found_on_curved_skins(name: str) -> None:
    """Normal forces add up along the way of the press, wherever on the skin that is."""
    skin = load(name)
    for near in range(0, skin.n, 7):
        into = skin.rotation[:, 2, near]
        pose = np.eye(3), skin.position[:, near] - (RADIUS_M + 0.01) * into
        truth = ball(name).push(pose, 3.0, into)
        along = into @ np.einsum("in,n->i", skin.rotation[:, 2], truth.load)
        assert along == pytest.approx(3.0, rel=1e-6)


def test_a_load_that_is_not_to_be_had_is_refused() -> None:
    with pytest.raises(SkinError, match=r"^push: load_n must be one that the body meets along dir"):
        ball().push(over(0.0, 0.0, -0.01), 5.0, -DOWN)
    with pytest.raises(SkinError, match=r"^push: load_n must be one that the body meets along dir"):
        ball().push(over(1.0, 0.0, -0.01), 5.0, DOWN)


# -- stick and slip --------------------------------------------------------------------------------


def test_the_rim_slips_first() -> None:
    """A sphere dragged off: light units before heavy ones, then all; standing still, none."""
    mechanics = Mechanics(
        load("palm"), Body.sphere(0.4),
        static=0.5,
    )  # fmt: skip
    first_slip = np.full(64, np.inf)
    for k in range(200):
        pose = np.eye(3), np.array([max(0, k - 5) * 2.5e-5, 0.001, 0.4 - 0.0012])
        truth = mechanics.step(pose)
        if k == 5:
            load_n = truth.load.copy()
        first_slip[truth.slipping & np.isinf(first_slip)] = k
    began = load_n > 0.0
    assert began.sum() > 12
    assert np.all(np.isfinite(first_slip[began]))
    assert spearmanr(load_n[began], first_slip[began]).statistic > 0.9
    assert truth.slipping[truth.contact].all()
    truth = mechanics.step(truth.pose)
    assert not truth.slipping.any()


@pytest.mark.long
def test_gross_slip_bears_the_friction_of_motion_and_rest_that_of_rest() -> None:
    """A plate at rest is held by more than one in motion, and again so after a rest."""
    mechanics = Mechanics(load("palm"), Body.plate(0.3, 0.3), static=0.5, kinetic=0.3)
    at, ratios = 0.0, []
    for k in range(300):
        at += 0.0 if 150 <= k < 160 else 1e-5
        truth = mechanics.step((np.eye(3), np.array([at, 0.0, -0.0005])))
        ratios.append(wrench(truth)[0] / truth.load.sum())
    assert max(ratios[:150]) == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(ratios[100:150], 0.3, rtol=1e-9)
    np.testing.assert_allclose(ratios[150:160], 0.3, rtol=1e-9)
    assert max(ratios[160:]) == pytest.approx(0.5, abs=0.01)
    assert ratios[-1] == pytest.approx(0.3, rel=1e-9)


def test_friction_that_fades_lets_a_held_body_slip() -> None:
    """Nothing moves but the coefficient: the force follows it down."""
    mechanics = Mechanics(load("palm"), Body.plate(0.3, 0.3), static=np.full(64, 0.5))
    down = np.array([0.0, 0.0, -0.0005])
    mechanics.step((np.eye(3), down))
    pose = np.eye(3), down + np.array([4e-4, 0.0, 0.0])
    held = wrench(mechanics.step(pose))[0]
    for time_s in np.arange(0.1, 4.0, 0.1):
        mechanics.friction = 2 * (np.full(64, 0.5 - 0.1 * time_s),)
        truth = mechanics.step(pose)
        bound = (0.5 - 0.1 * time_s) * truth.load.sum()
        assert wrench(truth)[0] == pytest.approx(min(held, bound), rel=1e-6)
        assert truth.slipping.any() == (held > bound)
    assert truth.slipping[truth.contact].all()


# -- torsion, rolling, soft bodies -----------------------------------------------------------------


@pytest.mark.long
def test_torsion_turns_faces_around_the_contact() -> None:
    """A moment against the turn, no net force; gross slip at the sum of µ f r."""
    mechanics = ball(static=0.4)
    pose = over(0.0, 0.0, 0.0015)
    mechanics.step(pose)
    moments = []
    for k in range(1, 60):
        truth = mechanics.step(turned(pose, np.array([0.0, 0.0, 1.0]), 0.005 * k))
        np.testing.assert_allclose(wrench(truth)[:2], 0.0, atol=1e-6)
        moments.append(wrench(truth)[5])
    r = np.hypot(*load("palm").position[:2])
    gross = 0.4 * truth.load @ r
    assert np.all(np.diff(moments) >= -1e-9)
    assert 0.0 < moments[0] < 0.5 * gross
    assert moments[-1] == pytest.approx(gross, rel=1e-4)


def test_a_soft_body_spreads_its_load() -> None:
    hard = ball().push(over(0.0, 0.0, 0.0), 8.0, DOWN)
    soft_ball = Body.sphere(RADIUS_M, compliance_mm_per_n=1.0)
    soft = Mechanics(load("palm"), soft_ball)
    truth = soft.push(over(0.0, 0.0, 0.0), 8.0, DOWN)
    assert truth.contact.sum() > hard.contact.sum()
    assert truth.load.max() < hard.load.max()
    assert truth.load.sum() == pytest.approx(8.0)
    shifted = soft.step(moved(truth.pose, np.array([1e-4, 0.0, 0.0])))
    # half a newton per mm of the unit, one of the body: a third of the way is the body's
    middle = np.argmax(shifted.load)
    way = np.hypot(*shifted.displacement_mm[:2, middle])
    assert way == pytest.approx(0.1 / 1.5, rel=1e-6)
