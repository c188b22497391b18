"""A person's hand against springs by hand: what it pushes with, and when."""

import math
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

from skin.demos.person import Hand, Person, brush, bump, draw_person, pull, take, twist

PERSON = Person(stiffness_n_per_m=100.0, tremor_n=0.0, point_m=(0.0, 0.01, 0.0))


class Block:
    """A world with one object that stays where it is put."""

    def __init__(self):
        self.time_s, self.pushed = 0.0, None
        self.truth = SimpleNamespace(
            object_names=("block",), position=np.zeros((3, 1)), velocity=np.zeros((6, 1)),
            rotation=np.eye(3)[:, :, np.newaxis].copy(),
        )  # fmt: skip
        model = SimpleNamespace(body_mass=[0.1])
        self.scene = SimpleNamespace(plant=SimpleNamespace(model=model, object_bodies=[0]))
        self.skin = SimpleNamespace(topology=SimpleNamespace(cycle_rate_hz=250.0))

    def push(self, name, force, moment):
        self.pushed = (name, np.array(force), np.array(moment))


def pushed(act, time_s, person=PERSON, move=None):
    world = Block()
    hand = Hand(world, "block", person)
    hand.begin(act)
    world.time_s = time_s
    if move is not None:
        move(world.truth)
    hand.update()
    return world.pushed[1:]


def test_a_pull_acts_where_the_hand_holds_on():
    force, moment = pushed(pull((0.0, 0.0, 2.0), rise_s=0.2, hold_s=0.4, fall_s=0.2), 0.4)
    grown = 2.0 * 0.02 * np.array([math.sin(v) for v in (8.0 * math.pi, 8.0 * math.pi + 2.0,
                                                         8.0 * math.pi + 4.0)])  # fmt: skip
    np.testing.assert_allclose(force, np.add([0.0, 0.0, 2.0], grown), atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([0.0, 0.01, 0.0], force), atol=1e-12)


def test_the_hand_yields_by_its_stiffness_as_the_object_moves():
    act = twist((0.0, 0.0, 0.0), rise_s=0.2, hold_s=0.4, fall_s=0.2)

    def move(truth):
        truth.position[2, 0] = 0.01

    force, _ = pushed(act, 0.4, move=move)
    np.testing.assert_allclose(force, [0.0, 0.0, -1.0], atol=1e-9)


@pytest.mark.parametrize(("act", "impulse"), [
    (bump((2.0, 0.0, 0.0), 0.05), 2.0 * 0.05 * 2.0 / math.pi),
    (brush((0.4, 0.0, 0.0), 0.2), 0.4 * 0.2 * 0.5),
])  # fmt: skip
def test_bumps_and_brushes_have_the_impulse_of_their_course(act, impulse):
    times = np.linspace(0.0, act.seconds, 2001)[:-1]
    total = sum(pushed(act, t)[0][0] for t in times) * times[1]
    assert total == pytest.approx(impulse, rel=1e-3)
    assert pushed(act, act.seconds + 0.01)[0] == pytest.approx(np.zeros(3))


def test_who_hesitates_lets_go_before_the_take():
    act = take((0.0, 0.0, 1.0), 0.2, hesitates=0.3, waits_s=0.5)
    course = [act.course(t) for t in (0.25, 0.5, 0.6, 5.0)]
    assert course == pytest.approx([0.3, 0.0, 0.5, 1.0])
    assert pickle.loads(pickle.dumps(act)).course == act.course


def test_people_differ_by_seed_alone():
    drawn = [draw_person(np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert all(60.0 <= person.stiffness_n_per_m <= 600.0 for person in drawn)
