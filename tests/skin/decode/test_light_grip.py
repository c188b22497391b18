"""Shear of a light grip is no ambient field: units that are pressed and pulled all alike. What is
not known of the field is in sigma.

The forward model is its own: forces to field and frequency by the numbers of the paper, and back;
neither simulator nor decoder has a part in it.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import topology
from skin.decode.ambient import Ambient
from skin.errors import OptionError
from skin.options import Options
from skin.pipeline import Pipeline
from tests.fixtures.ambient import look
from tests.fixtures.cases import long_after_first
from tests.fixtures.topology import write_topology

RATE_HZ = 250.0
EARTH = np.array([20.0, 30.0, -44.0])
PAD = 'kind = "grid"\nrows = 4\ncolumns = 4\npitch_m = 0.012\nlayout = "f3t-fd16"\n'
FACING = "pose = { xyz_m = [0.0, 0.0, 0.1], rpy_deg = [180.0, 0.0, 0.0] }\n"


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two pads of 16 units that face each other, on one body."""
    file = write_topology(
        tmp_path_factory.mktemp("pair"), head="cycle_rate_hz = 250",
        patch=f"{PAD}first_id = 0x100\n",
        more=f'[[patches]]\nname = "other"\nbus = "main"\n{PAD}first_id = 0x180\n{FACING}',
    )  # fmt: skip
    return topology.load(file).exact()


class Grip:
    """A skin in an ambient field that is pressed and pulled, and its `Ambient`.

    `load_n` of shape (n,), `shear_n` of shape (3, n) and `field_ut` of shape (3,) in the skin
    frame are to be set; they hold until they are set anew.
    """

    def __init__(self, skin, seed=0):
        self.skin, self.random = skin, np.random.default_rng(seed)
        self.ambient = Ambient(skin, "float64", crosstalk=True)
        self.load_n, self.shear_n = np.zeros(skin.n), np.zeros((3, skin.n))
        self.field_ut = np.zeros(3)

    def in_units(self, vectors):
        return np.einsum("abn,an->bn", self.skin.rotation, vectors)

    def cycle(self):
        """One cycle; the shear that is felt, shape (2, n), newton, axes of the units."""
        n, taken = self.skin.n, self.ambient.background
        fall_hz = 600.0 * np.minimum(self.load_n, 0.9) + 200.0 * np.maximum(self.load_n - 0.9, 0.0)
        crest_ut = 11073.0 * np.exp(0.72 * (fall_hz / 900.0 - 2.0))
        per_n = crest_ut * np.pi / 5.0 / 0.5
        film = np.vstack([per_n * self.in_units(self.shear_n)[:2], 1.65 * crest_ut])
        chips = np.diag([-1.0, -1.0, 1.0])
        outside = chips @ self.in_units(np.broadcast_to(self.field_ut[:, None], (3, n)))
        field = film + outside + 105.0 * self.random.standard_normal((3, n)) - taken[1:]
        depth = np.zeros((3, n))
        depth[2] = (fall_hz + 6.0 * self.random.standard_normal(n) - taken[0]) / 900.0
        self.shown = look(self.ambient, SimpleNamespace(
            field_ut=field, displacement_mm=depth, temperature=np.full(n, 25.0),
            status=np.zeros(n, np.uint16),
        ))  # fmt: skip
        return field[:2] / per_n

    def run(self, seconds):
        """Mean of what is felt, shape (2, n)."""
        return np.mean([self.cycle() for _ in range(round(seconds * RATE_HZ))], axis=0)

    def close(self, load_n, shear_n, seconds, held_s=1.0):
        """Close the grip within some time and hold it; felt over true shear in the last second, if
        it is held at all."""
        steps = max(round(seconds * RATE_HZ), 1)
        for step in range(steps):
            self.load_n = np.full(self.skin.n, load_n * (step + 1) / steps)
            self.shear_n = np.zeros((3, self.skin.n))
            self.shear_n[0] = shear_n * (step + 1) / steps
            self.cycle()
        if held_s == 0.0:
            return np.nan
        self.run(held_s)
        felt, true = self.run(1.0), self.in_units(self.shear_n)[:2]
        return (felt * true).sum() / (true**2).sum()


def settled(skin, field_ut, seed):
    grip = Grip(skin, seed)
    grip.run(8.0)
    grip.field_ut = field_ut
    grip.run(1.0)
    return grip


@long_after_first("field_ut", [0.0 * EARTH, EARTH], ids=["no field", "earth"])
@long_after_first("pad_n", [0.4, 0.7, 3.0])
def test_shear_of_light_pads_is_felt(pair, pad_n, field_ut):
    """The field found is 5 µT off, 2 mN a unit, and stays so: hence the mean over a few grips."""
    shares = [
        settled(pair, field_ut, seed).close(pad_n / 16.0, 0.6 * pad_n / 16.0, 0.2)
        for seed in range(4)
    ]
    assert np.mean(shares) == pytest.approx(1.0, abs=0.1)


def test_the_field_held_under_a_light_grip_says_how_little_is_known_of_it():
    """The hand turns meanwhile; no unit can tell."""
    grip = settled(topology.load("palm").exact(), EARTH, seed=2)
    grip.close(0.02, 0.05, 0.1, held_s=0.0)
    held = grip.ambient.field_ut
    grip.field_ut = -EARTH
    grip.run(2.0)
    assert np.array_equal(grip.ambient.field_ut, held)
    assert np.sqrt(grip.ambient.residue_ut2).min() > 45.0


def test_shear_that_a_light_grip_holds_makes_no_unit_an_anomaly(pair):
    """0.25 N are 0.8 mT on each unit, which none has at rest; held as long as the long average."""
    grip = settled(pair, EARTH, seed=6)
    grip.load_n[:], grip.shear_n[0] = 0.012, 0.25
    grip.run(8.0)
    assert grip.ambient.voters.tolist() == [0]
    assert grip.shown.valid.all()


def about(axis, angle):
    """A rotation about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
    return turn


@long_after_first("learns", [True, False])
def test_a_turn_that_is_reported_turns_the_field_that_is_held(learns):
    """Tared in the field of the Earth, then turned: with turns before the grip the field at the
    tare is known, and so is the field under the grip; without them sigma says that it is not."""
    misses, sigmas = [], []
    for seed in range(6):
        grip = settled(topology.load("palm").exact(), 0.0 * EARTH, seed)
        attitude = np.eye(3)

        def turn(axis, angle, seconds):
            nonlocal attitude
            start = attitude
            for step in range(steps := round(seconds * RATE_HZ)):
                attitude = start @ about(axis, angle * (step + 1) / steps)
                grip.field_ut = attitude.T @ EARTH - EARTH  # noqa: B023
                grip.cycle()  # noqa: B023
                grip.ambient.turn(attitude)  # noqa: B023

        grip.ambient.turn(attitude)
        for axis, angle in ((0, 1.5), (1, -1.2), (0, -0.8), (2, 1.0)) if learns else ():
            turn(axis, angle, 2.0)
        grip.load_n[:] = 0.03
        grip.shear_n[0] = 0.03
        turn(0, 0.0, 0.5)
        turn(1, 1.5, 1.5)
        assert grip.ambient.voters[0] == 0
        misses.append(grip.ambient.field_ut[:, 0] - grip.field_ut)
        sigmas.append(np.sqrt(np.einsum("aa->a", grip.ambient.covariance_ut2[0])))
    spread, sigma = np.sqrt(np.mean(np.square(misses))), np.sqrt(np.mean(np.square(sigmas)))
    assert spread < 1.5 * sigma
    assert spread < 15.0 if learns else spread > 30.0
    assert sigma < 40.0 if learns else sigma > 50.0


@pytest.mark.parametrize(
    "attitude", [2.0 * np.eye(3), -np.eye(3), np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan),
                 np.eye(2), None, "x"],
)  # fmt: skip
def test_an_attitude_must_be_a_rotation(pair, attitude):
    for turn in (Ambient(pair).turn, Pipeline(pair, Options(want={"temperature"})).turn):
        with pytest.raises(OptionError, match="attitude: must be "):
            turn(attitude)


def test_one_pad_that_is_pressed_leaves_the_other_its_vote(pair):
    grip = settled(pair, EARTH, seed=4)
    on = pair.patch == 0
    grip.load_n = np.where(on, 0.008, 0.0)
    grip.shear_n[0, on] = 0.05
    grip.run(1.0)
    assert grip.ambient.voters.tolist() == [16]
    assert np.abs(grip.ambient.field_ut[:, 0] - EARTH)[:2].max() < 20.0


@pytest.mark.parametrize("shear_n", [0.3, 0.6])
def test_residue_holds_what_an_unknown_vertical_field_does_to_the_angle(pair, shear_n):
    """Against the angle itself, 50 µT more and less along the chip's axis."""
    grip = settled(pair, EARTH, seed=8)
    grip.close(1.0, shear_n, 0.1, held_s=0.0)
    lateral2 = grip.ambient.covariance_ut2[0, 0, 0]
    crest = 11073.0 * np.exp(0.72 * ((540.0 + 200.0 * 0.1) / 900.0 - 2.0))
    across, up = crest * np.pi / 5.0 * shear_n / 0.5, 1.65 * crest
    moved = 0.5 * (np.arctan2(across, up - 50.0) - np.arctan2(across, up + 50.0))
    as_field = moved * np.hypot(across, up)
    assert np.sqrt(grip.ambient.residue_ut2.mean() - lateral2) == pytest.approx(as_field, rel=0.05)
    assert as_field > 10.0


def test_votes_come_back_when_the_grip_opens(pair):
    grip = settled(pair, EARTH, seed=3)
    grip.close(0.03, 0.02, 0.1)
    assert grip.ambient.voters.tolist() == [0]
    grip.load_n, grip.shear_n = np.zeros(32), np.zeros((3, 32))
    grip.field_ut = -EARTH
    grip.run(1.5)
    assert grip.ambient.voters.tolist() == [32]
    found = []
    for _ in range(250):
        grip.cycle()
        found.append(grip.ambient.field_ut[:2, 0])
    assert np.abs(np.mean(found, axis=0) + EARTH[:2]).max() < 8.0


def test_what_is_light_beside_a_press_does_not_silence_the_rest_of_the_palm():
    skin = topology.load("palm").exact()
    grip = settled(skin, EARTH, seed=5)
    away = np.linalg.norm(skin.position - skin.position[:, [0]], axis=0)
    grip.load_n = np.where(away < 0.006, 0.5, np.where(away < 0.025, 0.007, 0.0))
    grip.run(1.0)
    voters = grip.ambient.voters[0]
    assert np.sum(away > 0.03) <= voters <= np.sum(away > 0.025)
